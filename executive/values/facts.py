"""Facts: measurements of sensors, and events of other links and nodes, that enter the core.

`frame_fault` refuses a picture that is truncated or outdated.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Final

from executive.values.geometry import Point, Pose, Vector, Velocity
from executive.values.reasons import Figure, Identity, Reason, Refusal


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose and velocity of base_link in the odometry frame.

    Attributes:
        stamp_s: time of measurement, on the clock of its publisher.
        position_sd_m, heading_sd_rad: standard deviations; 0 where the message gives none.
    """

    stamp_s: float
    pose: Pose
    velocity: Velocity
    position_sd_m: float = 0.0
    heading_sd_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Imu:
    """Measurement of an inertial measurement unit, in the axes of base_link (REP 103).

    Attributes:
        stamp_s: time of measurement, on the clock of its publisher.
        roll_rad, pitch_rad: inclination of base_link, as in `Pose`; NaN where not measured.
        gyro_x_radps, gyro_y_radps, gyro_z_radps: rates about the axes.
        acceleration_x_mps2, acceleration_y_mps2, acceleration_z_mps2: specific force, gravity
            included: z is +9.81 at rest on level ground; NaN where not measured.
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

    @property
    def rates(self) -> Vector:
        """The rates as a vector, rad/s."""
        return self.gyro_x_radps, self.gyro_y_radps, self.gyro_z_radps

    @property
    def acceleration(self) -> Vector:
        """The specific force as a vector, m/s²."""
        return self.acceleration_x_mps2, self.acceleration_y_mps2, self.acceleration_z_mps2


@dataclass(frozen=True, slots=True)
class Joints:
    """Speeds and torques of the driven wheels, front first.

    Attributes:
        stamp_s: time of measurement, on the clock of its publisher.
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
    """Pose of base_link from an odometry independent of the wheels.

    Attributes:
        stamp_s: time of measurement, on the clock of its publisher.
        pose: in an odometry frame of its own, which need not be that of `Odometry`.
        position_sd_m, heading_sd_rad: standard deviations; 0 where the message gives none.
    """

    stamp_s: float
    pose: Pose
    position_sd_m: float = 0.0
    heading_sd_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class LaserScan:
    """Distances to the surroundings, in a horizontal plane with base_link as the origin.

    Attributes:
        stamp_s: time of measurement, on the clock of its publisher.
        angle_min_rad: direction of the first ray, counter-clockwise from ahead.
        angle_increment_rad: angle between adjacent rays.
        range_min_m, range_max_m: measuring range of the laser.
        ranges_m: one per ray, by REP 117: infinite without a return, minus infinite where the
            return is too near to be measured, NaN for an unusable measurement.
    """

    stamp_s: float
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    ranges_m: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Battery:
    """State of the battery.

    Attributes:
        charge_ratio: charge left as a ratio of the full charge, 0 to 1; None if not reported.
    """

    voltage_v: float
    charge_ratio: float | None = None


@dataclass(frozen=True, slots=True)
class CameraAngles:
    """Measured direction of the camera: pan counter-clockwise, tilt upward positive."""

    pan_rad: float
    tilt_rad: float


@dataclass(frozen=True, slots=True)
class Frame:
    """One encoded camera picture.

    Attributes:
        stamp_s: time of exposure, on the clock of its publisher.
        format: JPG or PNG.
    """

    stamp_s: float
    format: str
    data: bytes


@dataclass(frozen=True, slots=True)
class ForeignPublishers:
    """Other velocity publishers: nodes other than ours that publish the rover's velocity."""

    names: tuple[str, ...]


VELOCITY_TOPIC: Final = "the executive's own topic"


@dataclass(frozen=True, slots=True)
class ForeignMuxInput:
    """Commands on another input of the base's mux, or on the executive's own velocity topic.

    Attributes:
        name: name of the input; `VELOCITY_TOPIC` for the executive's own topic.
        overrides: whether it drives the base in place of the executive.
        publisher: human-readable name of the sender, where known.
    """

    name: str
    overrides: bool
    publisher: str = ""

    def __str__(self) -> str:
        return f"{self.name} ({self.publisher})" if self.publisher else self.name


@dataclass(frozen=True, slots=True)
class MotionStarted:
    """A rover that executes whole motions has started one."""

    number: int


@dataclass(frozen=True, slots=True)
class MotionEnded:
    """A rover that executes whole motions has ended one; the text is its own report."""

    number: int
    executed: bool
    text: str = ""


@dataclass(frozen=True, slots=True)
class ExternalCommandEnded:
    """A command that the rover received over another link first, and executed once, has ended."""

    identity: Identity
    executed: bool
    text: str = ""


@dataclass(frozen=True, slots=True)
class ExternalCommandRunning:
    """The rover executes a command that it received over another link first."""

    identity: Identity


@dataclass(frozen=True, slots=True)
class ExternalStop:
    """The rover was stopped over another link, by a command; None if its id is unknown."""

    identity: Identity | None


