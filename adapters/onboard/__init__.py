"""The executive's process: puts the core, its tree, ROS and the links together."""
