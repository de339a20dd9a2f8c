"""Recorder of an executive: its calls, the inputs during each call, and its decisions."""

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Concatenate, Final, Generic, ParamSpec, TypeVar

from executive.commands.lifecycle import Refused, SubmitResult
from executive.core.recording import (
    Answered,
    AskedSolver,
    CarriedOut,
    CommitFailed,
    Drove,
    Entry,
    Halted,
    Item,
    KeptFile,
    Life,
    Locked,
    ModeChanged,
    NodeState,
    PointedCamera,
    Reported,
    RequestedFrame,
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
from executive.core.tree import TreeNodeView
from executive.motion import SharedSolver, Trajectory, TrajectoryProblem
from executive.record import Ledger, LedgerError
from executive.settings import LocomotionKind, Settings
from executive.state import FileFolder
from executive.values.clock import Clock
from executive.values.geometry import Velocity
from executive.values.parameters import ParameterValue
from executive.values.ports import (
    CameraIntent,
    DelegatedMotionRover,
    Downlink,
    Rover,
    VelocityRover,
    Video,
    WholeMotion,
)
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, without_figures

P = ParamSpec("P")
R = TypeVar("R", bound=Rover)


class Recorder:
    """Writes the calls, inputs and states of an executive to a tape; does nothing without one.

    Of queries of other threads, the reports and decisions are recorded. Errors of the stop latch,
    of the file folder and of the video stream are not: a run cannot be replayed if they affect a
    decision.

    Attributes:
        tape: receives the recording, or None.
    """

    def __init__(self, tape: Tape | None, clock: Clock) -> None:
        self.tape: Final = tape
        self._clock = clock
        self._stop_checks = 0
        self._commits = 0
        self._nodes: dict[str, TreeNodeView] = {}
        self._mode: ModeChanged | None = None

    def put(self, item: Item) -> None:
        """Record an item."""
        if self.tape is not None:
            self.tape.put(item)

    def enter(
        self,
        entry: Callable[Concatenate[float, float, P], Entry],
        *args: P.args,
        **kwargs: P.kwargs,
    ) -> None:
        """Record the beginning of a call, with its latched time."""
        if self.tape is None:
            return
        item = entry(self._clock.now_s(), self._clock.utc_s(), *args, **kwargs)
        if not is_within(item):
            self._stop_checks = self._commits = 0
        self.tape.put(item)

    def on_stop_check(self, waits: bool) -> None:
        """Record a stop that was received during the call; called at each check for one."""
        if waits:
            self.put(StopWaited(self._stop_checks))
        self._stop_checks += 1

    def on_commit(self, error: LedgerError | None) -> None:
        """Record a failed commit; called at each commit."""
        if error is not None:
            self.put(CommitFailed(self._commits, str(error)))
        self._commits += 1

    def on_answer(self, identity: Identity, result: SubmitResult) -> None:
        """Record the reply to a command."""
        refusal = result.refusal if isinstance(result, Refused) else None
        self.put(Answered(identity, type(result).__name__, refusal))

    def on_state(self, tree: Sequence[TreeNodeView], mode: ModeChanged) -> None:
        """Record the changes of the tree and of the mode since the last call."""
        before, nodes = self._nodes, {each.path: each for each in tree}
        self._nodes = nodes
        changed = tuple(
            NodeState(path, each.status.name, each.message)
            for path, each in nodes.items()
            if not _same(before.get(path), each)
        )
        removed = tuple(path for path in before if path not in nodes)
        if changed or removed:
            self.put(TreeChanged(changed, removed))
        if self._mode is None or _without_figures(self._mode) != _without_figures(mode):
            self._mode = mode
            self.put(mode)


def _same(before: TreeNodeView | None, now: TreeNodeView) -> bool:
    return before is not None and before.status is now.status and before.message == now.message


def _without_figures(mode: ModeChanged) -> tuple[object, ...]:
    return mode.mode, mode.active, without_figures(mode.why)


def process_start(
    settings: Settings,
    ledger: Ledger,
    files: FileFolder,
    solver: SharedSolver | None,
    video: Video | None,
) -> Life:
    """Return the initial state of an executive, before its first change."""
    latch = Path(ledger.path).with_suffix(".stop")
    return Life(
        settings,
        ledger.image(),
        latch.read_bytes() if latch.exists() else b"",
        tuple(KeptFile(path, stamp.size_octets) for path, stamp in sorted(files.entries())),
        None if solver is None else solver.lead_ticks,
        video is not None,
    )


def recorded_ports(
    tape: Tape,
    settings: Settings,
    rover: VelocityRover | DelegatedMotionRover,
    downlinks: Sequence[Downlink],
    video: Video | None,
    solver: SharedSolver | None,
) -> tuple[
    VelocityRover | DelegatedMotionRover, Sequence[Downlink], Video | None, SharedSolver | None
]:
    """Return the ports of an executive, recorded; not a rover that mismatches the settings."""
    if settings.locomotion is LocomotionKind.VELOCITY and isinstance(rover, VelocityRover):
        rover = _RecordedVelocityRover(rover, tape)
    elif settings.locomotion is LocomotionKind.WHOLE_MOTION and isinstance(
        rover, DelegatedMotionRover
    ):
        rover = _RecordedMotionRover(rover, tape)
    return (
        rover,
        (*downlinks, _RecordedDownlink(tape)),
        None if video is None else _RecordedVideo(video, tape),
        None if solver is None else _RecordedSolver(solver, tape),
    )


class _RecordedRover(Generic[R]):
    def __init__(self, rover: R, tape: Tape) -> None:
        self._rover = rover
        self._tape = tape
        self._held: bool | None = None

    def point_camera(self, wanted: CameraIntent) -> None:
        self._tape.put(PointedCamera(wanted))
        self._rover.point_camera(wanted)

    def request_frame(self) -> None:
        self._tape.put(RequestedFrame())
        self._rover.request_frame()

    def emergency_stop(self) -> None:
        self._rover.emergency_stop()

    def lock(self, held: bool) -> None:
        if held is not self._held:
            self._held = held
            self._tape.put(Locked(held))
        self._rover.lock(held)


class _RecordedVelocityRover(_RecordedRover[VelocityRover]):
    def drive(self, velocity: Velocity) -> None:
        self._tape.put(Drove(velocity))
        self._rover.drive(velocity)


class _RecordedMotionRover(_RecordedRover[DelegatedMotionRover]):
    def execute_motion(self, motion: WholeMotion) -> None:
        self._tape.put(CarriedOut(motion))
        self._rover.execute_motion(motion)

    def halt(self) -> None:
        self._tape.put(Halted())
        self._rover.halt()


class _RecordedVideo:
    def __init__(self, video: Video, tape: Tape) -> None:
        self._video = video
        self._tape = tape

    @property
    def enabled(self) -> bool:
        return self._video.enabled

    def set_enabled(self, on: bool) -> None:
        self._tape.put(SwitchedVideo(on))
        self._video.set_enabled(on)


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

    def request(self, problem: TrajectoryProblem) -> None:
        digest = hashlib.sha256(repr(problem).encode()).hexdigest()
        self._tape.put(AskedSolver(problem.start, problem.target, digest))
        self._solver.request(problem)

    def take_result(self) -> Trajectory | None:
        plan = self._solver.take_result()
        self._tape.put(SolverAnswered(plan))
        return plan

    def fork(self, apart: bool = False) -> SharedSolver:
        solver = self._solver.fork(apart)
        return solver if apart else _RecordedSolver(solver, self._tape)
