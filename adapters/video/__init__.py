"""The camera's video stream over UDP, from the rover to the ground."""
