"""What a recording of a run holds: all that enters the core, in its order, and what it decides.

Fed with the same inputs, the core decides the same. A recording is a sequence of items: a `Life`
for each start of the executive, then its entries, each of which is followed by what else came in
during it, and by what was decided in it. Within an entry time stands still.
"""

from dataclasses import dataclass
from enum import Enum, unique
from typing import Protocol, TypeGuard

from executive.commands import Command, Mode
from executive.core.authority import AuthorityRequest
from executive.motion import MotionState, Trajectory, TrajectoryTarget
from executive.settings import Settings
from executive.values.facts import Fact
from executive.values.geometry import Pose, Velocity
from executive.values.parameters import ParameterValue
from executive.values.ports import CameraIntent, WholeMotion
from executive.values.reasons import Figure, Refusal
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, ReportKind, Severity


@dataclass(frozen=True, slots=True)
class KeptFile:
    """A file that lies in the folder of the rover; its content decides nothing."""

    path: str
    size_octets: int


@dataclass(frozen=True, slots=True)
class Life:
    """What the executive of one process begins with.

    Attributes:
        ledger: the file of the ledger, as it was before.
        latch: the file of the stop latch; empty if there was none.
        files: what lies in the folder of files.
        solver_lead_ticks: that of what plans motion; None where nothing does.
        video: whether its video is there.
    """

    settings: Settings
    ledger: bytes
    latch: bytes
    files: tuple[KeptFile, ...]
    solver_lead_ticks: int | None
    video: bool


@unique
class Call(Enum):
    """A call of the core that brings nothing but the time."""

    START = "start"
    TURN = "turn"
    TICK = "tick"
    CLOSE = "close"


@dataclass(frozen=True, slots=True)
class Called:
    """An entry that brings the time; `START` is the first of a life.

    Attributes:
        now_s: the monotonic clock that all within sees.
        utc_s: the wall clock that all within sees, seconds since 1970-01-01 UTC.
    """

    now_s: float
    utc_s: float
    call: Call


@dataclass(frozen=True, slots=True)
class Observed:
    """An entry that brings a fact."""

    now_s: float
    utc_s: float
    fact: Fact


@dataclass(frozen=True, slots=True)
class Noticed:
    """An entry that has something reported that another component noticed.

    Attributes:
        within: whether it is a part of the call before: a question of another thread reported it.
    """

    now_s: float
    utc_s: float
    severity: Severity
    text: str
    figures: tuple[Figure, ...]
    kind: ReportKind
    within: bool = False


@dataclass(frozen=True, slots=True)
class MadeSafe:
    """An entry that has the rover stand until resumed.

    Attributes:
        within: as of `Noticed`.
    """

    now_s: float
    utc_s: float
    danger: Refusal
    within: bool = False


Entry = Called | Observed | Noticed | MadeSafe


def is_within(item: object) -> TypeGuard[Noticed | MadeSafe]:
    """Return whether an item is a part of the call before, though others of its kind are calls."""
    return isinstance(item, Noticed | MadeSafe) and item.within


@dataclass(frozen=True, slots=True)
class Served:
    """A command that was taken from the queue.

    Attributes:
        overtaken: whether a stop was taken before that had come after it.
    """

    command: Command
    overtaken: bool


@dataclass(frozen=True, slots=True)
class GroundHeard:
    """There was a sign of the ground since the last entry that looked for one."""


@dataclass(frozen=True, slots=True)
class SolverAnswered:
    """What the solver of motion plans answered when it was asked for an answer."""

    plan: Trajectory | None


@dataclass(frozen=True, slots=True)
class SolverBusy:
    """Whether the solver of motion plans was at a question, when that was asked."""

    busy: bool


@dataclass(frozen=True, slots=True)
class StopWaited:
    """A stop came while the core was at work.

    Attributes:
        looks: how often the core had looked for one in this entry before.
    """

    looks: int


