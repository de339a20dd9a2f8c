"""The catalogue: a class for each request (`MoveTo`, `Stop`, ...); `Command` carries one of them.

Intake, limits, the operations of the MRS, `rover command`, the leaves of plans, the operations of
scenarios and the reference page follow from these declarations. SI units and radians.

Each motion has a method `segments`, which returns the turns, lines, arcs and rests of base_link
from a pose; with `reverse` the rover drives backward to targets behind it. On a detour a `MoveTo`
has the segments of a `FollowPath` through the corners of the detour.
"""

from dataclasses import dataclass, replace
from enum import Enum
from math import pi
from typing import Final

from executive.commands.declaration import (
    ANGLE,
    PATH,
    AssetChoice,
    Family,
    SymmetricRange,
    argument,
    bounded,
    command,
    declaration_of,
    record,
)
from executive.commands.precondition import Precondition
from executive.commands.segments import Arc, Line, Reference, Segment, Turn
from executive.settings import Controller, TargetFrame
from executive.values.geometry import Point, Pose, Velocity, wrap_rad
from executive.values.reports import Identity

MIN_SPEED = 0.01


@record
class Waypoint:
    """A target in the frame of its command; without a heading, that of the drive is kept."""

    x_m: float = argument(help="in the odometry frame, or in the map")
    y_m: float = argument(help="in the odometry frame, or in the map")
    heading_rad: float | None = argument(ANGLE, "heading at the end", default=None)
    tolerance_m: float | None = argument(
        bounded(MIN_SPEED, 1.0), "position tolerance", default=None
    )

    @property
    def point(self) -> Point:
        """The position."""
        return Point(self.x_m, self.y_m)

    def moved(self, origin: Pose) -> "Waypoint":
        """Return the waypoint in another frame, given the origin of its own frame there."""
        pose = origin.compose(Pose(self.x_m, self.y_m, heading_rad=self.heading_rad or 0.0))
        heading_rad = None if self.heading_rad is None else pose.heading_rad
        return replace(self, x_m=pose.x_m, y_m=pose.y_m, heading_rad=heading_rad)

    def segments(self, start: Pose, reverse: bool = False) -> tuple[Segment, ...]:
        """Return a turn towards the position, the line to it, and the turn to the heading."""
        toward_rad = start.heading_rad
        if start.point != self.point:
            toward_rad = start.point.bearing_rad(self.point)
        backward = reverse and abs(wrap_rad(toward_rad - start.heading_rad)) > pi / 2
        if backward:
            toward_rad = wrap_rad(toward_rad + pi)
        turn = _turn_to(toward_rad, start, Reference.NEXT_LINE)
        end = replace(turn.end, x_m=self.x_m, y_m=self.y_m)
        by_m = start.point.distance_m(self.point) * (-1.0 if backward else 1.0)
        line = Line(turn.end, end, by_m, Reference.FRAME, self.tolerance_m)
        if self.heading_rad is None:
            return turn, line
        return turn, line, _turn_to(self.heading_rad, end, Reference.FRAME)


def _turn_to(heading_rad: float, start: Pose, reference: Reference) -> Turn:
    by_rad = wrap_rad(heading_rad - start.heading_rad)
    return Turn(start, replace(start, heading_rad=heading_rad), by_rad, reference)


_CONTROLLER: Final = "controller of the motion; default: the asset's own"
_FRAME: Final = "frame of the waypoints; default: the asset's own"


@command(
    Family.MOTION,
    "MotionControl.moveTo",
    examples=("3 2 --heading 90deg", "3 2 --controller mpc", "3 2 --frame map", "-1 0.5 --replace"),
)
class MoveTo:
    """Turn towards a target, drive there, turn to its heading."""

    target: Waypoint
    controller: Controller | None = argument(help=_CONTROLLER, relayed=False, default=None)
    frame: TargetFrame | None = argument(help=_FRAME, relayed=False, default=None)

    def moved(self, origin: Pose) -> "MoveTo":
        """Return the motion in the odometry frame, given the origin of its own frame there."""
        return replace(self, target=self.target.moved(origin), frame=TargetFrame.ODOM)

    def segments(self, start: Pose, reverse: bool = False) -> tuple[Segment, ...]:
        """See the module."""
        return self.target.segments(start, reverse)


@command(Family.MOTION, "MotionControl.moveForward", examples=("1.5", "-50cm --replace"))
class MoveForward:
    """Drive straight."""

    distance_m: float = argument(bounded("drive.distance_m"), "negative is backward")

    def segments(self, start: Pose, reverse: bool = False) -> tuple[Segment, ...]:
        """See the module."""
        point = start.ahead(self.distance_m)
        end = replace(start, x_m=point.x_m, y_m=point.y_m)
        return (Line(start, end, self.distance_m, Reference.START),)


