"""Adapters that connect the core to ROS, links and operators, and the processes made of them."""
