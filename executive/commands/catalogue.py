"""What a rover can be asked to do: typed requests, and the command that carries one.

Requests hold SI units and radians. `executive.commands.intake` decides whether one is allowed.
"""

from dataclasses import dataclass
from enum import Enum

from executive.reports import Identity


@dataclass(frozen=True, slots=True)
class PlanArgument:
    """A value given to a plan, which its nodes read as `{name}`; the text is as in XML."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class PlanDefinition:
    """A plan as it was sent.

    Attributes:
        format: how to read the content; `BTCPP4` is known.
        content: the octets of the text.
    """

    plan_id: str
    name: str
    format: str
    content: bytes
    arguments: tuple[PlanArgument, ...] = ()


@dataclass(frozen=True, slots=True)
class SubmitPlan:
    """Check a plan whole, and keep it."""

    plan: PlanDefinition


@dataclass(frozen=True, slots=True)
class ActivatePlan:
    """Give the rover to a plan."""

    plan_id: str


@dataclass(frozen=True, slots=True)
class SuspendPlan:
    """Take the rover from a plan, until it is resumed."""

    plan_id: str


@dataclass(frozen=True, slots=True)
class ResumePlan:
    """Let a suspended plan go on where it was."""

    plan_id: str


@dataclass(frozen=True, slots=True)
class AbortPlan:
    """End a plan for good."""

    plan_id: str


@dataclass(frozen=True, slots=True)
class RemovePlan:
    """Forget a plan that has ended or never began."""

    plan_id: str


PlanRequest = SubmitPlan | ActivatePlan | SuspendPlan | ResumePlan | AbortPlan | RemovePlan


class Arrival(Enum):
    """What a motion command does to the motion that it finds running or queued."""

    APPEND = "append"
    REPLACE = "replace"


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A place to reach in the odometry frame.

    Attributes:
        heading_rad: heading to hold at the end; None keeps the heading of the drive.
        tolerance_m: how near is near enough; None takes the asset's own.
    """

    x_m: float
    y_m: float
    heading_rad: float | None = None
    tolerance_m: float | None = None


@dataclass(frozen=True, slots=True)
class MoveTo:
    """Turn towards a place, drive there, turn to its heading (thesis 5.1.3)."""

    target: Waypoint


@dataclass(frozen=True, slots=True)
class MoveForward:
    """Drive straight on; a negative distance drives backward."""

    distance_m: float


@dataclass(frozen=True, slots=True)
class RotateTo:
    """Turn on the spot to an absolute heading."""

    heading_rad: float


@dataclass(frozen=True, slots=True)
class RotateBy:
    """Turn on the spot by an angle, counter-clockwise positive."""

    angle_rad: float


@dataclass(frozen=True, slots=True)
class DriveFor:
    """Hold a velocity for a time; the motion ends by itself (MRS operation `drive`)."""

    travel_mps: float
    rotate_radps: float
    duration_s: float


@dataclass(frozen=True, slots=True)
class FollowPath:
    """Visit waypoints in their order."""

    waypoints: tuple[Waypoint, ...]


@dataclass(frozen=True, slots=True)
class Stop:
    """Stand still at once, end every goal, and stay until a Resume."""


@dataclass(frozen=True, slots=True)
class Resume:
    """Leave STOPPED or SAFE, if what caused it is gone."""


@dataclass(frozen=True, slots=True)
class SetTravelSpeed:
    """Set the greatest linear speed, TRAVEL_SPEED."""

    speed_mps: float


@dataclass(frozen=True, slots=True)
class SetRotateSpeed:
    """Set the greatest angular speed, ROTATE_SPEED."""

    speed_radps: float


@dataclass(frozen=True, slots=True)
class SetPositionCompensation:
    """Set what is added to the measured pose before it is used and reported."""

    x_m: float
    y_m: float
    z_m: float
    heading_rad: float


@dataclass(frozen=True, slots=True)
class SetCameraAngles:
    """Point the camera; None keeps an axis as it is."""

    pan_rad: float | None = None
    tilt_rad: float | None = None


@dataclass(frozen=True, slots=True)
class MoveCameraAngles:
    """Turn the camera relative to where it points when the command starts."""

    pan_rad: float
    tilt_rad: float


@dataclass(frozen=True, slots=True)
class SetCameraRotateSpeed:
    """Set the greatest angular speed of the camera, CAM_ROTATE_SPEED."""

    speed_radps: float


@dataclass(frozen=True, slots=True)
class TakePicture:
    """Store the next camera frame; None takes the camera's own setting."""

    width_px: int | None = None
    height_px: int | None = None
    format: str | None = None
    quality: int | None = None


@dataclass(frozen=True, slots=True)
class SetStatusInterval:
    """Set how often telemetry is sent; 0 sends it on change only."""

    interval_s: float


@dataclass(frozen=True, slots=True)
class DeleteFile:
    """Delete a file of the monitored folder."""

    path: str


@dataclass(frozen=True, slots=True)
class MoveFile:
    """Give a file of the monitored folder another path, where nothing lies yet."""

    path: str
    target: str


@dataclass(frozen=True, slots=True)
class ExecuteAction:
    """Do what one line of text asks (thesis 5.1.3): an action of `executive.commands.actions`."""

    action: str


Motion = MoveTo | MoveForward | RotateTo | RotateBy | DriveFor | FollowPath
CameraWork = SetCameraAngles | MoveCameraAngles | TakePicture
InstantCommand = DeleteFile | MoveFile | ExecuteAction
Setting = (
    SetTravelSpeed
    | SetRotateSpeed
    | SetPositionCompensation
    | SetCameraRotateSpeed
    | SetStatusInterval
)
Request = Motion | CameraWork | InstantCommand | Setting | PlanRequest | Stop | Resume


@dataclass(frozen=True, slots=True)
class Command:
    """A request with its identity, its life span, and the link it came in by.

    Attributes:
        created_utc_s: when the source made it, seconds since 1970-01-01 UTC.
        lifetime_s: seconds from `created_utc_s` (from arrival, if that is None) after which
            it must not start.
        arrival: what it does to motion under way.
    """

    identity: Identity
    request: Request
    link: str
    created_utc_s: float | None = None
    lifetime_s: float | None = None
    counter: int | None = None
    report_started: bool = True
    report_progress: bool = True
    arrival: Arrival = Arrival.APPEND

    @property
    def name(self) -> str:
        """The request's name, for people and logs."""
        return type(self.request).__name__