@command(Family.MOTION, "MotionControl.rotateTo", examples=("90deg",))
class RotateTo:
    """Turn on the spot to a heading."""

    heading_rad: float = argument(ANGLE, "absolute")

    def segments(self, start: Pose, reverse: bool = False) -> tuple[Segment, ...]:
        """See the module."""
        return (_turn_to(self.heading_rad, start, Reference.FRAME),)


@command(Family.MOTION, "MotionControl.rotateBy", examples=("-90deg",))
class RotateBy:
    """Turn on the spot by an angle."""

    angle_rad: float = argument(ANGLE, "counter-clockwise positive")

    def segments(self, start: Pose, reverse: bool = False) -> tuple[Segment, ...]:
        """See the module."""
        end = replace(start, heading_rad=wrap_rad(start.heading_rad + self.angle_rad))
        return (Turn(start, end, self.angle_rad, Reference.START),)


@command(Family.MOTION, "MotionControl.drive", name="drive", examples=("0.2 0 5", "0 -20deg/s 4s"))
class DriveFor:
    """Hold a velocity for a time, then stop."""

    travel_mps: float = argument(bounded("drive.travel_speed_mps"))
    rotate_radps: float = argument(bounded("drive.rotate_speed_radps"))
    duration_s: float = argument(bounded(0.0, "drive.duration_s"))

    def segments(self, start: Pose, reverse: bool = False) -> tuple[Segment, ...]:
        """See the module."""
        return (Arc(start, Velocity(self.travel_mps, self.rotate_radps), self.duration_s),)


@command(
    Family.MOTION,
    "MotionControl.followPath",
    examples=("1,0 1,1,90deg -1,0", "1,0,,0.1 1,1,90deg,0.05"),
)
class FollowPath:
    """Reach waypoints in order."""

    waypoints: tuple[Waypoint, ...] = argument(bounded(1, "drive.path_waypoints"))
    controller: Controller | None = argument(help=_CONTROLLER, relayed=False, default=None)
    frame: TargetFrame | None = argument(help=_FRAME, relayed=False, default=None)

    def moved(self, origin: Pose) -> "FollowPath":
        """Return the motion in the odometry frame, given the origin of its own frame there."""
        waypoints = tuple(each.moved(origin) for each in self.waypoints)
        return replace(self, waypoints=waypoints, frame=TargetFrame.ODOM)

    def segments(self, start: Pose, reverse: bool = False) -> tuple[Segment, ...]:
        """See the module."""
        segments: tuple[Segment, ...] = ()
        for each in self.waypoints:
            segments += each.segments(start, reverse)
            start = segments[-1].end
        return segments


@command(Family.STOP, "MotionControl.stop", examples=("",))
class Stop:
    """Stop immediately, end every goal, and hold until a `resume`."""


@command(Family.RESUME, "MotionControl.resume", examples=("",))
class Resume:
    """Release the rover after a stop, or after a fault that has cleared."""


@command(Family.SETTING, "MotionControl.setTravelSpeed", examples=("0.5",))
class SetTravelSpeed:
    """Set the maximum linear speed."""

    speed_mps: float = argument(bounded(MIN_SPEED, "drive.travel_speed_mps"))


@command(Family.SETTING, "MotionControl.setRotateSpeed", examples=("30deg/s",))
class SetRotateSpeed:
    """Set the maximum angular speed."""

    speed_radps: float = argument(bounded(MIN_SPEED, "drive.rotate_speed_radps"))


@command(Family.POSE, "MotionControl.setPositionCompensation", examples=("0.1 -0.2 0 5deg",))
class SetPositionCompensation:
    """Set the offset that is added to the measured pose before it is used and reported."""

    x_m: float = argument(bounded("drive.compensation_m"))
    y_m: float = argument(bounded("drive.compensation_m"))
    z_m: float = argument(bounded("drive.compensation_m"))
    heading_rad: float = argument(ANGLE)


@command(Family.CONFIRMATION, "MotionControl.confirmPose", examples=("0.1 3deg", "0 0"))
class ConfirmPose:
    """Confirm the reported pose, after checking it; a resume does not confirm it."""

    position_m: float = argument(bounded(0.0, 100.0), "remaining uncertainty")
    heading_rad: float = argument(bounded(0.0, pi), "remaining uncertainty")


