"""The process `rover-sim`: a simulated rover on ROS topics."""
