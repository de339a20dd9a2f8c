"""`Forkable` makes forks of a recording, which is read once; `whatif` answers a question by them.

A fork of a scenario in lock step runs it again from its first entry on, with the recorded settings,
ledger, world, seed, commands and faults, and with the changes. Up to the first decision that
differs it is the recorded run to the last bit. Other recordings are replayed up to that decision,
and continued (`sim.fork.continued`).
"""

import tempfile
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import cached_property, partial
from math import inf
from pathlib import Path
from shutil import move
from typing import Final

from adapters.explanation import explain_now
from adapters.recording import (
    RecordingError,
    RunFile,
    RunReader,
    missing_for_fork,
    read_history,
)
from adapters.recording.replayed import read_entries, write_files
from executive.core.recording import (
    CargoChanged,
    ProcessStart,
    RecordingSink,
    RecordingTee,
    SimulatedFaultChanged,
    SimulationStarted,
    SimulationState,
    TimelinePlayed,
    TimelineStarted,
)
from executive.record import LedgerError
from executive.settings import LocomotionKind, Settings, SettingsError
from executive.values.geometry import Pose
from sim.fork.changed import changed_settings, changed_timeline, identities
from sim.fork.continued import ContinuedLockStep
from sim.fork.model import Change, Fidelity, ForkOutcome, ForkRun, Placing, WhatIf
from sim.fork.noise import change_noise
from sim.fork.placing import PlacedRover
from sim.fork.run_log import RunLog, first_difference
from sim.rover import Rock, StartPose, World
from sim.rover.lockstep import STEP_S, LockStep
from sim.rover.simulation import Simulation, fault_of
from sim.scenario.expect_rover import PoseIs, WorldPose
from sim.scenario.lockstep_run import LockstepRun, run_in_lock_step
from sim.scenario.model import Cargo, Clear, Entry, Inject, Scenario, Send
from sim.scenario.reading import read_timeline
from sim.scenario.record import ALMOST_S, AdmittedRequest, Answer, Record, SentCommand

SCANNED_M: Final = 0.5
"""Height of measured obstacles, above the plane of the laser; chosen."""
MAX_EXTRA_S: Final = 60.0
"""Maximum time of a fork after the end of the recording, for commands that have not ended."""
SETTLING_S: Final = 2.0
"""Time of a fork after the last end of a command; chosen."""
_ANY: Final = (PoseIs(pose=WorldPose(0.0, 0.0), tolerance_m=inf),)
"""A scenario needs an expectation; a fork has none."""


