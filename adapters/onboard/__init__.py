"""The process `rover-executive`: assembles the core, its tree, ROS and the links."""
