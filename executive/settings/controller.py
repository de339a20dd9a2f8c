"""What drives a rover that takes velocities to a place: settings name it, and commands can."""

from enum import Enum, unique


@unique
class Controller(Enum):
    """What drives a rover that takes velocities to a place."""

    TURN_DRIVE = "turn_drive"
    MPC = "mpc"
