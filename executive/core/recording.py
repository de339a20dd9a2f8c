"""Dataclasses of the items of a recording: the core's inputs in order, and its decisions.

With the same inputs, the core makes the same decisions. A recording is a sequence of items: a
`ProcessStart` for each start of the executive, then its entries. Each entry is followed by the
further inputs and the decisions during it. Within an entry the clock is latched.
"""

from dataclasses import dataclass
from enum import Enum, unique
from typing import Protocol, TypeGuard

from executive.commands import Command, Mode
from executive.core.authority import AuthorityRequest
from executive.core.ros_clients import CancelRequest
from executive.motion import MotionState, Trajectory, TrajectoryTarget
from executive.settings import Settings
from executive.values.facts import Fact
from executive.values.geometry import Pose, Velocity
from executive.values.parameters import ParameterValue
from executive.values.ports import CameraIntent, DelegatedMotion, NavigationGoal, PathRequest
from executive.values.reasons import Figure, Refusal
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, ReportKind, Severity


@dataclass(frozen=True, slots=True)
class StoredFile:
    """A file in the rover's folder; its content affects no decision."""

    path: str
    size_octets: int


@dataclass(frozen=True, slots=True)
class ProcessStart:
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
    files: tuple[StoredFile, ...]
    solver_lead_ticks: int | None
    video: bool


@unique
class CoreCall(Enum):
    """A call of the core with the time as its only input."""

    START = "start"
    SERVE = "serve"
    TICK = "tick"
    CLOSE = "close"


@dataclass(frozen=True, slots=True)
class CoreCalled:
    """An entry with the time as its input; `START` is the first of a process start.

    Attributes:
        now_s: the latched monotonic clock.
        utc_s: the latched wall clock, seconds since 1970-01-01 UTC.
    """

    now_s: float
    utc_s: float
    call: CoreCall


@dataclass(frozen=True, slots=True)
class FactObserved:
    """An entry with a fact as its input."""

    now_s: float
    utc_s: float
    fact: Fact


@dataclass(frozen=True, slots=True)
class EventReported:
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
class SafeModeEntered:
    """An entry that stops the rover until resumed.

    Attributes:
        within: as in `EventReported`.
    """

    now_s: float
    utc_s: float
    cause: Refusal
    within: bool = False


Entry = CoreCalled | FactObserved | EventReported | SafeModeEntered


def is_within(item: object) -> TypeGuard[EventReported | SafeModeEntered]:
    """Whether an item is part of the call before, although others of its kind are calls."""
    return isinstance(item, EventReported | SafeModeEntered) and item.within


@dataclass(frozen=True, slots=True)
class CommandDequeued:
    """A command that was removed from the inbox.

    Attributes:
        overtaken: whether a later stop had been served before it.
    """

    command: Command
    overtaken: bool


@dataclass(frozen=True, slots=True)
class GroundContact:
    """The ground link was in contact since the last entry that checked for it."""


@dataclass(frozen=True, slots=True)
class SolverResult:
    """The result that the trajectory solver returned when polled."""

    trajectory: Trajectory | None


@dataclass(frozen=True, slots=True)
class SolverBusy:
    """Whether the trajectory solver was busy when queried."""

    busy: bool


@dataclass(frozen=True, slots=True)
class StopPending:
    """A stop was received while the core was working.

    Attributes:
        checks: number of earlier checks for a stop in this entry.
    """

    checks: int


@dataclass(frozen=True, slots=True)
class LedgerBehind:
    """The ledger's writer had not committed everything when it was polled.

    Attributes:
        polls: number of earlier polls in this entry.
        durable: number of the last batch that was committed.
        error: error of the last attempt; empty without one.
        behind: number of batches that were not committed; None in older recordings. A replay
            numbers its batches otherwise if a link wrote to the ledger before the start.
    """

    polls: int
    durable: int
    error: str
    behind: int | None = None


@dataclass(frozen=True, slots=True)
class EmergencyStopped:
    """A stop was submitted, and stopped the rover at once; the core's thread dequeues it later."""


Input = (
    CommandDequeued
    | GroundContact
    | SolverResult
    | SolverBusy
    | StopPending
    | AuthorityRequest
    | CancelRequest
    | LedgerBehind
    | EmergencyStopped
)
"""Inputs received during an entry."""


@dataclass(frozen=True, slots=True)
class VelocityCommanded:
    """The velocity that was commanded."""

    velocity: Velocity


@dataclass(frozen=True, slots=True)
class MotionCommanded:
    """The whole motion that was commanded."""

    motion: DelegatedMotion


@dataclass(frozen=True, slots=True)
class HaltCommanded:
    """The rover was commanded to halt."""


@dataclass(frozen=True, slots=True)
class MuxLockChanged:
    """The mux lock was held or released; recorded on change."""

    held: bool


@dataclass(frozen=True, slots=True)
class NavigationCommanded:
    """The goal that was sent to the navigation."""

    goal: NavigationGoal


@dataclass(frozen=True, slots=True)
class NavigationCancelled:
    """All goals of the navigation were cancelled."""


@dataclass(frozen=True, slots=True)
class NavigationGateChanged:
    """The gate of the navigation's velocity was opened or shut; recorded on change."""

    is_open: bool


