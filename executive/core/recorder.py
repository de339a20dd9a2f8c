"""`Recorder` passes the calls, inputs and decisions of an executive to a `RecordingSink`."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Concatenate, Final, Generic, ParamSpec, TypeVar

from executive.commands.lifecycle import Rejected, SubmitResult
from executive.core.recording import (
    CameraCommanded,
    EmergencyStopped,
    Entry,
    FileEventSent,
    FrameRequested,
    HaltCommanded,
    Item,
    LedgerBehind,
    ModeChanged,
    MotionCommanded,
    MuxLockChanged,
    NavigationCancelled,
    NavigationCommanded,
    NavigationGateChanged,
    PathRequested,
    PlanUpdateSent,
    ProcessStart,
    RecordingSink,
    ReportSent,
    SolverBusy,
    SolverRequested,
    SolverResult,
    StopPending,
    StoredFile,
    SubmitAnswered,
    TelemetrySent,
    TreeChanged,
    TreeNodeState,
    VelocityCommanded,
    VideoSwitched,
    is_within,
)
from executive.motion import SharedSolver, Trajectory, TrajectoryProblem
from executive.plans import TreeNodeView
from executive.record import Ledger, WriterState
from executive.settings import LocomotionKind, Settings
from executive.state import FileFolder
from executive.values.clock import Clock
from executive.values.geometry import Velocity
from executive.values.parameters import ParameterValue
from executive.values.ports import (
    CameraIntent,
    DelegatedMotion,
    DelegatedMotionRover,
    Downlink,
    NavigationGoal,
    NavigationRover,
    PathRequest,
    Rover,
    VelocityRover,
    Video,
)
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, without_figures

P = ParamSpec("P")
R = TypeVar("R", bound=Rover)
V = TypeVar("V", bound=VelocityRover)


class Recorder:
    """Writes the calls, inputs and states of an executive to a tape; does nothing without one.

    Of queries of other threads, the reports and decisions are recorded. Errors of the stop latch,
    of the file folder and of the video stream are not: a run cannot be replayed if they affect a
    decision.

    Attributes:
        tape: receives the recording, or None.
    """

    def __init__(self, tape: RecordingSink | None, clock: Clock) -> None:
        self.tape: Final = tape
        self._clock = clock
        self._stop_checks = 0
        self._polls = 0
        self._tree: Sequence[TreeNodeView] = ()
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
            self._stop_checks = self._polls = 0
        self.tape.put(item)

    def on_stop_check(self, waits: bool) -> None:
        """Record a stop that was received during the call; called at each check for one."""
        if waits:
            self.put(StopPending(self._stop_checks))
        self._stop_checks += 1

    def on_writer_state(self, state: WriterState, sealed: int) -> None:
        """Record a state of the ledger's writer that is not the usual one; called at each poll."""
        if self.tape is None:
            return
        behind, error = sealed - state.durable, "" if state.error is None else str(state.error)
        if behind or error:
            self.put(LedgerBehind(self._polls, state.durable, error, behind))
        self._polls += 1

    def on_answer(self, identity: Identity, result: SubmitResult) -> None:
        """Record the reply to a command."""
        refusal = result.refusal if isinstance(result, Rejected) else None
        self.put(SubmitAnswered(identity, type(result).__name__, refusal))

    def on_state(self, tree: Sequence[TreeNodeView], mode: ModeChanged) -> None:
        """Record the changes of the tree and of the mode since the last call."""
        if tree is self._tree and mode == self._mode:
            return
        before, nodes = self._nodes, {each.path: each for each in tree}
        self._tree, self._nodes = tree, nodes
        changed = tuple(
            TreeNodeState(path, each.status.name, each.message)
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


def _without_figures(mode: ModeChanged) -> ModeChanged:
    """Return a mode, its text without figures; no decision depends on the recorded text."""
    return replace(mode, why=without_figures(mode.why))


def process_start(
    settings: Settings,
    ledger: Ledger,
    files: FileFolder,
    solver: SharedSolver | None,
    video: Video | None,
) -> ProcessStart:
    """Return the initial state of an executive, before its first change."""
    latch = Path(ledger.path).with_suffix(".stop")
    return ProcessStart(
        settings,
        ledger.image(),
        latch.read_bytes() if latch.exists() else b"",
        tuple(StoredFile(path, stamp.size_octets) for path, stamp in sorted(files.entries())),
        None if solver is None else solver.lead_ticks,
        video is not None,
    )


def recorded_ports(
    tape: RecordingSink,
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
        if settings.navigation is not None and isinstance(rover, NavigationRover):
            rover = _RecordedNavigationRover(rover, tape)
        else:
            rover = _RecordedVelocityRover(rover, tape)
    elif settings.locomotion is LocomotionKind.DELEGATED and isinstance(
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
    def __init__(self, rover: R, tape: RecordingSink) -> None:
        self._rover = rover
        self._tape = tape
        self._held: bool | None = None

    def point_camera(self, wanted: CameraIntent) -> None:
        self._tape.put(CameraCommanded(wanted))
        self._rover.point_camera(wanted)

    def request_frame(self) -> None:
        self._tape.put(FrameRequested())
        self._rover.request_frame()

    def emergency_stop(self) -> None:
        self._rover.emergency_stop()
        self._tape.put(EmergencyStopped())

    def lock(self, held: bool) -> None:
        if held is not self._held:
            self._held = held
            self._tape.put(MuxLockChanged(held))
        self._rover.lock(held)


class _RecordedVelocityRover(_RecordedRover[V]):
    def drive(self, velocity: Velocity) -> None:
        self._tape.put(VelocityCommanded(velocity))
        self._rover.drive(velocity)


class _RecordedNavigationRover(_RecordedVelocityRover[NavigationRover]):
    _is_open: bool | None = None

    def navigate(self, goal: NavigationGoal) -> None:
        self._tape.put(NavigationCommanded(goal))
        self._rover.navigate(goal)

    def cancel_navigation(self) -> None:
        self._tape.put(NavigationCancelled())
        self._rover.cancel_navigation()

    def open_gate(self, is_open: bool) -> None:
        if is_open is not self._is_open:
            self._is_open = is_open
            self._tape.put(NavigationGateChanged(is_open))
        self._rover.open_gate(is_open)

    def plan_path(self, request: PathRequest) -> None:
        self._tape.put(PathRequested(request))
        self._rover.plan_path(request)


class _RecordedMotionRover(_RecordedRover[DelegatedMotionRover]):
    def execute_motion(self, motion: DelegatedMotion) -> None:
        self._tape.put(MotionCommanded(motion))
        self._rover.execute_motion(motion)

    def halt(self) -> None:
        self._tape.put(HaltCommanded())
        self._rover.halt()


class _RecordedVideo:
    def __init__(self, video: Video, tape: RecordingSink) -> None:
        self._video = video
        self._tape = tape

    @property
    def enabled(self) -> bool:
        return self._video.enabled

    def set_enabled(self, on: bool) -> None:
        self._tape.put(VideoSwitched(on))
        self._video.set_enabled(on)


class _RecordedDownlink:
    def __init__(self, tape: RecordingSink) -> None:
        self._tape = tape

    def send_reports(self, reports: Sequence[Report]) -> None:
        for report in reports:
            self._tape.put(ReportSent(report))

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        self._tape.put(TelemetrySent(tuple(values)))

    def send_file_event(self, event: FileEvent) -> None:
        self._tape.put(FileEventSent(event))

    def send_plan_update(self, update: PlanUpdate) -> None:
        self._tape.put(PlanUpdateSent(update))


class _RecordedSolver:
    def __init__(self, solver: SharedSolver, tape: RecordingSink) -> None:
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
        self._tape.put(SolverRequested(problem.start, problem.target, digest))
        self._solver.request(problem)

    def take_result(self) -> Trajectory | None:
        plan = self._solver.take_result()
        self._tape.put(SolverResult(plan))
        return plan

    def fork(self, apart: bool = False) -> SharedSolver:
        solver = self._solver.fork(apart)
        return solver if apart else _RecordedSolver(solver, self._tape)
