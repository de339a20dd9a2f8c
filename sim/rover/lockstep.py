"""`LockStep`: executive and simulated rover in one process and one thread, on simulated time.

The same core and the same physics as over ROS, without threads, sockets or waiting: runs repeat
bit for bit and are many times faster than real time.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import assert_never

from adapters.mocup import MocupRover
from adapters.mops import Message, MopsError, MopsStream, encode, facts_of, load_dictionary
from executive.commands import Command
from executive.commands.lifecycle import SubmitResult
from executive.core.recording import RecordingSink, Truth
from executive.core.runner import Executive
from executive.motion import SharedSolver, make_solver
from executive.record import Ledger, Synchronous
from executive.settings import LocomotionKind, Settings
from executive.values.clock import Clock, ManualClock
from executive.values.facts import Fact
from executive.values.parameters import ParameterValue
from executive.values.ports import Downlink
from executive.values.reports import FileEvent, PlanUpdate, Report
from sim.brick import BrickSettings
from sim.rover.camera import PictureSettings
from sim.rover.jackal import SimulatedJackal, SimulatedOdometry
from sim.rover.mocup import SimulatedMocup
from sim.rover.world import World
from trees import RoverTree

SOURCE = "EXEC"


class InProcessMocup(MocupRover):
    """A simulated MOCUP from the view of one executive: a plugin on simulated time."""

    def __init__(self, body: SimulatedMocup, clock: Clock, brick: str) -> None:
        self._body = body
        self._due: list[Fact] = []
        dictionary = load_dictionary()
        self._telemetry = dictionary.spelling.telemetry
        self._stream = MopsStream(_refuse)

        def send(message: Message) -> None:
            body.receive(encode(message))

        super().__init__(dictionary, clock, send, self._due.append, SOURCE, brick)

    def lock(self, held: bool) -> None:
        """Ignore the lock: a brick has no other publishers."""

    def request_frame(self) -> None:
        """Request a picture: the camera is not on the brick."""
        self._body.request_frame()

    def facts(self) -> list[Fact]:
        """Return the brick's facts since the last call, and the requested picture."""
        for message in self._stream.feed(self._body.brick.transmit()):
            if message.code == self._telemetry.code:
                with suppress(MopsError):  # telemetry that cannot be read is lost, as over ROS
                    self._due += facts_of(message, self._telemetry, self._clock.now_s())
            else:
                self.on_reply(message)
        due = [*self._due, *self._body.facts()]
        self._due.clear()
        return due


def _refuse(line: str) -> None:
    raise ValueError(f"not a MOPS message from the brick: {line}")


STEP_S = 0.01