@dataclass(frozen=True, slots=True)
class ExternalAuthorityUse:
    """The rover accepted a command with the authority of this epoch over another link."""

    epoch: int


@dataclass(frozen=True, slots=True)
class EmergencyStop:
    """Whether the robot's own emergency stop is active: a button, a bumper, its safety system."""

    active: bool


@dataclass(frozen=True, slots=True)
class MapToOdom:
    """Pose of the odometry frame in the map, in the plane, as a localisation publishes it."""

    pose: Pose


class NavigationState(Enum):
    """State of a goal of the navigation, as its server reports it.

    Attributes:
        UNAVAILABLE: there is no server, or its interface package is missing here.
        LOST: the server does not know the goal, or is another than the one that accepted it.
        PREEMPTED: the goal of another client is executed.
    """

    UNAVAILABLE = "unavailable"
    ACCEPTED = "accepted"
    REJECTED = "rejected"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"
    CANCELLED = "cancelled"
    LOST = "lost"
    PREEMPTED = "preempted"


@dataclass(frozen=True, slots=True)
class NavigationStatus:
    """A state of the goal of this number, with its error code and message, if it has one.

    Attributes:
        missed: indices of the poses that it missed.
    """

    number: int
    state: NavigationState
    code: int = 0
    code_name: str = ""
    text: str = ""
    missed: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class NavigationFeedback:
    """Feedback on the goal of this number: never evidence of motion. None if not reported.

    Attributes:
        remaining_m: length of the path that is left.
    """

    number: int
    remaining_m: float | None
    recoveries: int = 0
    poses_remaining: int | None = None


@dataclass(frozen=True, slots=True)
class NavigationVelocity:
    """A velocity that the navigation published, with the gate open or shut; also zero."""

    velocity: Velocity


@dataclass(frozen=True, slots=True)
class PlannedPath:
    """The planner's answer to a `PathRequest`, in its frame; without points why there is none."""

    number: int
    points: tuple[Point, ...]
    text: str = ""


class Source(Enum):
    """Source or destination of data, as named in messages; member names prefix names of faults."""

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
    """Data of a source arrive but are unusable; repeated each second while this persists.

    Attributes:
        rate_hz: rate of rejected messages, 0 if not known yet; None where messages are sent and
            not received.
        received_hz: rate of all messages that arrive.
    """

    source: Source
    reason: str
    rate_hz: float | None = None
    received_hz: float = 0.0

    def __str__(self) -> str:
        what = self.source.value
        if self.rate_hz is None:
            return f"{what} is not received: {self.reason}"
        if self.rate_hz < self.received_hz:
            what += f" arrives at {self.received_hz:.0f} Hz, {self.rate_hz:.0f} Hz of it rejected"
            return f"{what}: {self.reason}"
        rate = f" at {self.rate_hz:.0f} Hz" if self.rate_hz else ""
        return f"{what} arrives{rate} and is rejected: {self.reason}"


SensorFact = Imu | Joints | SecondOdometry | LaserScan
Fact = (
    Odometry
    | SensorFact
    | Battery
    | CameraAngles
    | Frame
    | ForeignPublishers
    | ForeignMuxInput
    | MotionStarted
    | MotionEnded
    | ExternalCommandEnded
    | ExternalCommandRunning
    | ExternalStop
    | ExternalAuthorityUse
    | RejectedData
    | EmergencyStop
    | MapToOdom
    | NavigationStatus
    | NavigationFeedback
    | NavigationVelocity
    | PlannedPath
)


STAMP_TOLERANCE_S: Final = 0.1
"""Maximum lead of the request over a stamp: clock offsets are known no better."""
END_WITHIN: Final = 1024
"""Octets from the end within which the end marker must be: some cameras pad."""
_ENDS: Final = {"JPG": b"\xff\xd9", "PNG": b"IEND"}


def frame_fault(
    frame: Frame, taken_s: float | None, requested_s: float, last_stamp_s: float | None
) -> Refusal | None:
    """Return a refusal if the frame is truncated or outdated, or None.

    Args:
        frame: the first one after the request.
        taken_s: time of exposure, on the core's time; None if its clock is unknown.
        requested_s: time of the request.
        last_stamp_s: of the previous picture.
    """
    end = _ENDS.get(frame.format)
    if end is not None and end not in frame.data[-END_WITHIN:]:
        size = len(frame.data)
        text = f"camera picture truncated: no end marker in its {size} octets"
        return Refusal(Reason.CAPTURE_TRUNCATED, text, (Figure("size", size, "octet"),))
    if taken_s is not None and taken_s < requested_s - STAMP_TOLERANCE_S:
        age_s = requested_s - taken_s
        text = f"camera picture outdated: taken {age_s:.1f} s before the request"
        return Refusal(Reason.CAPTURE_STALE, text, (Figure("age", age_s, "s"),))
    if frame.stamp_s == last_stamp_s:
        text = "camera picture outdated: it has the stamp of the previous one"
        return Refusal(Reason.CAPTURE_STALE, text)
    return None
