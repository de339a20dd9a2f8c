"""Ports of a core that runs on a recording: inbox, ledger, solver, clock, rover."""

from collections.abc import Sequence
from functools import partial
from math import inf
from pathlib import Path
from typing import assert_never

from adapters.recording.messages import DECISIONS, encode, topic_of
from adapters.recording.run_file import RecordedMessage
from executive.commands import Stop
from executive.core.authority import AuthorityRequest
from executive.core.inbox import Inbox, Query, Submission
from executive.core.recording import (
    CommandDequeued,
    CoreCall,
    CoreCalled,
    Entry,
    EventReported,
    Input,
    Item,
    LedgerBehind,
    SafeModeEntered,
    SolverBusy,
    SolverResult,
    StopPending,
)
from executive.core.ros_clients import CancelRequest
from executive.core.runner import Executive
from executive.motion import SharedSolver, Trajectory, TrajectoryProblem
from executive.record import Ledger, LedgerError, Synchronous, WriterState


class RecordedClock:
    """Clock that returns the times of the recording."""

    def __init__(self) -> None:
        self.entry: Entry = CoreCalled(0.0, 0.0, CoreCall.START)

    def now_s(self) -> float:
        """Return the monotonic time of the present entry."""
        return self.entry.now_s

    def utc_s(self) -> float:
        """Return the wall clock time of the present entry."""
        return self.entry.utc_s


class Decisions:
    """Collects the decisions of the present entry."""

    def __init__(self) -> None:
        self.decisions: list[RecordedMessage] = []

    def put(self, item: Item) -> None:
        """Store an item if it is a decision."""
        topic = topic_of(item)
        if topic.name.startswith(DECISIONS):
            self.decisions.append(RecordedMessage(topic, encode(item)))


ReplayedItem = CommandDequeued | AuthorityRequest | CancelRequest | EventReported | SafeModeEntered
"""Items that the inbox replays: commands, and effects of queries by other threads."""


class ReplayInbox(Inbox):
    """Delivers the recorded commands and queries in order; without any, those that are put in.

    Attributes:
        core: the executive that the queries run on.
    """

    def __init__(self) -> None:
        super().__init__()
        self._script: list[ReplayedItem] = []
        self._overtaken: set[int] = set()
        self._taken = 0
        self._checks, self._stop_arrived = 0, inf
        self.core: Executive | None = None

    def load(self, inputs: Sequence[Input | Entry]) -> None:
        """Load the inputs of the next entry."""
        self._script = [each for each in inputs if isinstance(each, ReplayedItem)]
        checks = (each.checks for each in inputs if isinstance(each, StopPending))
        self._checks, self._stop_arrived = 0, next(checks, inf)

    @property
    def stop_pending(self) -> bool:
        """Whether a stop was pending at this check of the recorded run."""
        self._checks += 1
        return self._checks > self._stop_arrived or super().stop_pending

    @property
    def pending_stops(self) -> int:
        """Number of stops at the head of the script."""
        flags = [
            isinstance(e, CommandDequeued) and isinstance(e.command.request, Stop)
            for e in self._script
        ]
        scripted = flags.index(False) if False in flags else len(flags)
        return scripted or super().pending_stops

    @property
    def pending_items(self) -> int:
        """Number of other items in the script."""
        return len(self._script) - self.pending_stops if self._script else super().pending_items

    def take_stop(self) -> Submission:
        """Return the next stop."""
        return self._submission(self._script.pop(0)) if self._script else super().take_stop()

    def take(self) -> Submission | Query:
        """Return the next command, or a function with the effect of a query."""
        if not self._script:
            return super().take()
        item = self._script.pop(0)
        return (
            self._submission(item)
            if isinstance(item, CommandDequeued)
            else partial(self._run_query, item)
        )

    def superseded_by_stop(self, submission: Submission) -> bool:
        """Return whether a stop had overtaken the submission."""
        if submission.order < 0:
            return submission.order in self._overtaken
        return super().superseded_by_stop(submission)

    def _run_query(self, item: ReplayedItem) -> None:
        core = self.core
        assert core is not None
        match item:
            case AuthorityRequest():
                core.request_authority(item, lambda _: None)
            case CancelRequest():
                core.cancel(item)
            case EventReported() | SafeModeEntered():
                notice(core, item)
            case CommandDequeued():
                raise AssertionError(item)
            case _:
                assert_never(item)

    def _submission(self, served: ReplayedItem) -> Submission:
        assert isinstance(served, CommandDequeued)
        self._taken -= 1
        if served.overtaken:
            self._overtaken.add(self._taken)
        return Submission(self._taken, served.command, lambda _: None, lambda: None)


