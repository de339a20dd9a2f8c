"""The twelve telemetry parameters of the thesis (fig. 21), with their units."""

from dataclasses import dataclass
from enum import Enum, unique


@unique
class Parameter(Enum):
    """A telemetry parameter, spelled as in the thesis."""

    POS_X = "POS_X"
    POS_Y = "POS_Y"
    POS_Z = "POS_Z"
    HEAD = "HEAD"
    TRAVEL_SPEED = "TRAVEL_SPEED"
    ROTATE_SPEED = "ROTATE_SPEED"
    CURRENT_TRAVEL_SPEED = "CURRENT_TRAVEL_SPEED"
    CURRENT_ROTATE_SPEED = "CURRENT_ROTATE_SPEED"
    BATERY_VOLTAGE = "BATERY_VOLTAGE"
    CAM_PAN = "CAM_PAN"
    CAM_TILT = "CAM_TILT"
    CAM_ROTATE_SPEED = "CAM_ROTATE_SPEED"


@dataclass(frozen=True, slots=True)
class Definition:
    """What a parameter means.

    Attributes:
        writable: whether a command sets it.
    """

    parameter: Parameter
    description: str
    unit: str
    writable: bool = False


DEFINITIONS: tuple[Definition, ...] = (
    Definition(Parameter.POS_X, "Current position X", "m"),
    Definition(Parameter.POS_Y, "Current position Y", "m"),
    Definition(Parameter.POS_Z, "Current position Z", "m"),
    Definition(Parameter.HEAD, "Current heading", "rad"),
    Definition(Parameter.TRAVEL_SPEED, "Maximum linear speed", "m/s", writable=True),
    Definition(Parameter.ROTATE_SPEED, "Maximum angular speed", "rad/s", writable=True),
    Definition(Parameter.CURRENT_TRAVEL_SPEED, "Current linear speed", "m/s"),
    Definition(Parameter.CURRENT_ROTATE_SPEED, "Current angular speed", "rad/s"),
    Definition(Parameter.BATERY_VOLTAGE, "Current battery voltage", "V"),
    Definition(Parameter.CAM_PAN, "Current pan angle of the camera", "rad"),
    Definition(Parameter.CAM_TILT, "Current tilt angle of the camera", "rad"),
    Definition(
        Parameter.CAM_ROTATE_SPEED, "Maximum angular speed of the camera", "rad/s", writable=True
    ),
)


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """A parameter at a moment.

    Attributes:
        utc_s: sampling time, seconds since 1970-01-01 UTC.
        value: None when nothing valid is known.
    """

    parameter: Parameter
    utc_s: float
    value: float | None
