"""The core of the rover: commands, their life cycle, and the one writer of its actuators."""
