"""Interruptions of navigated drives at random ticks, judged by ground truth."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from executive.commands import Mode, MoveTo, Resume, RotateBy, Stop, Waypoint
from executive.settings import NavigationGate
from executive.values.geometry import Velocity
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.stress.navigated_drives import (
    MAX_BRAKING_S,
    MAX_MOVED_M,
    DriveFault,
    DriveResult,
    Watch,
    judge_success,
)
from tests.support.kinematic import STEP_S
from tests.support.navigated import BASE_TIMEOUT_S, BRAKING_MPS2, NavigatedBench, Server
from tests.support.navigation import Navigation

FAR: Final = Waypoint(6.0, 3.0)
NEAR: Final = Waypoint(1.0, -1.0, 0.5)
DEAD_MOVED_M: Final = 0.6 * (0.2 + BASE_TIMEOUT_S + STEP_S) + 0.6**2 / (2 * BRAKING_MPS2)
"""Path without an executive and without its guard: the lock's timeout, the base's, and braking."""
GUARD_S: Final = 0.1
BEHAVIOURS: Final = ("honest", "deaf_to_cancel", "recovers", "never_ends")


@unique
class Interruption(Enum):
    """An event in the middle of a drive."""

    STOP = "stop"
    REPLACE = "another command replaces it"
    JOYSTICK = "the joystick takes over for a while"
    CRASH = "kill -9 of the executive, which is started at once"
    DEAD = "kill -9 of the executive, which is started after a while"
    GUARDED = "the same, and its guard stops the rover"
    KILL = "kill -9 of the navigation"
    KILL_SMOOTHED = "the same, and velocity_smoother drives on"
    FREEZE = "SIGSTOP of the navigation, and later SIGCONT"
    HICCUP = "SIGSTOP of the navigation for less than a second"
    STALE = "odometry is stale for a while"
    BOTH = "kill -9 of executive and navigation"


@dataclass(frozen=True, slots=True)
class Interrupted:
    """One interruption of a drive, by a seed.

    Attributes:
        obeys: whether the navigation obeys a cancel.
    """

    interruption: Interruption
    gate: NavigationGate
    behaviour: str
    obeys: bool
    seed: int

    @property
    def cancels(self) -> bool:
        """Whether its goals can be cancelled."""
        return self.obeys and self.behaviour != "deaf_to_cancel"

    def __str__(self) -> str:
        deaf = "" if self.obeys else ", obeys no cancel"
        return (
            f"{self.interruption.name}, {self.behaviour}{deaf}, gate {self.gate.value},"
            f" seed {self.seed}"
        )


def interruptions(count: int, seed: int) -> Iterator[Interrupted]:
    """Yield so many of each interruption and gate; half of them over a deaf navigation."""
    for gate in NavigationGate:
        for interruption in Interruption:
            if interruption is Interruption.JOYSTICK and gate is NavigationGate.RELAY:
                continue  # there is no mux
            for number in range(count):
                drawn = seed * 1_000_000 + number
                behaviour = BEHAVIOURS[number % len(BEHAVIOURS)]
                obeys = number // len(BEHAVIOURS) % 2 == 0
                yield Interrupted(interruption, gate, behaviour, obeys, drawn)


class Interrupter:
    """Carries one out, and collects what is wrong."""

    def __init__(self, what: Interrupted, bench: NavigatedBench) -> None:
        self.what, self.bench, self.rover = what, bench, bench.rover
        self.random = Random(str(what))
        self.found: list[tuple[DriveFault, str]] = []

    def run(self) -> list[tuple[DriveFault, str]]:
        """Return what is wrong."""
        bench = self.bench
        bench.run(1.0)
        bench.submit(MoveTo(FAR), 1)
        watch = Watch(bench, 1, (FAR,))
        for _ in range(self.random.randrange(1, round(9.0 / STEP_S))):
            watch.step()
        getattr(self, f"_{self.what.interruption.name.lower()}")(watch)
        return self.found

    def _add(self, fault: DriveFault, about: object) -> None:
        self.found.append((fault, f"{self.what}: {about}"))

    def _expect(
        self, result: DriveResult, *ends: Stage | Reason, moved_m: float = MAX_MOVED_M
    ) -> None:
        self.found += judge_success(result, f"{self.what}: {result}")
        if result.stage not in ends and result.reason not in ends:
            self._add(DriveFault.END, result)
        if result.moved_m > moved_m:
            self._add(DriveFault.MOVED, result)

    def _drive_again(self, number: int = 9) -> None:
        """Expect that a next command is executed, over a navigation that is honest again."""
        bench = self.bench
        self.rover.replace_server(Navigation())
        bench.run(3.0)
        if bench.executive.mode is not Mode.IDLE:
            bench.submit(Resume(), number)
            bench.run(0.5)
        target = Waypoint(bench.rover.truth.x_m + 1.0, bench.rover.truth.y_m, 0.5)
        bench.submit(MoveTo(target), number + 1)
        self._expect(Watch(bench, number + 1, (target,)).result(), Stage.EXECUTED)

    def _brakes(self) -> None:
        """Expect that the rover becomes stationary, and stays so for a while."""
        self.bench.run(MAX_BRAKING_S)
        moved_m = self.rover.moved_m
        self.bench.run(6.0)
        if self.rover.moved_m > moved_m + 1e-6:
            self._add(DriveFault.BRAKING, f"moved {self.rover.moved_m - moved_m:.3f} m later")

    def _stop(self, watch: Watch) -> None:
        self.bench.submit(Stop(), 2)
        moved_m = self.rover.moved_m
        self._brakes()
        self._expect(watch.result(10.0), Stage.CANCELLED, Stage.EXECUTED)
        if self.rover.moved_m - moved_m > MAX_MOVED_M:
            self._add(DriveFault.MOVED, f"{self.rover.moved_m - moved_m:.3f} m after the stop")
        if self.bench.finish(2) is not Stage.EXECUTED:
            self._add(DriveFault.END, f"the stop: {self.bench.last(2)}")
        self._drive_again()

    def _replace(self, watch: Watch) -> None:
        del watch
        if self.random.random() < 0.5:
            self.bench.replace(RotateBy(1.0), 2)
            target = None
        else:
            self.bench.replace(MoveTo(NEAR), 2)
            target = NEAR
        stage = self.bench.finish(1, 5.0)
        if stage not in {Stage.CANCELLED, Stage.EXECUTED}:
            self._add(DriveFault.END, self.bench.last(1))
        if target is None:
            if self.bench.finish(2) is not Stage.EXECUTED and self.what.cancels:
                self._add(DriveFault.FALSE_ALARM, self.bench.last(2))
            return
        result = Watch(self.bench, 2, (target,)).result()
        self._expect(result, Stage.EXECUTED, *(() if self.what.cancels else Reason))

    def _joystick(self, watch: Watch) -> None:
        self.rover.joystick = Velocity(self.random.uniform(-0.5, 0.5), self.random.uniform(-1, 1))
        self.bench.run(self.random.uniform(0.1, 4.0))
        if self.rover.moving.travel_mps and not self.rover.joystick.travel_mps:
            self._add(DriveFault.MOVED, "not by the joystick")
        self.rover.joystick = None
        self.bench.run(1.0)
        if watch.ended:
            return
        self.bench.submit(Resume(), 2)
        ends: tuple[Stage | Reason, ...] = (Stage.EXECUTED,)
        self._expect(watch.result(), *(ends if self.what.cancels else (*ends, *Reason)))

    def _ended_by_crash(self, dead_m: float, max_m: float) -> None:
        if dead_m > max_m:
            self._add(DriveFault.MOVED, f"{dead_m:.3f} m without an executive")
        moved_m = self.rover.moved_m
        self.bench.run(8.0)
        moved_m = self.rover.moved_m - moved_m
        # The base may still brake if the executive is back at once.
        if moved_m > (MAX_MOVED_M if dead_m == 0.0 else 0.0):
            self._add(DriveFault.MOVED, f"{moved_m:.3f} m after the restart")
        if not self.bench.stages(1)[-1].terminal:
            self._add(DriveFault.END, f"not ended: {self.bench.last(1)}")
        self._drive_again()

    def _crash(self, watch: Watch) -> None:
        self.bench.crash()
        self._ended_by_crash(0.0, 0.0)

    def _dead(self, watch: Watch) -> None:
        moved_m = self.rover.moved_m
        self.bench.kill(self.random.uniform(1.2, 8.0))
        self._ended_by_crash(self.rover.moved_m - moved_m, DEAD_MOVED_M)

    def _guarded(self, watch: Watch) -> None:
        moved_m = self.rover.moved_m
        self.bench.kill(self.random.uniform(1.2, 8.0), GUARD_S)
        self._ended_by_crash(self.rover.moved_m - moved_m, MAX_MOVED_M + GUARD_S * 0.6)

    def _both(self, watch: Watch) -> None:
        self.rover.set_server(Server.KILLED)
        self._dead(watch)

    def _kill(self, watch: Watch) -> None:
        self.rover.set_server(Server.KILLED)
        self._end_without_server(watch)

    def _kill_smoothed(self, watch: Watch) -> None:
        self.rover.smoother = True
        self._kill(watch)

    def _end_without_server(self, watch: Watch) -> None:
        self._expect(watch.result(), Stage.EXECUTED, Reason.NAVIGATION_TIMEOUT)
        self._drive_again()

    def _freeze(self, watch: Watch) -> None:
        self.rover.set_server(Server.FROZEN)
        frozen_s = self.random.uniform(4.0, 12.0)
        for _ in range(round(frozen_s / STEP_S)):
            watch.step()
        ended, moved_m = watch.ended, self.rover.moved_m
        self.rover.set_server(Server.RUNNING)
        if ended:
            self.bench.run(8.0)
            if self.rover.moved_m > moved_m:
                self._add(DriveFault.MOVED, f"{self.rover.moved_m - moved_m:.3f} m after SIGCONT")
        self._end_without_server(watch)

    def _hiccup(self, watch: Watch) -> None:
        self.rover.set_server(Server.FROZEN)
        for _ in range(self.random.randrange(1, round(0.9 / STEP_S))):
            watch.step()
        self.rover.set_server(Server.RUNNING)
        self._expect(watch.result(), Stage.EXECUTED)

    def _stale(self, watch: Watch) -> None:
        self.rover.odometry_every = 0
        self.bench.run(1.0)
        moved_m = self.rover.moved_m
        self.bench.run(self.random.uniform(0.5, 3.0))
        if self.rover.moved_m > moved_m + 1e-6:
            self._add(DriveFault.MOVED, "without odometry")
        self.rover.odometry_every = 1
        self._expect(watch.result(), Stage.EXECUTED, *Reason)


def interrupt(what: Interrupted, folder: Path) -> list[tuple[DriveFault, str]]:
    """Carry out one interruption; return what is wrong."""
    navigation = Navigation(what.behaviour, what.seed)
    navigation.obeys_cancel = what.obeys
    with NavigatedBench(folder, what.gate, navigation) as bench:
        return Interrupter(what, bench).run()
