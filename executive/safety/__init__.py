"""When the rover must stand, whatever was commanded."""
