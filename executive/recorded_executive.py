"""An executive that is recorded: its entries, what the world answers, and what it decides."""

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import Final, Protocol

from executive.authority import AuthorityAsked, AuthorityState
from executive.clock import Clock, LatchedClock
from executive.commands.lifecycle import Refused, SubmitResult
from executive.geometry import Velocity
from executive.goals import Context
from executive.inbox import Inbox, Question, Submission
from executive.motion import Plan, Problem, SharedSolver
from executive.ports import (
    CameraIntent,
    Downlink,
    MotionRover,
    VelocityRover,
    Video,
    WholeMotion,
)
from executive.reasons import Figure, Refusal
from executive.record import Ledger, LedgerError
from executive.recording import (
    Answered,
    AskedSolver,
    Call,
    Called,
    CarriedOut,
    CommitFailed,
    Drove,
    Entry,
    GroundHeard,
    Halted,
    KeptFile,
    Life,
    Locked,
    MadeSafe,
    ModeChanged,
    NodeState,
    Noticed,
    Observed,
    PointedCamera,
    Reported,
    RequestedFrame,
    Served,
    SolverAnswered,
    SolverBusy,
    StopWaited,
    SwitchedVideo,
    Tape,
    ToldFile,
    ToldParameters,
    ToldPlan,
    TreeChanged,
    is_within,
)
from executive.reports import Kind, PlanUpdate, Report, Severity
from executive.runner import Executive, Tree
from executive.settings import LocomotionKind, Settings
from executive.state import Fact, FileEvent, FileFolder, ParameterValue

_FIGURES: Final = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


class SeenNode(Protocol):
    """A node of the tree, as of the last tick."""

    @property
    def path(self) -> str:
        """Names from the root."""

    @property
    def status(self) -> Enum:
        """What it did."""

    @property
    def message(self) -> str:
        """What it says of itself."""


class SeenTree(Tree, Protocol):
    """A tree whose nodes can be recorded."""

    def nodes(self) -> Sequence[SeenNode]:
        """Return all nodes as of the last tick."""


def _same(before: SeenNode | None, now: SeenNode) -> bool:
    """Return whether a node is as it was."""
    return before is not None and before.status is now.status and before.message == now.message


def without_figures(text: str) -> str:
    """Return the words of a text, so that two can be compared whose figures change all the time."""
    return _FIGURES.sub("", text)


def life_of(
    settings: Settings,
    ledger: Ledger,
    files: Path,
    solver: SharedSolver | None = None,
    video: Video | None = None,
) -> Life:
    """Return what an executive begins with, to be recorded before it is made."""
    latch = Path(ledger.path).with_suffix(".stop")
    kept = sorted(FileFolder(files, lambda _: None).entries())
    return Life(
        settings,
        ledger.image(),
        latch.read_bytes() if latch.exists() else b"",
        tuple(KeptFile(path, stamp.size_octets) for path, stamp in kept),
        None if solver is None else solver.lead_ticks,
        video is not None,
    )


