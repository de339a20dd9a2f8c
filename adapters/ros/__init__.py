"""The executive's side of ROS 2: rclpy lives here and in the simulation only."""