@dataclass(frozen=True, slots=True)
class CommitFailed:
    """The ledger could not be written.

    Attributes:
        commits: how often the core had committed in this entry before.
        text: why.
    """

    commits: int
    text: str


Input = (
    Served
    | GroundHeard
    | SolverAnswered
    | SolverBusy
    | StopWaited
    | AuthorityRequest
    | CommitFailed
)
"""What comes in during an entry."""


@dataclass(frozen=True, slots=True)
class Drove:
    """The velocity that the rover was commanded."""

    velocity: Velocity


@dataclass(frozen=True, slots=True)
class CarriedOut:
    """The whole motion that the rover was to carry out."""

    motion: WholeMotion


@dataclass(frozen=True, slots=True)
class Halted:
    """The rover was to stand."""


@dataclass(frozen=True, slots=True)
class Locked:
    """The lock of the mux was taken, or released; recorded when that changes."""

    held: bool


@dataclass(frozen=True, slots=True)
class PointedCamera:
    """The camera was to point there."""

    wanted: CameraIntent


@dataclass(frozen=True, slots=True)
class RequestedFrame:
    """A picture was asked for."""


@dataclass(frozen=True, slots=True)
class SwitchedVideo:
    """The video stream was switched on or off."""

    on: bool


@dataclass(frozen=True, slots=True)
class AskedSolver:
    """A motion plan was asked for; the digest is of all that the solver was told."""

    start: MotionState
    target: TrajectoryTarget
    digest: str


@dataclass(frozen=True, slots=True)
class Reported:
    """A report left, once it was written down."""

    report: Report


@dataclass(frozen=True, slots=True)
class ToldParameters:
    """Parameters were sent."""

    values: tuple[ParameterValue, ...]


@dataclass(frozen=True, slots=True)
class ToldFile:
    """What happened to a file was sent."""

    event: FileEvent


@dataclass(frozen=True, slots=True)
class ToldPlan:
    """How far a plan has come was sent."""

    update: PlanUpdate


@dataclass(frozen=True, slots=True)
class Answered:
    """Who submitted a command was told what became of it.

    Attributes:
        result: Admitted, Refused or Repeated.
    """

    identity: Identity
    result: str
    refusal: Refusal | None


@dataclass(frozen=True, slots=True)
class NodeState:
    """What a node of the tree did in the last tick, and what it says of itself."""

    path: str
    status: str
    message: str


@dataclass(frozen=True, slots=True)
class TreeChanged:
    """The nodes that are other than before, those that are new among them, and those that went."""

    nodes: tuple[NodeState, ...]
    gone: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """The mode, the command under way or the words of why, figures apart, are other than before.

    Attributes:
        why: one line on why the rover stands, or what moves it.
    """

    mode: Mode
    active: Identity | None
    why: str


Decision = (
    Drove
    | CarriedOut
    | Halted
    | Locked
    | PointedCamera
    | RequestedFrame
    | SwitchedVideo
    | AskedSolver
    | Reported
    | ToldParameters
    | ToldFile
    | ToldPlan
    | Answered
    | TreeChanged
    | ModeChanged
)


@dataclass(frozen=True, slots=True)
class Truth:
    """Where the rover truly was, as only a simulation knows; the core never learns of it.

    Attributes:
        time_s: on the monotonic clock of the core.
    """

    time_s: float
    pose: Pose


Item = Life | Entry | Input | Decision | Truth


class Tape(Protocol):
    """Takes a recording. Called on the core's thread: must neither block nor raise."""

    def put(self, item: Item) -> None:
        """Record the next item."""


class Tapes:
    """Several tapes as one.

    Args:
        tapes: each takes every item, in this order.
    """

    def __init__(self, *tapes: Tape) -> None:
        self._tapes = tapes

    def put(self, item: Item) -> None:
        """Record the next item."""
        for tape in self._tapes:
            tape.put(item)
