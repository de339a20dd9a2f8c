"""Faults that can be switched on in a running rover."""

from enum import Enum
from typing import Final


class Fault(Enum):
    """What goes wrong; `SimulatedBody.inject` starts it and `clear` ends it."""

    ODOMETRY_LOST = "odometry_lost"
    """No odometry arrives."""
    ODOMETRY_FROZEN = "odometry_frozen"
    """Odometry arrives with new stamps, its pose and velocity as they were."""
    ODOMETRY_JUMP = "odometry_jump"
    """The pose jumps once, by `JUMP_M` to the left; clearing it does not jump back."""
    LEFT_STUCK = "left_stuck"
    """The left wheels are locked."""
    RIGHT_STUCK = "right_stuck"
    """The right wheels are locked."""
    CAMERA_DEAD = "camera_dead"
    """No picture comes, however often one is asked for."""
    BATTERY_LOW = "battery_low"
    """The battery gives `Pack.fault_v`."""


JUMP_M: Final = 0.36
