"""Ports of the core as Protocols: adapters implement rovers (`VelocityRover`), video and links."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

from executive.values.geometry import Pose, TargetFrame, Velocity
from executive.values.parameters import ParameterValue
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report


@dataclass(frozen=True, slots=True)
class TurnBy:
    """Turn on the spot by an angle, counter-clockwise positive."""

    angle_rad: float
    speed_radps: float


@dataclass(frozen=True, slots=True)
class DriveBy:
    """Drive straight; a negative distance drives backward."""

    distance_m: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class VelocityHold:
    """Hold a velocity for a time, then stop."""

    velocity: Velocity
    duration_s: float


@dataclass(frozen=True, slots=True)
class DelegatedMotion:
    """A motion that a rover executes by itself, from standstill to standstill.

    Attributes:
        number: counts from 1 in one process; the rover's answer carries it.
        command: the command that the motion is a part of.
    """

    number: int
    primitive: TurnBy | DriveBy | VelocityHold
    command: Identity


@dataclass(frozen=True, slots=True)
class NavigateTo:
    """Go to poses in order, m and rad; the navigation plans the path between them.

    Attributes:
        frame: frame of the poses.
    """

    poses: tuple[Pose, ...]
    frame: TargetFrame


@dataclass(frozen=True, slots=True)
class NavigationGoal:
    """A goal of a navigation server.

    Attributes:
        number: counts from 1 in one process; the facts of the goal carry it.
        task: poses, or a relative action (Nav2: spin, drive_on_heading).
        command: the command that the goal is a part of.
    """

    number: int
    task: NavigateTo | TurnBy | DriveBy
    command: Identity


@dataclass(frozen=True, slots=True)
class PathRequest:
    """A request to the planner of the navigation.

    Attributes:
        number: counts from 1, apart from the numbers of goals; the answer carries it.
        frame: frame of start and goal.
    """

    number: int
    start: Pose
    goal: Pose
    frame: TargetFrame


MotionIntent = Velocity | DelegatedMotion | NavigationGoal


@dataclass(frozen=True, slots=True)
class CameraIntent:
    """Angles to point the camera at.

    Attributes:
        speed_radps: maximum angular speed.
        command: the command that the intent serves; None without one.
    """

    pan_rad: float
    tilt_rad: float
    speed_radps: float
    command: Identity | None = None


class Rover(Protocol):
    """The actuators that every asset has. Only `executive.motion.arbiter` calls it."""

    def point_camera(self, wanted: CameraIntent) -> None:
        """Command the camera's angles, and its maximum angular speed."""

    def request_frame(self) -> None:
        """Request the next camera frame, which arrives as a fact `Frame`."""

    def emergency_stop(self) -> None:
        """Stop the rover immediately. May be called from any thread, and never blocks.

        If the base has a mux, this also sets its lock.
        """

    def lock(self, held: bool) -> None:
        """Hold or release the mux lock, if the base has a mux. Called once a tick."""


@runtime_checkable
class VelocityRover(Rover, Protocol):
    """A rover that is driven by velocity commands."""

    def drive(self, velocity: Velocity) -> None:
        """Command a velocity of base_link; it holds until the next call or the rover's timeout."""


@runtime_checkable
class DelegatedMotionRover(Rover, Protocol):
    """A rover that executes whole motions by itself, and reports their end as `MotionEnded`."""

    def execute_motion(self, motion: DelegatedMotion) -> None:
        """Start a motion, replacing the running one."""

    def halt(self) -> None:
        """Stop, and hold zero velocity."""


PLANNER_WAIT_S: Final = 2.0
"""Maximum time to wait for the paths of a leg or of a preview; chosen, not measured."""


@runtime_checkable
class NavigationRover(VelocityRover, Protocol):
    """A rover with a navigation behind a gate: its velocity reaches the base while that is open.

    No method waits. Facts answer: `NavigationStatus`, `NavigationFeedback`, `NavigationVelocity`,
    `PlannedPath`.
    """

    def navigate(self, goal: NavigationGoal) -> None:
        """Send the goal to the server under a new UUID, also if its number is repeated."""

    def cancel_navigation(self) -> None:
        """Cancel all goals of the servers, of any client.

        An acceptance that arrives later, of a goal that was sent before, is cancelled, too.
        """

    def open_gate(self, is_open: bool) -> None:
        """Open or shut the gate. Called once a tick; `emergency_stop` shuts it, too."""

    def plan_path(self, request: PathRequest) -> None:
        """Request a path of the planner; `PlannedPath` answers."""


class Video(Protocol):
    """Forwarder of the camera's video stream to the ground."""

    @property
    def enabled(self) -> bool:
        """Whether the stream is forwarded."""

    def set_enabled(self, on: bool) -> None:
        """Start or stop forwarding.

        Raises:
            OSError: the stream cannot be switched.
        """


class Downlink(Protocol):
    """An outgoing link. Called on the core's thread: must neither block nor raise."""

    def send_reports(self, reports: Sequence[Report]) -> None:
        """Send reports after their commit: those of one commit, in order."""

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Send parameter values."""

    def send_file_event(self, event: FileEvent) -> None:
        """Send a file event."""

    def send_plan_update(self, update: PlanUpdate) -> None:
        """Send the status of a plan after its commit."""