class Forkable:
    """A recording that can be forked; each fork is independent, also in a forked process.

    Args:
        path: recording.
        exact: whether the recorded simulation is used; otherwise only the poses are.

    Attributes:
        recorded: the recorded run itself.
        settings: the recorded settings.
        timeline: its commands and faults, with the times or reports that they wait for.

    Raises:
        RecordingError: the file cannot be used.
    """

    def __init__(self, path: Path, exact: bool = True) -> None:
        self._path, reader = path, RunReader(path)
        self._steps = tuple(read_entries(reader))
        self._log = log = RunLog.read(self._steps, reader)
        starts = [each for each in log.simulation if isinstance(each, ProcessStart)]
        if not starts or log.core_s is None or not log.now_s:
            raise RecordingError(f"{path}: contains no run from its start")
        self._start, self._whole = starts[0], reader.whole
        cut = () if reader.whole else (f"the recording is truncated: it ends at {log.now_s:.1f} s",)
        self.settings: Settings = self._start.settings
        try:
            self._simulation = self._simulated() if exact else None
            self.timeline, self._played_s = self._sent()
        except ValueError as error:
            raise RecordingError(f"{path}: {error}") from error
        self._lacks = (*missing_for_fork(log.kinds | {SimulationState}), *cut)
        self.recorded = self._run(log, self.timeline)

    def _run(self, log: RunLog, timeline: Sequence[Entry]) -> ForkRun:
        """Return the run of a log with the commands of a timeline."""
        sent = identities(timeline).values()
        record = Record(
            log.utc_s,
            self._path,
            reports=log.reports,
            poses=log.poses,
            requested=[AdmittedRequest(*each) for each in log.requests.items()],
            sendings=[SentCommand(str(each), each, 0.0, Answer.ACCEPTED) for each in sent],
            simulated_s=log.now_s,
        )
        outcome = ForkOutcome(
            end_s=log.now_s,
            commands=log.outcomes(),
            pose=log.pose_at(log.now_s),
            track=log.track(),
            lacks=self._lacks,
        )
        return ForkRun(outcome, record, tuple(log.odometry), tuple(log.decisions))

    def fork(
        self,
        change: Change,
        at_s: float | None = None,
        seed: int | None = None,
        out: Path | None = None,
    ) -> ForkRun:
        """Return the fork with a change.

        Args:
            change: an empty one for the fork without a change.
            at_s: time of added commands that have none, and of the seed.
            seed: seed of the noise from `at_s` on; None for the recorded noise.
            out: file for a recording of the fork; None for none.

        Raises:
            SettingsError: the change does not fit the recording.
        """
        log, simulation = RunLog(), self._simulation or Simulation(World(start=self._origin))
        scenario = Scenario(
            title="fork",
            asset=self.settings.asset,
            settings=changed_settings(self.settings, change),
            world=self._scanned if change.scans else change.world or simulation.world,
            odometry=simulation.odometry,
            seed=simulation.seed if change.seed is None else change.seed,
            duration_s=self._log.now_s + MAX_EXTRA_S,
            timeline=changed_timeline(self.timeline, change, at_s),
            expect=_ANY,
        )
        run = partial(
            _ForkedRun,
            end_s=self._log.now_s,
            extends=change != (Change() if self.has_world else _assumption(change)),
            noise=None if seed is None else (at_s or 0.0, seed),
        )
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rover-fork-")))
            try:
                write_files(self._start, folder)
                tape = None if out is None else stack.enter_context(closing(RunFile(out)))
            except (OSError, ValueError) as error:
                raise SettingsError(f"files of the fork: {error}") from error
            sink = log if tape is None else RecordingTee(log, tape)
            placing = Placing.PHYSICS
            utc_s, played = self._log.utc_s, TimelineStarted in self._log.kinds
            try:
                if self._simulation and played:
                    record = run_in_lock_step(scenario, folder, sink, start_utc_s=utc_s, run=run)
                    contacts = record.contacts
                else:
                    args = scenario, change, at_s, folder, sink, run
                    contacts, placing, at_s = self._continue(*args)
            except LedgerError as error:
                raise RecordingError(f"{self._path}: {error}") from error
        made = self._run(log, scenario.timeline)
        made.record.contacts, difference = contacts, first_difference(self.recorded, made)
        outcome = replace(
            made.outcome,
            at_s=difference.time_s if difference and at_s is None else at_s,
            placing=placing,
            seed=scenario.seed if seed is None else seed,
            contacts=contacts,
            first_difference=difference,
        )
        return replace(made, outcome=outcome)

    def unchanged(
        self, at_s: float | None = None, assumed: Change | None = None
    ) -> tuple[ForkRun, Fidelity]:
        """Return the fork without a change, and how well it reproduces the recording.

        Args:
            at_s: time of the fork; None for before the first command.
            assumed: world and seed that the recording lacks.
        """
        run = self.fork(assumed or Change(), at_s)
        begin_s = run.outcome.at_s or 0.0
        if run.outcome.placing is not Placing.PHYSICS and (
            begin_s + self.settings.tick_s > self._log.now_s + ALMOST_S
        ):
            return run, Fidelity.NOT_COMPARED
        # The last instant of a truncated file may be incomplete, and a live run ends by a call.
        is_complete = self._whole and TimelineStarted in self._log.kinds
        end_s = self._log.now_s + (ALMOST_S if is_complete else 0.0)
        if _until(run, end_s) == _until(self.recorded, end_s):
            return run, Fidelity.BIT_EQUAL
        same = run.outcome.kinds == self.recorded.outcome.kinds
        return run, Fidelity.SAME_OUTCOMES if same else Fidelity.DIFFERENT

    def _continue(
        self,
        scenario: Scenario,
        change: Change,
        at_s: float | None,
        folder: Path,
        sink: RecordingSink,
        run: "Callable[[Scenario, LockStep, Record], _ForkedRun]",
    ) -> tuple[int, Placing, float]:
        """Replay up to the seam and continue; return contacts, placing and time of the seam."""
        if self.settings.locomotion is not LocomotionKind.VELOCITY:
            raise SettingsError("a rover of whole motions is forked only with its scenario")
        world, settings = self._simulation and self._simulation.world, scenario.settings
        base = self._simulation or Simulation(scenario.world)
        simulation = replace(base, world=scenario.world, seed=scenario.seed)
        parts = (self.settings.sensors, self.settings.mux)
        same = simulation == self._simulation and parts == (settings.sensors, settings.mux)
        latest_s = self._latest_s(scenario.timeline, change, at_s)
        late = SimulationStarted not in self._log.kinds
        try:
            rover = PlacedRover(settings, simulation, same, scenario.world == world, late)
            lock = ContinuedLockStep(self._steps, settings, rover, latest_s, folder, sink)
        except ValueError as error:
            raise SettingsError(f"the rover cannot be simulated from there: {error}") from error
        core_s = self._log.core_s or 0.0
        played = {i: s for i, s in self._played_s.items() if s <= lock.seam_s + ALMOST_S}
        forked = run(scenario, lock, Record(self._log.utc_s, folder))
        for index, time_s in played.items():
            sink.put(TimelinePlayed(time_s + core_s, index))
        forked.continue_behind(played, self._log.contacts_s)
        lock.executive.simulate_crash()
        return lock.rover.contacts, lock.placing, lock.seam_s

    def _latest_s(self, timeline: Sequence[Entry], change: Change, at_s: float | None) -> float:
        """Return the latest time of the seam: before each entry that is changed or added."""
        pairs = enumerate(zip(self.timeline, timeline, strict=False))
        changed = [self._played_s.get(index, inf) for index, (a, b) in pairs if a != b]
        added = (each.at_s for each in timeline[len(self.timeline) :] if each.at_s is not None)
        is_same = change == _assumption(change)
        first = min(self._played_s.values(), default=1.0) if is_same and at_s is None else inf
        before = [each - STEP_S for each in (first, *changed)]
        return min([*before, *added, *([] if at_s is None else [at_s])])

    @cached_property
    def _scanned(self) -> World:
        """Level ground with the obstacles that the laser measured until the end."""
        with tempfile.TemporaryDirectory(prefix="rover-fork-") as folder:
            rover = PlacedRover(self.settings, Simulation(World(start=self._origin)), exact=False)
            args = self._steps, self.settings, rover, inf, Path(folder), RunLog()
            lock = ContinuedLockStep(*args)
            found = lock.executive.status.obstacles.scanned
            lock.executive.simulate_crash()
        rocks = tuple(Rock(each.x_m, each.y_m, each.radius_m, SCANNED_M) for each in found)
        return World(name="scans", rocks=rocks, start=self._origin)

    @property
    def has_world(self) -> bool:
        """Whether world and seed are recorded."""
        return self._simulation is not None

    @property
    def _origin(self) -> StartPose:
        """First pose of the recording."""
        poses = self._log.truths or self._log.odometry
        pose = poses[0].pose if poses else Pose()
        return StartPose(pose.x_m, pose.y_m, pose.heading_rad)

    def _simulated(self) -> Simulation | None:
        found = (each for each in self._log.simulation if isinstance(each, SimulationStarted))
        item = next(found, None)
        return None if item is None else Simulation.of(item)

    def _sent(self) -> tuple[tuple[Entry, ...], dict[int, float]]:
        """Return the timeline: that of the scenario, or commands and faults at their times.

        Also the time of each entry that was carried out, by its index.
        """
        items, core_s = self._log.simulation, self._log.core_s or 0.0
        for item in items:
            if isinstance(item, TimelineStarted):
                timeline = read_timeline(item.text)
                played = (each for each in items if isinstance(each, TimelinePlayed))
                known = (each for each in played if 0 <= each.index < len(timeline))
                return timeline, {each.index: each.time_s - core_s for each in known}
        sent = sorted([*self._log.sent, *self._events()], key=lambda each: each.at_s or 0.0)
        return tuple(sent), {index: each.at_s or 0.0 for index, each in enumerate(sent)}

    def _events(self) -> Iterator[Entry]:
        core_s = self._log.core_s or 0.0
        for item in self._log.simulation:
            if isinstance(item, CargoChanged):
                yield Cargo(at_s=item.time_s - core_s, cargo_kg=item.mass_kg)
            elif isinstance(item, SimulatedFaultChanged):
                fault, at_s = fault_of(item), item.time_s - core_s
                ends = Clear(at_s=at_s, clear=type(fault))
                yield Inject(at_s=at_s, inject=fault) if item.injected else ends