class DownlinkRecorder:
    """A downlink that stores all reports and telemetry."""

    def __init__(self) -> None:
        self.reports: list[Report] = []
        self.telemetry_batches: list[Sequence[ParameterValue]] = []
        self.file_events: list[FileEvent] = []
        self.plans: list[PlanUpdate] = []

    def send_reports(self, reports: Sequence[Report]) -> None:
        """Store reports."""
        self.reports += reports

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Store a batch."""
        self.telemetry_batches.append(values)

    def send_file_event(self, event: FileEvent) -> None:
        """Store a file event."""
        self.file_events.append(event)

    def send_plan_update(self, update: PlanUpdate) -> None:
        """Store the progress of a plan."""
        self.plans.append(update)


class LockStep:
    """One rover and its executive.

    Args:
        folder: folder of the ledger and the files.
        downlinks: further receivers of reports and telemetry, in addition to `downlink_record`.
        picture: size and renderer of camera pictures.
        odometry: accuracy of a Jackal's odometry.
        solver: solver of plans; created if the settings offer mpc, unless given.
        tape: receives a recording of the executive; None for none.
        rover: a Jackal with further parts, such as a navigation; None for that of the settings.

    Attributes:
        rover: the simulation: a Jackal, or MOCUP if it executes whole motions.
        downlink_record: all reports and telemetry so far.
        alive: whether an executive runs: always, except between `kill` and `start`.
    """

    def __init__(
        self,
        settings: Settings,
        world: World,
        folder: Path,
        seed: int = 0,
        downlinks: Sequence[Downlink] = (),
        picture: PictureSettings | None = None,
        odometry: SimulatedOdometry | None = None,
        solver: SharedSolver | None = None,
        tape: RecordingSink | None = None,
        rover: SimulatedJackal | None = None,
    ) -> None:
        self.settings = settings
        if solver is None and settings.offers_mpc:
            solver = make_solver(settings)
        self._solver = solver
        self._tape = tape
        self.rover = rover or _rover(settings, world, seed, picture, odometry)
        self.clock = ManualClock()
        self.downlink_record = DownlinkRecorder()
        self._folder = folder
        self._downlinks = (self.downlink_record, *downlinks)
        self._steps = 0
        self._woken = False
        self._tick_steps = round(settings.tick_s / STEP_S)
        self.executive = self._start()
        self.alive = True

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start."""
        return self.clock.now_s()

    def submit(self, command: Command) -> SubmitResult:
        """Submit a command like a link, and return the result.

        Raises:
            ConnectionError: there is no executive, between `kill` and `start`.
        """
        if not self.alive:
            raise ConnectionError("the executive does not run")
        answers: list[SubmitResult] = []
        self.executive.submit(command, answers.append)
        self.executive.serve_inbox()
        self._serve_while_woken()
        return answers[0]

    def run(self, duration_s: float) -> None:
        """Advance the time."""
        for _ in range(round(duration_s / STEP_S)):
            self._step()

    def run_until(self, done: Callable[[], bool], limit_s: float) -> bool:
        """Advance the time until a condition holds; return whether it did within the limit."""
        for _ in range(round(limit_s / STEP_S)):
            if done():
                return True
            self._step()
        return done()

    def kill(self) -> None:
        """End the executive as by kill -9: it receives no facts, and does not tick or command."""
        self.executive.simulate_crash()
        self.alive = False

    def start(self) -> None:
        """Start another executive on the same ledger."""
        self.executive = self._start()
        self.alive = True

    def _start(self) -> Executive:
        self._seen = self._rover_port()
        ledger = Ledger(self._folder / "ledger.sqlite", Synchronous.NORMAL)
        executive = Executive(
            settings=self.settings,
            clock=self.clock,
            rover=self._seen,
            ledger=ledger,
            files=self._folder / "files",
            downlinks=self._downlinks,
            build_tree=RoverTree,
            solver=self._solver,
            tape=self._tape,
        )
        executive.wake = self._wake
        return executive

    def _rover_port(self) -> SimulatedJackal | InProcessMocup:
        """Return the rover from the view of an executive; for MOCUP with a plugin of its own."""
        if isinstance(self.rover, SimulatedJackal):
            return self.rover
        return InProcessMocup(self.rover, self.clock, self.settings.asset.upper())

    def _step(self) -> None:
        self.rover.advance(STEP_S)
        self._steps += 1
        self.clock.set(self._steps * STEP_S)
        facts = self._seen.facts()
        if not self.alive:
            return
        for fact in facts:
            self.executive.observe(fact)
        if self._steps % self._tick_steps == 0:
            if self._tape is not None:
                self._tape.put(Truth(self.time_s, self.rover.true_pose))
            self.executive.tick()
            self._serve_while_woken()

    def _wake(self) -> None:
        self._woken = True

    def _serve_while_woken(self) -> None:
        """Execute the turns that the executive requests, without advancing the time."""
        while self._woken:
            self._woken = False
            self.executive.serve_inbox()


def _rover(
    settings: Settings,
    world: World,
    seed: int,
    picture: PictureSettings | None,
    odometry: SimulatedOdometry | None,
) -> SimulatedJackal | SimulatedMocup:
    match settings.locomotion:
        case LocomotionKind.VELOCITY:
            return SimulatedJackal(world, seed, odometry, picture, settings.sensors, settings.mux)
        case LocomotionKind.DELEGATED:
            brick = BrickSettings(name=settings.asset.upper())
            return SimulatedMocup(world, seed, brick=brick, picture=picture)
        case _:
            assert_never(settings.locomotion)
