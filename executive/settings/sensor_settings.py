"""Settings of an asset's sensors: `OdometrySettings`, and `Sensors` besides it."""

from dataclasses import dataclass
from enum import Enum, unique
from math import pi
from typing import Final

from executive.settings.settings_files import require_above_zero
from executive.values.geometry import Rotation

MAX_TWIST_MEAN_S: Final = 2.5
"""Maximum time of a mean twist: the history contains two of them beside any window."""
TURN_SCALES: Final = (0.6, 3.0)
"""Bounds of the turn by wheels per turn of the rover; recorded with skid steering: 0.95 to 1.32."""


@unique
class Sensor(Enum):
    """Sensors of an asset besides its odometry; values are the keys of `Sensors`."""

    IMU = "imu"
    JOINTS = "joints"
    SECOND_ODOMETRY = "second_odometry"
    LASER = "laser"


@unique
class TurnSource(Enum):
    """Source of the heading."""

    ODOMETRY = "odometry"
    GYRO = "gyro"


@dataclass(frozen=True, slots=True)
class OdometrySettings:
    """The odometry.

    Attributes:
        rate_hz: its rate; None: learnt.
        twist_mean_s: averaging time or delay of its twist; 0: momentary; None: learnt.
        turn: source of the heading; the path is that of the odometry.
        turn_scale: turn by the odometry per turn of the rover, with a heading by the gyro.
    """

    rate_hz: float | None = None
    twist_mean_s: float | None = None
    turn: TurnSource = TurnSource.ODOMETRY
    turn_scale: float = 1.0

    def __post_init__(self) -> None:
        """Raise ValueError unless the figures are in their bounds."""
        require_above_zero(self, "rate_hz")
        low, high = TURN_SCALES
        if not low <= self.turn_scale <= high:
            raise ValueError(f"turn_scale is {self.turn_scale:g}: {low:g} to {high:g}")
        if self.turn_scale != 1.0 and self.turn is TurnSource.ODOMETRY:
            raise ValueError("turn_scale needs turn: gyro")
        if self.twist_mean_s is not None and not 0.0 <= self.twist_mean_s <= MAX_TWIST_MEAN_S:
            raise ValueError(f"twist_mean_s is {self.twist_mean_s:g}: 0 to {MAX_TWIST_MEAN_S:g} s")


@dataclass(frozen=True, slots=True)
class SensorSettings:
    """A sensor, and its sample rate."""

    rate_hz: float

    def __post_init__(self) -> None:
        """Raise ValueError unless the rate is positive."""
        require_above_zero(self, "rate_hz")


@dataclass(frozen=True, slots=True)
class ImuSettings(SensorSettings):
    """An inertial measurement unit.

    Attributes:
        mounting: its axes in those of base_link; None if they are parallel.
    """

    mounting: Rotation | None = None

    def __post_init__(self) -> None:
        """Raise ValueError unless the rate is positive, and the angles are within a turn."""
        require_above_zero(self, "rate_hz")
        turns = self.mounting or Rotation()
        for angle in (turns.roll_rad, turns.pitch_rad, turns.yaw_rad):
            if not abs(angle) <= 2 * pi:
                raise ValueError(
                    f"mounting has {angle:g} rad: were degrees meant? Write {angle:g}deg"
                )


@dataclass(frozen=True, slots=True)
class JointsSettings(SensorSettings):
    """Sensors of the driven wheels.

    Attributes:
        track_m: distance between left and right wheels; with skid steering, the effective one.
    """

    wheel_radius_m: float
    track_m: float

    def __post_init__(self) -> None:
        """Raise ValueError unless every figure is positive."""
        require_above_zero(self, "rate_hz", "wheel_radius_m", "track_m")


@dataclass(frozen=True, slots=True)
class SecondOdometrySettings(SensorSettings):
    """An odometry independent of the wheels: by camera, laser or satellites.

    Attributes:
        fused: whether the executive corrects the pose by it, because no filter of the rover does.
    """

    fused: bool = False


@dataclass(frozen=True, slots=True)
class LaserSettings(SensorSettings):
    """A laser that scans a plane through base_link, and its scan rate.

    Attributes:
        zero_is_free: whether its driver reports 0 for rays without a return, as LDS-01 and URG-04LX
            do, and not infinity (REP 117).
    """

    zero_is_free: bool = False


@dataclass(frozen=True, slots=True)
class Sensors:
    """Sensors of an asset besides its odometry; None if absent."""

    imu: ImuSettings | None = None
    joints: JointsSettings | None = None
    second_odometry: SecondOdometrySettings | None = None
    laser: LaserSettings | None = None

    @property
    def present(self) -> frozenset[Sensor]:
        """The sensors of the asset."""
        return frozenset(each for each in Sensor if getattr(self, each.value) is not None)