@dataclass(frozen=True, slots=True)
class PathRequested:
    """A path that was requested of the navigation's planner."""

    request: PathRequest


@dataclass(frozen=True, slots=True)
class CameraCommanded:
    """The camera was commanded to point."""

    intent: CameraIntent


@dataclass(frozen=True, slots=True)
class FrameRequested:
    """A picture was requested."""


@dataclass(frozen=True, slots=True)
class VideoSwitched:
    """The video stream was switched on or off."""

    enabled: bool


@dataclass(frozen=True, slots=True)
class SolverRequested:
    """A trajectory was requested; the digest covers the whole problem."""

    start: MotionState
    target: TrajectoryTarget
    digest: str


@dataclass(frozen=True, slots=True)
class ReportSent:
    """A report was sent after its commit."""

    report: Report


@dataclass(frozen=True, slots=True)
class TelemetrySent:
    """Parameters were sent."""

    values: tuple[ParameterValue, ...]


@dataclass(frozen=True, slots=True)
class FileEventSent:
    """A file event was sent."""

    event: FileEvent


@dataclass(frozen=True, slots=True)
class PlanUpdateSent:
    """The status of a plan was sent."""

    update: PlanUpdate


@dataclass(frozen=True, slots=True)
class SubmitAnswered:
    """The reply to the sender of a command.

    Attributes:
        result: Accepted, Rejected or Duplicate.
    """

    identity: Identity
    result: str
    refusal: Refusal | None


@dataclass(frozen=True, slots=True)
class TreeNodeState:
    """Status and feedback message of a tree node in the last tick."""

    path: str
    status: str
    message: str


@dataclass(frozen=True, slots=True)
class TreeChanged:
    """Nodes that changed, including new ones, and nodes that were removed."""

    nodes: tuple[TreeNodeState, ...]
    removed: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """A change of the mode, of the active command, or of the text of `why` without its figures.

    Attributes:
        why: one line on the rover's present motion and its reason.
        fault: name of the fault that holds the rover, if any.
        cause: the stop that holds the rover, if any.
    """

    mode: Mode
    active: Identity | None
    why: str
    fault: str | None = None
    cause: Identity | None = None


Decision = (
    VelocityCommanded
    | MotionCommanded
    | HaltCommanded
    | MuxLockChanged
    | NavigationCommanded
    | NavigationCancelled
    | NavigationGateChanged
    | PathRequested
    | CameraCommanded
    | FrameRequested
    | VideoSwitched
    | SolverRequested
    | ReportSent
    | TelemetrySent
    | FileEventSent
    | PlanUpdateSent
    | SubmitAnswered
    | TreeChanged
    | ModeChanged
)


@dataclass(frozen=True, slots=True)
class _Simulated:
    """An item known only to a simulation; the core never receives it, and a replay ignores it.

    Attributes:
        time_s: time on the monotonic clock of the core; of another process that of the reception.
    """

    time_s: float


@dataclass(frozen=True, slots=True)
class Truth(_Simulated):
    """The rover's true pose."""

    pose: Pose


@dataclass(frozen=True, slots=True)
class SimulationStarted(_Simulated):
    """The simulation began, with a world, seed and accuracy in the format of worlds."""

    text: str


@dataclass(frozen=True, slots=True)
class TimelineStarted(_Simulated):
    """The timeline of a scenario began, with entries in the format of scenarios."""

    text: str


@dataclass(frozen=True, slots=True)
class TimelinePlayed(_Simulated):
    """The entry of the timeline at an index from 0 was carried out, e.g. a command was sent."""

    index: int


@dataclass(frozen=True, slots=True)
class SimulatedFaultChanged(_Simulated):
    """A fault of the simulation was injected or cleared.

    Attributes:
        text: the fault and its parameters, in the format of scenarios; its name if it was cleared.
    """

    injected: bool
    text: str


@dataclass(frozen=True, slots=True)
class CargoChanged(_Simulated):
    """The mass of the simulated rover's cargo changed."""

    mass_kg: float


@dataclass(frozen=True, slots=True)
class ExecutiveKilled(_Simulated):
    """The executive was ended as by kill -9; a `ProcessStart` follows if it was started again."""


@dataclass(frozen=True, slots=True)
class LinkDarkChanged(_Simulated):
    """Messages between ground and rover were lost from now on, or passed again."""

    dark: bool


@dataclass(frozen=True, slots=True)
class SimulationState(_Simulated):
    """A checkpoint of the simulated rover, in a format that the simulation defines."""

    text: str


SimulationItem = (
    Truth
    | SimulationStarted
    | TimelineStarted
    | TimelinePlayed
    | SimulatedFaultChanged
    | CargoChanged
    | ExecutiveKilled
    | LinkDarkChanged
    | SimulationState
)
Item = ProcessStart | Entry | Input | Decision | SimulationItem


class RecordingSink(Protocol):
    """Receives a recording. Must neither block nor raise.

    Called on the core's thread, for an `EmergencyStopped` on any.
    """

    def put(self, item: Item) -> None:
        """Record an item."""


class RecordingTee:
    """Several tapes as one.

    Args:
        tapes: each receives every item, in this order.
    """

    def __init__(self, *tapes: RecordingSink) -> None:
        self._tapes = tapes

    def put(self, item: Item) -> None:
        """Record an item."""
        for tape in self._tapes:
            tape.put(item)