def notice(core: Executive, item: EventReported | SafeModeEntered) -> None:
    """Apply to the core what another thread requested."""
    if isinstance(item, EventReported):
        core.report_event(item.severity, item.text, item.figures, item.kind)
    else:
        core.enter_safe_mode(item.cause)


class ReplayLedger(Ledger):
    """Ledger with a writer that commits at once, but reports the recorded states."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, Synchronous.NORMAL)
        self._behind: dict[int, LedgerBehind] = {}
        self._polls = 0

    def load(self, inputs: Sequence[Input | Entry]) -> None:
        """Load the states of the writer in the next entry."""
        self._behind = {e.polls: e for e in inputs if isinstance(e, LedgerBehind)}
        self._polls = 0

    def poll(self) -> WriterState:
        """Return the state at this poll of the recorded run."""
        state = super().poll()
        recorded = self._behind.get(self._polls)
        self._polls += 1
        if recorded is not None:
            error = LedgerError(recorded.error) if recorded.error else None
            behind = recorded.behind
            durable = recorded.durable if behind is None else self.sealed - behind
            self.state = state = WriterState(durable, error)
        return state


class ReplaySolver:
    """Solver that returns the recorded results."""

    def __init__(self, lead_ticks: int) -> None:
        self.lead_ticks = lead_ticks
        self._problem: TrajectoryProblem | None = None
        self._live: SharedSolver | None = None
        self._plans: list[Trajectory | None] = []
        self._busy: list[bool] = []

    def load(self, inputs: Sequence[Input | Entry]) -> None:
        """Load the results of the next entry."""
        self._plans = [each.trajectory for each in inputs if isinstance(each, SolverResult)]
        self._busy = [each.busy for each in inputs if isinstance(each, SolverBusy)]

    @property
    def busy(self) -> bool:
        """Whether the solver was busy at this check of the recorded run."""
        if self._live is not None:
            return self._live.busy
        return self._busy.pop(0) if self._busy else False

    def continue_live(self, solver: SharedSolver) -> None:
        """Let a solver solve from now on, also the pending problem."""
        self._live = solver
        if self._problem is not None:
            solver.request(self._problem)

    def request(self, problem: TrajectoryProblem) -> None:
        """Store the request: the recording has the result."""
        self._problem = problem
        if self._live is not None:
            self._live.request(problem)

    def take_result(self) -> Trajectory | None:
        """Return the next recorded result."""
        if self._live is not None:
            return self._live.take_result()
        if any(each is not None for each in self._plans):
            self._problem = None
        return self._plans.pop(0) if self._plans else None

    def fork(self, apart: bool = False) -> "ReplaySolver":
        """Return itself: the results of all solvers are recorded in one order."""
        return self


class NullVideo:
    """Video stream without output."""

    def __init__(self) -> None:
        self.enabled = False

    def set_enabled(self, on: bool) -> None:
        """Store whether it is on."""
        self.enabled = on


class NullRover:
    """Rover without effect: the recorded facts contain the motion."""

    def _ignore(self, *_: object, **__: object) -> None:
        """Do nothing."""

    drive = execute_motion = halt = lock = emergency_stop = _ignore
    navigate = cancel_navigation = open_gate = plan_path = _ignore
    point_camera = request_frame = _ignore
