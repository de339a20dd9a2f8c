"""Items of a recording: all inputs of the core in order, and its decisions.

With the same inputs, the core makes the same decisions. A recording is a sequence of items: a
`Life` for each start of the executive, then its entries. Each entry is followed by the further
inputs and the decisions during it. Within an entry the clock is latched.
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
    """A file in the rover's folder; its content affects no decision."""

    path: str
    size_octets: int


@dataclass(frozen=True, slots=True)
class Life:
    """Initial state of one start of the executive's process.

    Attributes:
        ledger: content of the ledger file before the start.
        latch: content of the stop latch file; empty if there was none.
        files: content of the monitored folder.
        solver_lead_ticks: lead of the trajectory solver in ticks; None without a solver.
        video: whether the asset has a video port.
    """

    settings: Settings
    ledger: bytes
    latch: bytes
    files: tuple[KeptFile, ...]
    solver_lead_ticks: int | None
    video: bool


@unique
class Call(Enum):
    """A call of the core with the time as its only input."""

    START = "start"
    TURN = "turn"
    TICK = "tick"
    CLOSE = "close"


@dataclass(frozen=True, slots=True)
class Called:
    """An entry with the time as its input; `START` is the first of a process start.

    Attributes:
        now_s: the latched monotonic clock.
        utc_s: the latched wall clock, seconds since 1970-01-01 UTC.
    """

    now_s: float
    utc_s: float
    call: Call


@dataclass(frozen=True, slots=True)
class Observed:
    """An entry with a fact as its input."""

    now_s: float
    utc_s: float
    fact: Fact


@dataclass(frozen=True, slots=True)
class Noticed:
    """An entry that reports an event of another component.

    Attributes:
        within: whether it is part of the call before: a query of another thread reported it.
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
    """An entry that stops the rover until resumed.

    Attributes:
        within: as in `Noticed`.
    """

    now_s: float
    utc_s: float
    danger: Refusal
    within: bool = False


Entry = Called | Observed | Noticed | MadeSafe


def is_within(item: object) -> TypeGuard[Noticed | MadeSafe]:
    """Whether an item is part of the call before, although others of its kind are calls."""
    return isinstance(item, Noticed | MadeSafe) and item.within


@dataclass(frozen=True, slots=True)
class Served:
    """A command that was removed from the inbox.

    Attributes:
        overtaken: whether a later stop had been served before it.
    """

    command: Command
    overtaken: bool


@dataclass(frozen=True, slots=True)
class GroundHeard:
    """The ground was in contact since the last entry that checked for it."""


@dataclass(frozen=True, slots=True)
class SolverAnswered:
    """The result that the trajectory solver returned when polled."""

    plan: Trajectory | None


@dataclass(frozen=True, slots=True)
class SolverBusy:
    """Whether the trajectory solver was busy when queried."""

    busy: bool


@dataclass(frozen=True, slots=True)
class StopWaited:
    """A stop was received while the core was working.

    Attributes:
        looks: number of earlier checks for a stop in this entry.
    """

    looks: int


@dataclass(frozen=True, slots=True)
class CommitFailed:
    """A commit of the ledger failed.

    Attributes:
        commits: number of earlier commits in this entry.
        text: the reason.
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
"""Inputs received during an entry."""


@dataclass(frozen=True, slots=True)
class Drove:
    """The velocity that was commanded."""

    velocity: Velocity


@dataclass(frozen=True, slots=True)
class CarriedOut:
    """The whole motion that was commanded."""

    motion: WholeMotion


@dataclass(frozen=True, slots=True)
class Halted:
    """The rover was commanded to halt."""


@dataclass(frozen=True, slots=True)
class Locked:
    """The mux lock was held or released; recorded on change."""

    held: bool


@dataclass(frozen=True, slots=True)
class PointedCamera:
    """The camera was commanded to point."""

    wanted: CameraIntent


@dataclass(frozen=True, slots=True)
class RequestedFrame:
    """A picture was requested."""


@dataclass(frozen=True, slots=True)
class SwitchedVideo:
    """The video stream was switched on or off."""

    on: bool


@dataclass(frozen=True, slots=True)
class AskedSolver:
    """A trajectory was requested; the digest covers the whole problem."""

    start: MotionState
    target: TrajectoryTarget
    digest: str


@dataclass(frozen=True, slots=True)
class Reported:
    """A report was sent after its commit."""

    report: Report


@dataclass(frozen=True, slots=True)
class ToldParameters:
    """Parameters were sent."""

    values: tuple[ParameterValue, ...]


@dataclass(frozen=True, slots=True)
class ToldFile:
    """A file event was sent."""

    event: FileEvent


@dataclass(frozen=True, slots=True)
class ToldPlan:
    """The status of a plan was sent."""

    update: PlanUpdate


@dataclass(frozen=True, slots=True)
class Answered:
    """The reply to the sender of a command.

    Attributes:
        result: Admitted, Refused or Repeated.
    """

    identity: Identity
    result: str
    refusal: Refusal | None


@dataclass(frozen=True, slots=True)
class NodeState:
    """Status and feedback message of a tree node in the last tick."""

    path: str
    status: str
    message: str


@dataclass(frozen=True, slots=True)
class TreeChanged:
    """Nodes that changed, including new ones, and nodes that were removed."""

    nodes: tuple[NodeState, ...]
    gone: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """A change of the mode, of the active command, or of the text of `why` without its figures.

    Attributes:
        why: one line on the rover's present motion and its reason.
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
    """The rover's true pose, known only to a simulation; the core never receives it.

    Attributes:
        time_s: time on the monotonic clock of the core.
    """

    time_s: float
    pose: Pose


Item = Life | Entry | Input | Decision | Truth


class Tape(Protocol):
    """Receives a recording. Called on the core's thread: must neither block nor raise."""

    def put(self, item: Item) -> None:
        """Record an item."""


class Tapes:
    """Several tapes as one.

    Args:
        tapes: each receives every item, in this order.
    """

    def __init__(self, *tapes: Tape) -> None:
        self._tapes = tapes

    def put(self, item: Item) -> None:
        """Record an item."""
        for tape in self._tapes:
            tape.put(item)
