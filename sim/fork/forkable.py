"""`Forkable` makes forks of a recording, which is read once; `whatif` answers a question by them.

A fork is the recorded scenario again: from its first entry on, with the recorded settings, ledger,
world, seed, commands and faults, and with the changes. Up to the first decision that differs it is
the recorded run to the last bit.
"""

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Final

from adapters.explanation import explain_now
from adapters.recording import (
    RecordingError,
    RunFile,
    RunReader,
    missing_for_fork,
    read_history,
)
from adapters.recording.replayed import write_files
from executive.core.recording import (
    CargoChanged,
    ProcessStart,
    RecordingTee,
    SimulatedFaultChanged,
    SimulationStarted,
    SimulationState,
    TimelineStarted,
)
from executive.settings import Settings, SettingsError
from sim.fork.changed import changed_settings, changed_timeline, identities
from sim.fork.model import Change, Fidelity, ForkOutcome, ForkRun, Placing, WhatIf
from sim.fork.noise import change_noise
from sim.fork.run_log import RunLog, first_difference
from sim.rover import StartPose, World
from sim.rover.lockstep import LockStep
from sim.rover.simulation import Simulation, fault_of
from sim.scenario.expect_rover import PoseIs, WorldPose
from sim.scenario.lockstep_run import LockstepRun, run_in_lock_step
from sim.scenario.model import Cargo, Clear, Entry, Inject, Scenario
from sim.scenario.reading import read_timeline
from sim.scenario.record import ALMOST_S, AdmittedRequest, Answer, Record, SentCommand

MAX_EXTRA_S: Final = 60.0
"""Maximum time of a fork after the end of the recording, for commands that have not ended."""
SETTLING_S: Final = 2.0
"""Time of a fork after the last end of a command; chosen."""
_ANY: Final = (PoseIs(pose=WorldPose(0.0, 0.0), tolerance_m=inf),)
"""A scenario needs an expectation; a fork has none."""


