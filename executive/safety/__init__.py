"""When the rover must stand, whatever was commanded."""

from executive.safety.monitors import find_hazard

__all__ = [
    "find_hazard",
]
