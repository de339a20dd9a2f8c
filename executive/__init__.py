"""The core of one rover, importable without ROS, physics or sockets."""
