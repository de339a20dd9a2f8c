"""What sensors and other links report to the executive."""

from dataclasses import dataclass
from enum import Enum
from typing import Final

from executive.values.geometry import Pose, Velocity
from executive.values.reports import Identity


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose and velocity of base_link in the odometry frame.

    Attributes:
        stamp_s: when it was measured, on the clock of its publisher.
        position_sd_m, heading_sd_rad: standard deviations as it says them; 0 where it says none.
    """

    stamp_s: float
    pose: Pose
    velocity: Velocity
    position_sd_m: float = 0.0
    heading_sd_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Imu:
    """What an inertial measurement unit measures, in the axes of base_link (REP 103).

    Attributes:
        stamp_s: when it was measured, on the clock of its publisher.
        roll_rad, pitch_rad: how base_link leans, as in `Pose`; NaN where that is not measured.
        gyro_x_radps, gyro_y_radps, gyro_z_radps: rates about the axes.
        acceleration_x_mps2, acceleration_y_mps2, acceleration_z_mps2: specific force, gravity
            included: z is +9.81 at rest on level ground.
    """

    stamp_s: float
    roll_rad: float
    pitch_rad: float
    gyro_x_radps: float
    gyro_y_radps: float
    gyro_z_radps: float
    acceleration_x_mps2: float
    acceleration_y_mps2: float
    acceleration_z_mps2: float


@dataclass(frozen=True, slots=True)
class Joints:
    """How fast the driven wheels turn, and with what torque, front first.

    Attributes:
        stamp_s: when it was measured, on the clock of its publisher.
        left_radps, right_radps: speeds of the wheels of a side, forward positive.
        left_nm, right_nm: torques of the motors on them; empty where none are measured.
    """

    stamp_s: float
    left_radps: tuple[float, ...]
    right_radps: tuple[float, ...]
    left_nm: tuple[float, ...] = ()
    right_nm: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class SecondOdometry:
    """Pose of base_link by an odometry that does not come from the wheels.

    Attributes:
        stamp_s: when it was measured, on the clock of its publisher.
        pose: in an odometry frame of its own, which need not be that of `Odometry`.
        position_sd_m, heading_sd_rad: standard deviations as it says them; 0 where it says none.
    """

    stamp_s: float
    pose: Pose
    position_sd_m: float = 0.0
    heading_sd_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class LaserScan:
    """Distances to what stands around, in a plane through base_link, with it as the origin.

    Attributes:
        stamp_s: when it was measured, on the clock of its publisher.
        angle_min_rad: direction of the first ray, counter-clockwise from ahead.
        angle_increment_rad: from each ray to the next.
        range_min_m, range_max_m: between which the laser measures.
        ranges_m: of each ray, by REP 117: infinite where nothing came back, minus infinite where
            something is too near to be measured, NaN where nothing usable was measured.
    """

    stamp_s: float
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    ranges_m: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Battery:
    """What a battery tells.

    Attributes:
        charge_ratio: charge left, of the whole, 0 to 1; None where it does not say.
    """

    voltage_v: float
    charge_ratio: float | None = None


@dataclass(frozen=True, slots=True)
class CameraAngles:
    """Where the camera points, measured: pan counter-clockwise, tilt upward positive."""

    pan_rad: float
    tilt_rad: float


@dataclass(frozen=True, slots=True)
class Frame:
    """One encoded camera picture.

    Attributes:
        stamp_s: when it was taken, on the clock of its publisher.
        format: JPG or PNG.
    """

    stamp_s: float
    format: str
    data: bytes


@dataclass(frozen=True, slots=True)
class ForeignPublishers:
    """Who else may move the rover: nodes other than ours that publish its velocity."""

    names: tuple[str, ...]


VELOCITY_TOPIC: Final = "the executive's own topic"


@dataclass(frozen=True, slots=True)
class OtherInput:
    """Somebody commands the base by another input of its mux, or on the executive's own topic.

    Attributes:
        name: of the input; `VELOCITY_TOPIC` on the executive's own.
        above: whether the base obeys it rather than the executive.
        by: who, for people, where that is known.
    """

    name: str
    above: bool
    by: str = ""

    def __str__(self) -> str:
        return f"{self.name} ({self.by})" if self.by else self.name


@dataclass(frozen=True, slots=True)
class MotionStarted:
    """A rover that moves by itself says that it has begun a whole motion."""

    number: int


@dataclass(frozen=True, slots=True)
class MotionEnded:
    """A rover that moves by itself ended a whole motion; the text is what it says of that."""

    number: int
    executed: bool
    text: str = ""


@dataclass(frozen=True, slots=True)
class CommandEnded:
    """A command ended that the rover received over another link first, and executed once."""

    identity: Identity
    executed: bool
    text: str = ""


@dataclass(frozen=True, slots=True)
class CommandUnderWay:
    """The rover carries out a command that it received over another link first."""

    identity: Identity


@dataclass(frozen=True, slots=True)
class Stopped:
    """The rover was stopped over another link, by whom is for people."""

    by: str


@dataclass(frozen=True, slots=True)
class AuthorityUsed:
    """The rover took a command by the authority of this epoch over another link."""

    epoch: int


class Source(Enum):
    """Where data come from, or go to, as texts name it; names begin the names of faults."""

    ODOMETRY = "odometry"
    IMU = "IMU data"
    JOINTS = "joint state"
    SECOND_ODOMETRY = "second odometry"
    LASER = "laser scan"
    BATTERY = "battery state"
    CAMERA = "camera frame"
    VELOCITY = "velocity command"


@dataclass(frozen=True, slots=True)
class RejectedData:
    """Data of a source arrive and cannot be used; repeated each second while that is so.

    Attributes:
        rate_hz: messages that are rejected, 0 where that is not known yet; None where messages are
            sent and not received.
        of_hz: all messages that arrive.
    """

    source: Source
    reason: str
    rate_hz: float | None = None
    of_hz: float = 0.0

    def __str__(self) -> str:
        what = self.source.value
        if self.rate_hz is None:
            return f"{what} is not received: {self.reason}"
        if self.rate_hz < self.of_hz:
            what += f" arrives at {self.of_hz:.0f} Hz, of which {self.rate_hz:.0f} Hz are rejected"
            return f"{what}: {self.reason}"
        rate = f" at {self.rate_hz:.0f} Hz" if self.rate_hz else ""
        return f"{what} arrives{rate} and is rejected: {self.reason}"


Fact = (
    Odometry
    | Imu
    | Joints
    | SecondOdometry
    | LaserScan
    | Battery
    | CameraAngles
    | Frame
    | ForeignPublishers
    | OtherInput
    | MotionStarted
    | MotionEnded
    | CommandEnded
    | CommandUnderWay
    | Stopped
    | AuthorityUsed
    | RejectedData
)
