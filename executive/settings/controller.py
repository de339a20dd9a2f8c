"""Motion controller to targets of a rover with velocity commands, for settings and commands."""

from enum import Enum, unique


@unique
class Controller(Enum):
    """Motion controller to targets of a rover that is driven by velocity commands."""

    TURN_DRIVE = "turn_drive"
    MPC = "mpc"
