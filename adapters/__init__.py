"""Everything that connects the core to the world: ROS, links, people."""