class Forkable:
    """A recording that can be forked; each fork is independent, also in a forked process.

    Attributes:
        recorded: the recorded run itself.
        settings: the recorded settings.
        timeline: its commands and faults, with the times or reports that they wait for.

    Raises:
        RecordingError: the file cannot be used.
    """

    def __init__(self, path: Path) -> None:
        self._log = log = RunLog.read(RunReader(path))
        starts = [each for each in log.simulation if isinstance(each, ProcessStart)]
        if not starts or log.core_s is None:
            raise RecordingError(f"{path}: contains no run from its start")
        self._start = starts[0]
        self.settings: Settings = self._start.settings
        try:
            self._simulation, self._placing = self._simulated()
            self.timeline = self._sent()
        except ValueError as error:
            raise RecordingError(f"{path}: {error}") from error
        sendings = [
            SentCommand(str(each), each, 0.0, Answer.ACCEPTED)
            for each in identities(self.timeline).values()
        ]
        record = Record(
            log.utc_s,
            path,
            reports=log.reports,
            poses=log.truths,
            requested=[AdmittedRequest(*each) for each in log.requests.items()],
            sendings=sendings,
            simulated_s=log.now_s,
        )
        outcome = ForkOutcome(
            at_s=None,
            placing=None,
            seed=None,
            end_s=log.now_s,
            commands=log.outcomes(),
            pose=log.pose_at(log.now_s),
            contacts=None,
            track=log.track(),
            lacks=missing_for_fork(log.kinds | {SimulationState}),
        )
        self.recorded = ForkRun(outcome, record, tuple(log.odometry))

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
        return self._fork(change, at_s, seed, out)[0]

    def _fork(
        self, change: Change, at_s: float | None, seed: int | None = None, out: Path | None = None
    ) -> tuple[ForkRun, RunLog]:
        log, simulation = RunLog(), self._simulation
        scenario = Scenario(
            title="fork",
            asset=self.settings.asset,
            settings=changed_settings(self.settings, change),
            world=change.world or simulation.world,
            odometry=simulation.odometry,
            seed=simulation.seed if change.seed is None else change.seed,
            duration_s=self._log.now_s + MAX_EXTRA_S,
            timeline=changed_timeline(self.timeline, change, at_s),
            expect=_ANY,
        )
        run = partial(
            _ForkedRun,
            end_s=self._log.now_s,
            extends=change != Change(),
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
            record = run_in_lock_step(scenario, folder, sink, start_utc_s=self._log.utc_s, run=run)
        difference = first_difference(self._log, log)
        outcome = ForkOutcome(
            at_s=difference.time_s if difference and at_s is None else at_s,
            placing=self._placing,
            seed=scenario.seed if seed is None else seed,
            end_s=log.now_s,
            commands=log.outcomes(),
            pose=log.pose_at(log.now_s),
            contacts=record.contacts,
            track=log.track(),
            first_difference=difference,
            lacks=self.recorded.outcome.lacks,
        )
        return ForkRun(outcome, record, tuple(log.odometry)), log

    def unchanged(self, at_s: float | None = None) -> tuple[ForkRun, Fidelity]:
        """Return the fork without a change, and how well it reproduces the recording."""
        run, log = self._fork(Change(), at_s)
        # The last instant of a truncated file may be incomplete.
        if log.until(self._log.now_s) == self._log.until(self._log.now_s):
            return run, Fidelity.BIT_EQUAL
        same = run.outcome.kinds == self.recorded.outcome.kinds
        return run, Fidelity.SAME_OUTCOMES if same else Fidelity.DIFFERENT

    def _simulated(self) -> tuple[Simulation, Placing]:
        """Return the simulation to fork in, and how its rover is put into it."""
        for item in self._log.simulation:
            if isinstance(item, SimulationStarted):
                return Simulation.of(item), Placing.PHYSICS
        pose = self._log.pose_at(inf if not self._log.odometry else self._log.odometry[0].time_s)
        start = StartPose() if pose is None else StartPose(pose.x_m, pose.y_m, pose.heading_rad)
        placing = Placing.TRUE_POSE if self._log.truths else Placing.ODOMETRY
        return Simulation(World(start=start)), placing

    def _sent(self) -> tuple[Entry, ...]:
        """Return the timeline: that of the scenario, or commands and faults at their times."""
        for item in self._log.simulation:
            if isinstance(item, TimelineStarted):
                return read_timeline(item.text)
        return tuple(sorted([*self._log.sent, *self._events()], key=lambda each: each.at_s or 0.0))

    def _events(self) -> Iterator[Entry]:
        for item in self._log.simulation:
            if isinstance(item, SimulatedFaultChanged):
                fault, at_s = fault_of(item), item.time_s - (self._log.core_s or 0.0)
                injects = item.injected
                yield (
                    Inject(at_s=at_s, inject=fault)
                    if injects
                    else Clear(at_s=at_s, clear=type(fault))
                )
            elif isinstance(item, CargoChanged):
                yield Cargo(at_s=item.time_s - (self._log.core_s or 0.0), cargo_kg=item.mass_kg)


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
    """Return the answer to a question: the fork without the change first, then those with it.

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
    changed_settings(run.settings, change)
    changed_timeline(run.timeline, change, at_s)
    unchanged, fidelity = run.unchanged(at_s)
    forks: list[ForkOutcome] = []
    if fidelity is not Fidelity.DIFFERENT and change != Change():
        with tempfile.TemporaryDirectory(prefix="rover-fork-") as folder:
            file = out or Path(folder, "fork.mcap")
            forks.append(_explained(run.fork(change, at_s, out=file).outcome, path, file))
        forks += (run.fork(change, forks[0].at_s, seed).outcome for seed in range(1, seeds))
    return WhatIf(
        recording=str(path),
        recorded=run.recorded.outcome,
        unchanged=unchanged.outcome,
        fidelity=fidelity,
        forks=tuple(forks),
    )


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