@command(
    Family.CAMERA, "Camera.setAngles", at_least_one=True, examples=("--pan -45deg --tilt 10deg",)
)
class SetCameraAngles:
    """Point the camera; an omitted axis stays as it is."""

    pan_rad: float | None = argument(
        bounded("camera.pan_min_rad", "camera.pan_max_rad"),
        "counter-clockwise positive",
        default=None,
    )
    tilt_rad: float | None = argument(
        bounded("camera.tilt_min_rad", "camera.tilt_max_rad"), "upward positive", default=None
    )


@command(Family.CAMERA, "Camera.moveAngles", at_least_one=True, examples=("--pan 10deg",))
class MoveCameraAngles:
    """Turn the camera relative to its direction when the command starts."""

    pan_rad: float = argument(
        SymmetricRange("camera.pan_min_rad", "camera.pan_max_rad"), "counter-clockwise positive"
    )
    tilt_rad: float = argument(
        SymmetricRange("camera.tilt_min_rad", "camera.tilt_max_rad"), "upward positive"
    )


@command(Family.SETTING, "Camera.setRotateSpeed", examples=("30deg/s",))
class SetCameraRotateSpeed:
    """Set the maximum angular speed of the camera."""

    speed_radps: float = argument(bounded(MIN_SPEED, "camera.rotate_speed_radps"))


@command(
    Family.CAMERA,
    "Camera.takePicture",
    part="settings",
    examples=("", "--format PNG", "--width 640 --height 480 --quality 80"),
)
class TakePicture:
    """Take a picture and store it aboard; omitted arguments keep the camera's settings."""

    width_px: int | None = argument(
        AssetChoice("camera.width_px"), choices=range(1, 65536), default=None
    )
    height_px: int | None = argument(
        AssetChoice("camera.height_px"), choices=range(1, 65536), default=None
    )
    format: str | None = argument(
        AssetChoice("camera.formats"), choices=("JPG", "PNG", "RAW"), default=None
    )
    quality: int | None = argument(AssetChoice(None), choices=range(1, 101), default=None)


@command(Family.SETTING, "Status.setStatusInterval", examples=("2",))
class SetStatusInterval:
    """Set the interval of telemetry."""

    interval_s: float = argument(
        bounded(0.05, 3600.0, or_zero=True), "0: telemetry is sent on change only"
    )


@command(Family.INSTANT, "FileManagement.delete", examples=("pictures/MOE-1.jpg",))
class DeleteFile:
    """Delete a file aboard; `rover files list` lists the files."""

    path: str = argument(PATH, "file, relative to the monitored folder")


@command(Family.INSTANT, "FileManagement.move", examples=("pictures/MOE-1.jpg kept/rock.jpg",))
class MoveFile:
    """Move a file aboard to another path."""

    path: str = argument(PATH, "file, relative to the monitored folder")
    target: str = argument(PATH, "new path, not yet in use")


@command(Family.INSTANT, "Action.execute")
class ExecuteAction:
    """Execute an action given as one line of text."""

    action: str = argument(help="one line of text, such as VIDEO ON")


