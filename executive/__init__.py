"""The core of one rover's executive, importable without ROS, physics or sockets."""
