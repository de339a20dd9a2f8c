"""`LockStep`: executive and simulated rover in one process and one thread, on simulated time.

The same core and the same physics as over ROS, without threads, sockets or waiting: runs repeat
bit for bit and are many times faster than real time.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from math import floor, inf
from pathlib import Path
from typing import Final, assert_never

from adapters.mocup import MocupRover
from adapters.mops import Message, MopsError, MopsStream, encode, facts_of, load_dictionary
from executive.commands import Command
from executive.commands.lifecycle import SubmitResult
from executive.core.recording import (
    ExecutiveKilled,
    RecordingSink,
    SimulationItem,
    SimulationState,
    Truth,
)
from executive.core.runner import Executive
from executive.goals import Context
from executive.motion import SharedSolver, make_solver
from executive.plans import Tree
from executive.record import Ledger, Synchronous
from executive.settings import LocomotionKind, Settings
from executive.values.clock import START_UTC_S, Clock, ManualClock
from executive.values.facts import Fact
from executive.values.geometry import STANDING
from executive.values.parameters import ParameterValue
from executive.values.ports import Downlink
from executive.values.reports import FileEvent, PlanUpdate, Report
from sim.brick import BrickSettings
from sim.rover.camera import PictureSettings
from sim.rover.jackal import SimulatedJackal, SimulatedOdometry
from sim.rover.mocup import SimulatedMocup
from sim.rover.simulation import Simulation
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
MAX_SKIP_S: Final = 60.0
"""Maximum duration of a skip; chosen."""
RESTED_S: Final = 2.0
"""Time of rest before a skip, after which a standstill has been detected; chosen."""
MEASURED_S: Final = 0.6
"""Time between two skips; the monitors of the accelerometer then settle; measured."""
_SECOND: Final = round(1 / STEP_S)
_SAVED_STEP: Final = 8
"""Step of each second that records the state: no scan at 10 Hz is delayed then."""


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
        start_utc_s: UTC of the start.
        skips: whether `skip` is used: a tick is then late only after `MAX_SKIP_S` more.
        build_tree: builds the executive's tree.

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
        start_utc_s: float = START_UTC_S,
        skips: bool = False,
        build_tree: Callable[[Context], Tree] = RoverTree,
    ) -> None:
        if skips:
            safety = replace(settings.safety, watchdog_s=settings.safety.watchdog_s + MAX_SKIP_S)
            settings = replace(settings, safety=safety)
        self.settings, self._skips, self._build_tree = settings, skips, build_tree
        self._rested_since_s = inf
        if solver is None and settings.offers_mpc:
            solver = make_solver(settings)
        self._solver = solver
        self._tape = tape
        self.rover = rover or _rover(settings, world, seed, picture, odometry)
        self.clock = ManualClock(start_utc_s)
        self.downlink_record = DownlinkRecorder()
        self._folder = folder
        self._downlinks = (self.downlink_record, *downlinks)
        self._steps = 0
        self._woken = False
        self._tick_steps = round(settings.tick_s / STEP_S)
        self.executive = self._start()
        self.alive = True
        self._saved: SimulatedJackal | None = None
        if rover is None:  # one with further parts cannot be built again from a recording
            self._saved = self.rover if tape and isinstance(self.rover, SimulatedJackal) else None
            parts = odometry or SimulatedOdometry(), picture or PictureSettings()
            self.record(Simulation(world, seed, *parts).started(self.time_s))

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start."""
        return self.clock.now_s()

    def record(self, item: SimulationItem) -> None:
        """Add an item to the recording, if there is one."""
        if self._tape is not None:
            self._tape.put(item)

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

    def skip(self, limit_s: float = MAX_SKIP_S) -> float:
        """Let time pass at once while the rover rests and only waits; return the seconds.

        Clock and battery continue. Physics, sensors and ticks do not: a condition on telemetry is
        next tested after the skip, and a rover on a slope does not creep. A skip ends before the
        next timer of a plan, a tick before a whole second, and begins `MEASURED_S` after one: in
        between all sensors are measured as usual. Call it after each tick; at other times, and if
        the rover does not rest, it returns 0, and always with a second odometry, which
        would be silent during a skip.
        """
        if not self._waits:
            self._rested_since_s = inf
            return 0.0
        self._rested_since_s = min(self._rested_since_s, self.time_s)
        rested = self.time_s - self._rested_since_s >= RESTED_S
        if not rested or self._steps % _SECOND != round(MEASURED_S / STEP_S):
            return 0.0
        until_s = min(self.time_s + min(limit_s, MAX_SKIP_S), *self._timers_s())
        steps = floor(until_s) * _SECOND - self._tick_steps - self._steps
        if steps <= 0:
            return 0.0
        self.rover.skip(steps * STEP_S)
        self._steps += steps
        self.clock.set(self._steps * STEP_S)
        return steps * STEP_S

    @property
    def _waits(self) -> bool:
        """Whether the rover rests, and the executive has no command and no computation to do."""
        executive = self.executive
        busy = executive.goal_count or executive.waiting or executive.predictions.pending
        return (
            self._skips
            and self.alive
            and not busy
            and executive.velocity == STANDING
            and isinstance(self.rover, SimulatedJackal)
            and self.settings.sensors.second_odometry is None
            and self.rover.resting
        )

    def _timers_s(self) -> Iterator[float]:
        """Yield the ends of the timers of the executing plan, on the clock."""
        tree, utc_s = self.executive.tree, self.clock.utc_s() - self.time_s
        plan = tree.plan if isinstance(tree, RoverTree) else None
        yield inf
        for each in () if plan is None else plan.details():
            if each.next_utc_s is not None and each.next_utc_s - utc_s > self.time_s:
                yield each.next_utc_s - utc_s

    def kill(self) -> None:
        """End the executive as by kill -9: it receives no facts, and does not tick or command."""
        self.record(ExecutiveKilled(self.time_s))
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
            build_tree=self._build_tree,
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
        if self._saved is not None and self._steps % _SECOND == _SAVED_STEP:
            self.record(SimulationState(self.time_s, self._saved.save()))
        if not self.alive:
            return
        for fact in facts:
            self.executive.observe(fact)
        if self._steps % self._tick_steps == 0:
            self.record(Truth(self.time_s, self.rover.true_pose))
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
