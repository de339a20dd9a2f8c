"""A rover without physics, and an executive on it in simulated time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import cos, sin
from pathlib import Path
from typing import Any, ClassVar, Self

from executive.commands import Command, MoveForward, PreemptionPolicy, Request
from executive.commands.lifecycle import Rejected, SubmitResult
from executive.core.dispatcher import MAX_SEARCH_TURNS
from executive.core.recording import RecordingSink
from executive.core.runner import Executive
from executive.faults import FaultResponse, Reaction
from executive.goals import Context
from executive.motion import SharedSolver
from executive.plans import Tree
from executive.record import Ledger, Synchronous
from executive.settings import Sensors, Settings, load_settings
from executive.values.clock import ManualClock
from executive.values.facts import Battery, CameraAngles, Fact, Frame, Odometry
from executive.values.geometry import STANDING, Pose, Velocity, wrap_rad
from executive.values.parameters import ParameterValue
from executive.values.ports import CameraIntent, Downlink
from executive.values.reasons import Refusal
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, Stage
from trees import RoverTree

STEP_S = 0.05
PICTURE = b"\xff\xd8picture\xff\xd9"
ALL_STAGES = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]


def ignoring(*faults: str) -> Settings:
    """Return the settings of a Jackal that does not watch for some faults."""
    settings = load_settings("jackal")
    rows = {
        name: replace(getattr(settings.faults, name), reaction=Reaction.IGNORE) for name in faults
    }
    return replace(settings, faults=replace(settings.faults, **rows))


def with_figures(row: FaultResponse, **figures: Any) -> FaultResponse:
    """Return a row with other figures in each of its windows."""
    return replace(row, windows=tuple(replace(each, **figures) for each in row.windows))


@dataclass
class KinematicRover:
    """Moves exactly as told, from one step to the next.

    Attributes:
        spin_centre_m: the point that stands still in a spin, ahead of base_link.
        lazy_camera: whether the camera pans at its speed, instead of being there at once.
        facts: what it has to tell beside what it always tells.
    """

    pose: Pose = field(default_factory=Pose)
    velocity: Velocity = STANDING
    angles: CameraAngles = field(default_factory=lambda: CameraAngles(0.0, 0.0))
    frame_wanted: bool = False
    camera_works: bool = True
    sent: list[Velocity] = field(default_factory=list)
    camera_speed_radps: float = 1.0
    spin_centre_m: float = 0.044
    lazy_camera: bool = False
    pan_wanted_rad: float = 0.0
    facts: list[Fact] = field(default_factory=list)

    def drive(self, velocity: Velocity) -> None:
        self.velocity = velocity
        self.sent.append(velocity)

    def lock(self, held: bool) -> None:
        pass

    def emergency_stop(self) -> None:
        self.drive(STANDING)

    def point_camera(self, wanted: CameraIntent) -> None:
        self.camera_speed_radps = wanted.speed_radps
        self.pan_wanted_rad = wanted.pan_rad
        now_rad = self.angles.pan_rad if self.lazy_camera else wanted.pan_rad
        self.angles = CameraAngles(now_rad, wanted.tilt_rad)

    def request_frame(self) -> None:
        self.frame_wanted = True

    def advance(self, step_s: float) -> None:
        if self.lazy_camera:
            self._pan(self.camera_speed_radps * step_s)
        pose, velocity = self.pose, self.velocity
        heading_rad = pose.heading_rad + velocity.rotate_radps * step_s / 2
        ahead_m = velocity.travel_mps * step_s
        left_m = -self.spin_centre_m * velocity.rotate_radps * step_s
        self.pose = Pose(
            x_m=pose.x_m + ahead_m * cos(heading_rad) - left_m * sin(heading_rad),
            y_m=pose.y_m + ahead_m * sin(heading_rad) + left_m * cos(heading_rad),
            heading_rad=wrap_rad(pose.heading_rad + velocity.rotate_radps * step_s),
        )

    def _pan(self, max_rad: float) -> None:
        difference_rad = self.pan_wanted_rad - self.angles.pan_rad
        pan_rad = self.angles.pan_rad + max(-max_rad, min(max_rad, difference_rad))
        self.angles = CameraAngles(pan_rad, self.angles.tilt_rad)


class Received:
    """A downlink that keeps what it hears."""

    def __init__(self) -> None:
        self.reports: list[Report] = []
        self.plans: list[PlanUpdate] = []
        self.values: list[Sequence[ParameterValue]] = []
        self.files: list[FileEvent] = []

    def send_reports(self, reports: Sequence[Report]) -> None:
        self.reports += reports

    def send_plan_update(self, update: PlanUpdate) -> None:
        self.plans.append(update)

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        self.values.append(values)

    def send_file_event(self, event: FileEvent) -> None:
        self.files.append(event)


class VideoSwitch:
    """A video stream that only knows whether it is on."""

    def __init__(self) -> None:
        self.enabled = False

    def set_enabled(self, on: bool) -> None:
        self.enabled = on


class Bench:
    """An executive over a kinematic rover, with all the time in the world.

    Attributes:
        odometry: whether the rover tells where it is.
        voltage_v: what its battery shows; None where it tells nothing.
        charge_ratio: the charge that its battery tells; None where it tells none.
        ledger: that of the executive.
        tape: takes a recording of it; None for none.
        new_tape: gives each bench its tape that is not given one.
    """

    ledger: Ledger
    new_tape: ClassVar[Callable[[], RecordingSink | None]] = staticmethod(lambda: None)

    def __init__(
        self,
        folder: Path,
        settings: Settings | None = None,
        build_tree: Callable[[Context], Tree] = RoverTree,
        rover: KinematicRover | None = None,
        solver: SharedSolver | None = None,
        clock: ManualClock | None = None,
        tape: RecordingSink | None = None,
        all_sensors: bool = False,
    ) -> None:
        self.folder = folder
        # The tree of a recording is that of the rover.
        self.tape = tape or (Bench.new_tape() if build_tree is RoverTree else None)
        asset = settings or load_settings("jackal")
        reported = asset.sensors
        fewer = Sensors(laser=reported.laser, second_odometry=reported.second_odometry)
        self.settings = asset if all_sensors else replace(asset, sensors=fewer)
        self.clock = clock or ManualClock()
        self.rover = rover or KinematicRover()
        self.received = Received()
        self.video = VideoSwitch()
        self.odometry = True
        self.voltage_v: float | None = 26.0
        self.charge_ratio: float | None = None
        self.build_tree = build_tree
        self.solver = solver
        self.executive = self._start()
        self.run(STEP_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.executive.simulate_crash()

    def _start(self) -> Executive:
        self.ledger = self.open_ledger()
        return Executive(
            settings=self.settings,
            clock=self.clock,
            rover=self.rover,
            ledger=self.ledger,
            files=self.folder / "files",
            video=self.video,
            downlinks=self.downlinks(),
            build_tree=self.build_tree,
            solver=self.solver,
            tape=self.tape,
        )

    def open_ledger(self) -> Ledger:
        """Open the ledger of the executive that starts now."""
        return Ledger(self.folder / "ledger.sqlite", Synchronous.NORMAL)

    def downlinks(self) -> list[Downlink]:
        """Return who hears the executive that starts now."""
        return [self.received]

    def fill_disk(self, full: bool = True) -> None:
        """Let the ledger take nothing more, or mend it."""
        self.ledger.rows(f"PRAGMA query_only = {'ON' if full else 'OFF'}")

    def restart(self) -> None:
        """Start an executive where the one before was closed."""
        self.executive = self._start()

    def crash(self) -> None:
        """Lose the process as kill -9 does, and start another on the same ledger."""
        self.executive.simulate_crash()
        self.executive = self._start()

    def submit(self, request: Request, number: int, **options: object) -> SubmitResult:
        """Send a command of source MOE."""
        return self.send(Command(Identity("MOE", number), request, "direct", **options))  # type: ignore[arg-type]

    def refusal(self, request: Request, number: int, **options: object) -> Refusal:
        """Send a command that is refused, and return why."""
        answer = self.submit(request, number, **options)
        assert isinstance(answer, Rejected), answer
        return answer.refusal

    def replace(self, request: Request, number: int) -> SubmitResult:
        """Send a command that replaces the motion under way."""
        return self.submit(request, number, preemption=PreemptionPolicy.REPLACE)

    def send(self, command: Command) -> SubmitResult:
        """Send a command."""
        answers: list[SubmitResult] = []
        self.executive.submit(command, answers.append)
        self.executive.serve_inbox()
        for _ in range(MAX_SEARCH_TURNS):
            if not answers:
                self.executive.serve_inbox()
        (answer,) = answers
        return answer

    def step(self) -> None:
        """Let one tick pass."""
        self.clock.advance(STEP_S)
        self.rover.advance(STEP_S)
        if self.odometry:
            self.executive.observe(
                Odometry(self.clock.now_s(), self.rover.pose, self.rover.velocity)
            )
        facts, self.rover.facts = self.rover.facts, []
        for fact in facts:
            self.executive.observe(fact)
        if self.voltage_v is not None:
            self.executive.observe(Battery(self.voltage_v, self.charge_ratio))
        self.executive.observe(self.rover.angles)
        if self.rover.frame_wanted and self.rover.camera_works:
            self.rover.frame_wanted = False
            self.executive.observe(Frame(self.clock.now_s(), "JPG", PICTURE))
        self.executive.tick()

    def run(self, duration_s: float) -> None:
        """Let time pass."""
        for _ in range(round(duration_s / STEP_S)):
            self.step()

    def finish(self, number: int, limit_s: float = 120.0) -> Stage:
        """Let time pass until a command's life ends, and return how."""
        for _ in range(round(limit_s / STEP_S)):
            stages = self.stages(number)
            if stages and stages[-1].terminal:
                return stages[-1]
            self.step()
        raise AssertionError(
            f"command {number} did not end within {limit_s} s: {self.stages(number)}"
        )

    def execute(self, request: Request, number: int) -> None:
        """Send a command and let time pass until it is executed."""
        self.submit(request, number)
        assert self.finish(number) is Stage.EXECUTED, self.stages(number)

    def drive_on(self, duration_s: float = 1.0) -> None:
        """Send a long drive as command 1 and let it go on for a while."""
        self.submit(MoveForward(5.0), 1)
        self.run(duration_s)

    def stages(self, number: int) -> list[Stage]:
        """Return the stages reported of a command, in order."""
        return [
            report.stage
            for report in self.received.reports
            if report.identity == Identity("MOE", number) and report.stage is not None
        ]

    def last(self, number: int) -> Report:
        """Return the last report on a command."""
        return [r for r in self.received.reports if r.identity == Identity("MOE", number)][-1]
