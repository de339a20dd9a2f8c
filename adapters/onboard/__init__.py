"""The executive's process: assembles the core, its tree, ROS and the links."""