class _ForkedRun(LockstepRun):
    """Run of a fork: to the end of the recording, or of the commands that last longer.

    Args:
        end_s: end of the recording.
        extends: whether commands continue after that.
        noise: time of the change to other noise, and its seed.
    """

    def __init__(
        self,
        scenario: Scenario,
        lock: LockStep,
        record: Record,
        *,
        end_s: float,
        extends: bool,
        noise: tuple[float, int] | None,
    ) -> None:
        super().__init__(scenario, lock, record)
        self._until_s, self._extends, self._noise = end_s - ALMOST_S, extends, noise
        self._contacts_s: Sequence[float] | None = None

    def continue_behind(self, played: Mapping[int, float], contacts_s: Sequence[float]) -> None:
        """Run from the present time on.

        Args:
            played: entries that were carried out before, and their times.
            contacts_s: times of contacts with the ground in the recording, and so in the fork.
        """
        for index, time_s in played.items():
            entry = self._entries[index]
            if isinstance(entry, Send):
                label, command = self._ground.command(entry, self._record.start_utc_s + time_s)
                sent = SentCommand(label, command.identity, time_s, Answer.ACCEPTED)
                self._record.sendings.append(sent)
        self._timeline.leave_out(played)
        self._contacts_s = contacts_s
        self.run()

    @property
    def in_contact(self) -> bool:
        """Whether an executive runs, and the link is up, as far as the recording lasts."""
        now_s, before_s = self._lock.time_s, self._lock.time_s - 2 * self._tick_steps * STEP_S
        if self._contacts_s is None or now_s > self._until_s:
            return super().in_contact
        index = bisect_left(self._contacts_s, before_s)
        recorded = index < len(self._contacts_s) and self._contacts_s[index] <= now_s + ALMOST_S
        return recorded and super().in_contact

    @property
    def has_ended(self) -> bool:
        """Whether recording and commands have ended."""
        lock = self._lock
        if self._extends and lock.alive and lock.executive.goal_count:
            self._until_s = max(self._until_s, lock.time_s + SETTLING_S)
        return lock.time_s >= self._until_s

    def observe(self) -> None:
        """Sample the rover after a tick; change the noise at its time."""
        super().observe()
        if self._noise is not None and self._lock.time_s >= self._noise[0]:
            change_noise(self._lock.rover, self._noise[1])
            self._noise = None