@dataclass(frozen=True, slots=True)
class PlanArgument:
    """A value for a plan, which its nodes read as `{name}`; the text is as in XML."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class PlanDefinition:
    """A plan as submitted.

    Attributes:
        format: format of the content; `BTCPP4` is supported.
        content: the octets of the text.
    """

    plan_id: str
    name: str
    format: str
    content: bytes
    arguments: tuple[PlanArgument, ...] = ()


@command(Family.PLAN, "Plan.submitPlan")
class SubmitPlan:
    """Check a whole plan and store it."""

    plan: PlanDefinition


@command(Family.PLAN_START, "Plan.activatePlan")
class ActivatePlan:
    """Activate a plan, which then controls the rover."""

    plan_id: str


@command(Family.PLAN, "Plan.suspendPlan")
class SuspendPlan:
    """Suspend a plan until it is resumed."""

    plan_id: str


@command(Family.PLAN_START, "Plan.resumePlan")
class ResumePlan:
    """Continue a suspended plan, at its interrupted step or at a later one."""

    plan_id: str
    step: str | None = argument(
        help="name of the step; those before it are skipped", relayed=False, default=None
    )


@command(Family.PLAN, "Plan.skipNode")
class SkipNode:
    """Let a node of a plan end without running it; its commands are cancelled."""

    plan_id: str
    node: str = argument(help="path of the node, or the end of it")
    result: str = argument(choices=("SUCCESS", "FAILURE"))


@command(Family.PLAN, "Plan.retryNode")
class RetryNode:
    """Let a node of a plan that is running begin again; its commands are cancelled."""

    plan_id: str
    node: str = argument(help="path of the node, or the end of it")


@command(Family.PLAN, "Plan.holdAtNode")
class HoldAtNode:
    """Suspend a plan before a node begins."""

    plan_id: str
    node: str = argument(help="path of the node, or the end of it")


@command(Family.PLAN, "Plan.answerQuestion")
class AnswerQuestion:
    """Answer a question of a plan, also in advance; the first answer counts."""

    plan_id: str
    question: str = argument(help="path of the question, or the end of it")
    option: str


@command(Family.PLAN, "Plan.abortPlan")
class AbortPlan:
    """End a plan permanently."""

    plan_id: str


@command(Family.PLAN, "Plan.removePlan")
class RemovePlan:
    """Remove a plan that has ended or never started."""

    plan_id: str


TargetCommand = MoveTo | MoveForward | RotateTo | RotateBy | FollowPath
Motion = TargetCommand | DriveFor
CameraPointing = SetCameraAngles | MoveCameraAngles
CameraWork = CameraPointing | TakePicture
InstantCommand = DeleteFile | MoveFile | ExecuteAction
Setting = (
    SetTravelSpeed
    | SetRotateSpeed
    | SetPositionCompensation
    | SetCameraRotateSpeed
    | SetStatusInterval
)
PlanSteering = SkipNode | RetryNode | HoldAtNode | AnswerQuestion
PlanRequest = (
    SubmitPlan
    | ActivatePlan
    | SuspendPlan
    | ResumePlan
    | AbortPlan
    | RemovePlan
    | SkipNode
    | RetryNode
    | HoldAtNode
    | AnswerQuestion
)
Request = Motion | CameraWork | InstantCommand | Setting | ConfirmPose | PlanRequest | Stop | Resume


def is_absolute(request: Request) -> bool:
    """Whether a request is a motion to a target in the odometry frame."""
    return isinstance(request, Motion) and any(
        each.reference is Reference.FRAME for each in request.segments(Pose())
    )


def requested_controller(request: Request, default: Controller) -> Controller | None:
    """Return the controller of a request; None if it uses none.

    Args:
        request: selects a controller, or leaves the choice to the asset.
        default: the asset's own controller.
    """
    match request:
        case MoveTo(controller=chosen) | FollowPath(controller=chosen):
            return chosen or default
        case _:
            return None


DIRECT_LINK: Final = "direct"
"""Link of commands from the ground itself."""
RELAY_LINK: Final = "relay"
"""Link of commands that the orbiter forwards, under its own authority."""
GROUND_LINKS: Final = frozenset({DIRECT_LINK, RELAY_LINK})
"""Links from the ground."""
PLAN_LINK: Final = "plan"
"""Link of commands of a plan."""
ROS_LINK: Final = "ros"
"""Link of commands of ROS clients; any node of the ROS domain can use it."""
ROS_SOURCE: Final = "ROS"
"""Source of all commands of ROS clients."""
ABOARD_LINK: Final = "aboard"
"""Link of commands of the executive itself."""
OWN_LINKS: Final = frozenset({PLAN_LINK, ABOARD_LINK})
"""Links of commands without an external sender."""


class PreemptionPolicy(Enum):
    """Effect of a motion command on running and queued motion."""

    APPEND = "append"
    REPLACE = "replace"


@dataclass(frozen=True, slots=True)
class Command:
    """A request with its identity, its lifetime, and the link over which it was received.

    Attributes:
        created_utc_s: creation time by its source, seconds since 1970-01-01 UTC.
        lifetime_s: seconds from `created_utc_s` (from arrival, if that is None) after which
            it must not start.
        preemption: its effect on running motion.
        authority: the epoch of the authority that its sender claims; None for no claim.
        peer: name of the sender as authenticated by the link; None without authentication.
        overtaken: whether the link knows that a stop created after it has arrived.
        precondition: further conditions of its execution; ignored for a stop.
    """

    identity: Identity
    request: Request
    link: str
    created_utc_s: float | None = None
    lifetime_s: float | None = None
    counter: int | None = None
    report_started: bool = True
    report_progress: bool = True
    preemption: PreemptionPolicy = PreemptionPolicy.APPEND
    authority: int | None = None
    peer: str | None = None
    overtaken: bool = False
    precondition: Precondition | None = None

    @property
    def name(self) -> str:
        """The request's name, as the user types it."""
        return declaration_of(type(self.request)).name