class RecordedExecutive(Executive):
    """An executive whose entries, inputs and decisions are put on a tape.

    Of questions of other threads what they have reported or decided is recorded. Faults of the
    stop latch, of the folder of files and of the video stream are not: runs in which they decide
    something cannot be replayed.

    Args:
        tape: takes the recording.
        inbox: what other threads hand over; one of its own unless given.
    """

    tree: SeenTree

    def __init__(
        self,
        tape: Tape,
        *,
        settings: Settings,
        clock: Clock,
        rover: VelocityRover | MotionRover,
        ledger: Ledger,
        files: Path,
        downlinks: Sequence[Downlink],
        build_tree: Callable[[Context], SeenTree],
        video: Video | None = None,
        solver: SharedSolver | None = None,
        inbox: "RecordedInbox | None" = None,
    ) -> None:
        self._tape = tape
        self._box = RecordedInbox(tape) if inbox is None else inbox
        self._nodes: dict[str, SeenNode] = {}
        self._last_mode: ModeChanged | None = None
        self._commits = 0
        ledger.on_commit = self._note_commit
        self._time = LatchedClock(clock)
        self._call(Call.START)
        super().__init__(
            settings=settings,
            clock=self._time,
            rover=_recorded(rover, settings, tape),
            ledger=ledger,
            files=files,
            downlinks=[*downlinks, _RecordedDownlink(tape)],
            build_tree=build_tree,
            video=None if video is None else _RecordedVideo(video, tape),
            solver=None if solver is None else _RecordedSolver(solver, tape),
            inbox=self._box,
        )
        self._time.end()

    def observe(self, fact: Fact) -> None:
        """Take in a fact."""
        with self._time:
            self._begin(Observed(self._time.now_s(), self._time.utc_s(), fact))
            super().observe(fact)

    def event(
        self,
        severity: Severity,
        text: str,
        figures: tuple[Figure, ...] = (),
        kind: Kind = Kind.EVENT,
    ) -> None:
        """Report something that another component noticed, or a link."""
        within = self._time.held
        with self._time:
            now_s, utc_s = self._time.now_s(), self._time.utc_s()
            self._begin(Noticed(now_s, utc_s, severity, text, figures, kind, within))
            super().event(severity, text, figures, kind)

    def make_safe(self, danger: Refusal) -> None:
        """Stand until resumed; nothing, where the same reason holds the rover already."""
        within = self._time.held
        with self._time:
            self._begin(MadeSafe(self._time.now_s(), self._time.utc_s(), danger, within))
            super().make_safe(danger)

    def ask_authority(self, asked: AuthorityAsked) -> AuthorityState | Refusal:
        """Request, take, hand over or release the authority."""
        self._tape.put(asked)
        return super().ask_authority(asked)

    def turn(self) -> None:
        """Serve what was submitted and asked."""
        with self._time:
            self._call(Call.TURN)
            super().turn()
            self._tell_changes()

    def tick(self) -> None:
        """Serve a turn, run plan and tree once, command the rover, send telemetry, prune."""
        with self._time:
            self._call(Call.TICK)
            super().tick()
            self._tell_changes()

    def close(self) -> None:
        """End everything."""
        with self._time:
            self._call(Call.CLOSE)
            super().close()

    def _listen_for_ground(self) -> None:
        super()._listen_for_ground()
        if self.ground.heard:
            self._tape.put(GroundHeard())

    def _call(self, call: Call) -> None:
        self._begin(Called(self._time.now_s(), self._time.utc_s(), call))

    def _begin(self, entry: Entry) -> None:
        if not is_within(entry):
            self._box.looks = self._commits = 0
        self._tape.put(entry)

    def _note_commit(self, error: LedgerError | None) -> None:
        if error is not None:
            self._tape.put(CommitFailed(self._commits, str(error)))
        self._commits += 1

    def _tell_changes(self) -> None:
        """Record what is other than before of the tree, the mode and the command under way."""
        before, nodes = self._nodes, {each.path: each for each in self.tree.nodes()}
        self._nodes = nodes
        changed = tuple(
            NodeState(path, each.status.name, each.message)
            for path, each in nodes.items()
            if not _same(before.get(path), each)
        )
        gone = tuple(path for path in before if path not in nodes)
        if changed or gone:
            self._tape.put(TreeChanged(changed, gone))
        last, now = self._last_mode, ModeChanged(self.mode, self.active_command, self.why)
        if last is None or (
            (last.mode, last.active, without_figures(last.why))
            != (now.mode, now.active, without_figures(now.why))
        ):
            self._last_mode = now
            self._tape.put(now)


class RecordedInbox(Inbox):
    """Records the commands that are taken, what their senders are told, and stops that wait.

    Attributes:
        looks: how often was looked for a stop in the present entry.
    """

    def __init__(self, tape: Tape) -> None:
        super().__init__()
        self._tape = tape
        self.looks = 0

    @property
    def stop_waits(self) -> bool:
        """Whether a stop has come that was not taken."""
        waits = super().stop_waits
        if waits:
            self._tape.put(StopWaited(self.looks))
        self.looks += 1
        return waits

    def take_stop(self) -> Submission:
        """Return the next stop."""
        return self._recorded(super().take_stop())

    def take(self) -> Submission | Question:
        """Return the next command that is no stop, or the next question."""
        item = super().take()
        return self._recorded(item) if isinstance(item, Submission) else item

    def _recorded(self, submission: Submission) -> Submission:
        self._tape.put(Served(submission.command, self.overtaken(submission)))
        return with_recorded_answer(submission, self._tape)