def whatif(
    path: Path,
    change: Change,
    at_s: float | None = None,
    seeds: int = 1,
    out: Path | None = None,
) -> WhatIf:
    """Return the answer to a question: the fork without the change, then those with it.

    Both leave the recording at the same time; only if the first reproduces it, the others count.

    Args:
        path: recording.
        change: change to answer for.
        at_s: time of added commands, and of the change to other noise in further forks; for the
            latter None is the time of the first difference.
        seeds: number of forks, the first one with the recorded noise.
        out: file for a recording of the first fork; None for none.

    Raises:
        RecordingError: the file cannot be used.
        SettingsError: the change does not fit the recording.
    """
    run = Forkable(path)
    end_s = run.recorded.outcome.end_s
    if at_s is not None and at_s > end_s + ALMOST_S:
        raise SettingsError(f"--at {at_s:g} is after the end of the recording, {end_s:g} s")
    assumed = Change() if run.has_world else _assumption(change)
    forks: list[ForkOutcome] = []
    with tempfile.TemporaryDirectory(prefix="rover-fork-") as folder:
        file = Path(folder, "fork.mcap")
        first = None if change == assumed else run.fork(change, at_s, out=file)
        begin_s = at_s if first is None else first.outcome.at_s
        unchanged, fidelity = run.unchanged(begin_s, assumed)
        if first is not None and fidelity is not Fidelity.DIFFERENT:
            # A live run decides later, by its disk, than any fork of it.
            caused = first_difference(unchanged, first)
            outcome = replace(first.outcome, first_difference=caused)
            forks.append(_explained(outcome, path, file))
            forks += (run.fork(change, begin_s, seed).outcome for seed in range(1, seeds))
            if out is not None:
                move(file, out)
    return WhatIf(
        recording=str(path),
        recorded=run.recorded.outcome,
        unchanged=unchanged.outcome,
        fidelity=fidelity,
        forks=tuple(forks),
    )


def _until(run: ForkRun, end_s: float) -> tuple[Sequence[object], Sequence[object]]:
    """Return the decisions and poses of a run before a time."""
    decisions = [each for each in run.decisions if each[0] < end_s]
    return decisions, [each for each in run.record.poses if each.time_s < end_s]


def _assumption(change: Change) -> Change:
    """Return the part of a change that a recording without a simulation lacks."""
    return Change(world=change.world, scans=change.scans, seed=change.seed)


def _explained(outcome: ForkOutcome, recorded: Path, forked: Path) -> ForkOutcome:
    """Return an outcome with the reasons of both runs at the first difference."""
    difference = outcome.first_difference
    if difference is None:
        return outcome
    then, now = (_why(path, difference.time_s) for path in (recorded, forked))
    explained = replace(difference, recorded_why=then, forked_why=now)
    return replace(outcome, first_difference=explained)


def _why(path: Path, at_s: float) -> str:
    """Return the first cause of a run's state at a time, with its figures, or the last before."""
    history, began_utc_s = read_history(path, at_s)
    explanation = explain_now(history)
    causes = [each for each in explanation.steps if each.utc_s is not None]
    now = [each for each in causes if (each.utc_s or 0.0) >= began_utc_s + at_s - ALMOST_S]
    text = next((each.text for each in (*now, *causes[-1:])), explanation.headline)
    return text + "".join(f", {each}" for each in explanation.evidence)
