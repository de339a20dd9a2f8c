"""`Parameter`: the twelve telemetry parameters of the thesis (fig. 21)."""

from dataclasses import dataclass
from enum import Enum, unique
from typing import Self


@unique
class Parameter(Enum):
    """A telemetry parameter, spelled as in the thesis.

    Attributes:
        writable: whether a command sets it.
    """

    POS_X = "POS_X", "Current position X", "m"
    POS_Y = "POS_Y", "Current position Y", "m"
    POS_Z = "POS_Z", "Current position Z", "m"
    HEAD = "HEAD", "Current heading", "rad"
    TRAVEL_SPEED = "TRAVEL_SPEED", "Maximum linear speed", "m/s", True
    ROTATE_SPEED = "ROTATE_SPEED", "Maximum angular speed", "rad/s", True
    CURRENT_TRAVEL_SPEED = "CURRENT_TRAVEL_SPEED", "Current linear speed", "m/s"
    CURRENT_ROTATE_SPEED = "CURRENT_ROTATE_SPEED", "Current angular speed", "rad/s"
    BATERY_VOLTAGE = "BATERY_VOLTAGE", "Current battery voltage", "V"
    CAM_PAN = "CAM_PAN", "Current pan angle of the camera", "rad"
    CAM_TILT = "CAM_TILT", "Current tilt angle of the camera", "rad"
    CAM_ROTATE_SPEED = "CAM_ROTATE_SPEED", "Maximum angular speed of the camera", "rad/s", True

    description: str
    unit: str
    writable: bool

    def __new__(
        cls, name: str, description: str = "", unit: str = "", writable: bool = False
    ) -> Self:
        """Create a parameter; its value is its name."""
        parameter = object.__new__(cls)
        parameter._value_ = name
        parameter.description = description
        parameter.unit = unit
        parameter.writable = writable
        return parameter


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """Value of a parameter at one time.

    Attributes:
        utc_s: sampling time, seconds since 1970-01-01 UTC.
        value: None if no valid value is known.
    """

    parameter: Parameter
    utc_s: float
    value: float | None
