"""Connections of the core: ROS, links, operators."""