def with_recorded_answer(submission: Submission, tape: Tape) -> Submission:
    """Return a submission whose answer is recorded."""

    def reply(result: SubmitResult) -> None:
        refusal = result.refusal if isinstance(result, Refused) else None
        tape.put(Answered(submission.command.identity, type(result).__name__, refusal))
        submission.reply(result)

    return replace(submission, reply=reply)


def _recorded(
    rover: VelocityRover | MotionRover, settings: Settings, tape: Tape
) -> VelocityRover | MotionRover:
    """Return a rover whose commands are recorded; itself, if it does not fit the settings."""
    if settings.locomotion is LocomotionKind.VELOCITY and isinstance(rover, VelocityRover):
        return _RecordedVelocityRover(rover, tape)
    if settings.locomotion is LocomotionKind.WHOLE_MOTION and isinstance(rover, MotionRover):
        return _RecordedMotionRover(rover, tape)
    return rover


class _RecordedRover:
    def __init__(self, rover: VelocityRover | MotionRover, tape: Tape) -> None:
        self._any = rover
        self._tape = tape
        self._held: bool | None = None

    def point_camera(self, wanted: CameraIntent) -> None:
        self._tape.put(PointedCamera(wanted))
        self._any.point_camera(wanted)

    def request_frame(self) -> None:
        self._tape.put(RequestedFrame())
        self._any.request_frame()

    def emergency_stop(self) -> None:
        self._any.emergency_stop()

    def lock(self, held: bool) -> None:
        if held is not self._held:
            self._held = held
            self._tape.put(Locked(held))
        self._any.lock(held)


class _RecordedVelocityRover(_RecordedRover):
    def __init__(self, rover: VelocityRover, tape: Tape) -> None:
        super().__init__(rover, tape)
        self._rover = rover

    def drive(self, velocity: Velocity) -> None:
        self._tape.put(Drove(velocity))
        self._rover.drive(velocity)


class _RecordedMotionRover(_RecordedRover):
    def __init__(self, rover: MotionRover, tape: Tape) -> None:
        super().__init__(rover, tape)
        self._rover = rover

    def carry_out(self, motion: WholeMotion) -> None:
        self._tape.put(CarriedOut(motion))
        self._rover.carry_out(motion)

    def halt(self) -> None:
        self._tape.put(Halted())
        self._rover.halt()


class _RecordedVideo:
    def __init__(self, video: Video, tape: Tape) -> None:
        self._video = video
        self._tape = tape

    @property
    def on(self) -> bool:
        return self._video.on

    def switch(self, on: bool) -> None:
        self._tape.put(SwitchedVideo(on))
        self._video.switch(on)


class _RecordedDownlink:
    def __init__(self, tape: Tape) -> None:
        self._tape = tape

    def report(self, reports: Sequence[Report]) -> None:
        for report in reports:
            self._tape.put(Reported(report))

    def telemetry(self, values: Sequence[ParameterValue]) -> None:
        self._tape.put(ToldParameters(tuple(values)))

    def file(self, event: FileEvent) -> None:
        self._tape.put(ToldFile(event))

    def plan(self, update: PlanUpdate) -> None:
        self._tape.put(ToldPlan(update))


class _RecordedSolver:
    def __init__(self, solver: SharedSolver, tape: Tape) -> None:
        self._solver = solver
        self._tape = tape
        self.lead_ticks = solver.lead_ticks

    @property
    def busy(self) -> bool:
        busy = self._solver.busy
        self._tape.put(SolverBusy(busy))
        return busy

    def ask(self, problem: Problem) -> None:
        digest = hashlib.sha256(repr(problem).encode()).hexdigest()
        self._tape.put(AskedSolver(problem.start, problem.target, digest))
        self._solver.ask(problem)

    def answer(self) -> Plan | None:
        plan = self._solver.answer()
        self._tape.put(SolverAnswered(plan))
        return plan

    def beside(self, apart: bool = False) -> SharedSolver:
        solver = self._solver.beside(apart)
        return solver if apart else _RecordedSolver(solver, self._tape)
