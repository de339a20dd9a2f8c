"""Drives by honest and lying navigations, judged by ground truth."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import Enum, unique
from math import hypot, inf, pi
from pathlib import Path
from random import Random
from typing import Final

from executive.commands import FollowPath, Mode, MoveTo, Waypoint
from executive.settings import NavigationGate
from executive.values.geometry import Pose, wrap_rad
from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import Stage
from tests.stress.strange_navigations import StrangeNavigation
from tests.support.kinematic import STEP_S
from tests.support.navigated import NavigatedBench

RANGE_M: Final = 8.0
SENSED_RANGE_M: Final = 4.0
"""The same with all sensors, which take three times as long."""
WATCH_S: Final = 8.0
"""Time for which a rover is watched after the end of its command."""
LIMIT_S: Final = 400.0
MAX_OFF_M, MAX_OFF_RAD = 0.06, 0.1
"""Bounds of a success by ground truth."""
MAX_MOVED_M: Final = 0.15
"""Distance after a failure: braking."""
MAX_BRAKING_S: Final = 0.5
PASSING_M: Final = 0.8
"""Tolerance of waypoints that a navigation may pass without standing."""
TOLERANCE_M: Final = 0.03


@unique
class DriveFault(Enum):
    """Results that a navigated drive must not have."""

    SILENT_SUCCESS = "successes beside the target, or with motion after them"
    FALSE_ALARM = "honest drives that failed"
    END = "ends with another reason than expected"
    LATE = "lies that were detected too late"
    MOVED = "motion after the end"
    BRAKING = "rovers that were not stationary 0.5 s after the end"
    MODE = "modes after the end other than expected"


@dataclass(frozen=True, slots=True)
class Expected:
    """The end that a behaviour must have.

    Attributes:
        reasons: of FAILED; None for EXECUTED.
        known_s: maximum time from the lie to the end.
        modes: after the end.
    """

    reasons: tuple[Reason | None, ...]
    known_s: float = inf
    modes: tuple[Mode, ...] = (Mode.IDLE,)
    moved_m: float = MAX_MOVED_M


EXECUTED: Final = Expected((None,))
OFF_TARGET: Final = Expected((Reason.OFF_TARGET, None), 1.0)
"""It is EXECUTED where the navigation ended within the reach of the executive's own finish."""
TIMEOUT: Final = Expected((Reason.NAVIGATION_TIMEOUT, None), 3.5)
"""The same."""
HONEST: Final = ("honest", "recovers", "slow_start")
EXPECTED: Final = {
    **dict.fromkeys(HONEST, EXECUTED),
    "succeeds_moving": EXECUTED,
    "deaf_to_cancel": EXECUTED,
    "rejects": Expected((Reason.NAVIGATION_REJECTED,), 0.5),
    "never_answers": Expected((Reason.NAVIGATION_TIMEOUT,), 5.5),
    "aborts": Expected((Reason.NAVIGATION_FAILED,), 0.5),
    "aborts_and_drives_on": Expected((Reason.NAVIGATION_FAILED,), 0.5, (Mode.SAFE,)),
    "another_takes_over": Expected((Reason.NAVIGATION_PREEMPTED,), 0.5),
    "silent_midway": Expected((Reason.NAVIGATION_TIMEOUT, None), 1.5, (Mode.IDLE, Mode.SAFE)),
    "frozen_midway": TIMEOUT,
    "restarts_midway": TIMEOUT,
    "never_ends": Expected((None, Reason.DRIVE_DEADLINE)),
    "succeeds_at_once": OFF_TARGET,
    "succeeds_off_target": OFF_TARGET,
    "feedback_lies": OFF_TARGET,
    "succeeds_then_moves": Expected(
        (None, Reason.NAVIGATION_UNCOMMANDED_MOTION), modes=(Mode.SAFE,), moved_m=MAX_OFF_M
    ),
}


DEADLINE: Final = Expected((Reason.DRIVE_DEADLINE,))
MOVED_LATER: Final = Expected(
    (None, Reason.NAVIGATION_UNCOMMANDED_MOTION), modes=(Mode.IDLE, Mode.SAFE), moved_m=MAX_OFF_M
)
EXPECTED_OF_STRANGE: Final = {
    **dict.fromkeys(
        (
            "succeeds_twice",
            "feeds_after_the_result",
            "publishes_zeros",
            "reports_an_earlier_goal",
            "succeeds_off_and_turned",
            "passes_wide",
            "skips_poses",
            "feeds_nonsense",
            "backs_off_at_the_target",
        ),
        EXECUTED,
    ),
    "nearly_silent": Expected((None, Reason.DRIVE_DEADLINE)),  # it mostly stands
    "succeeds_then_aborts": Expected((None, Reason.NAVIGATION_FAILED)),
    **dict.fromkeys(
        ("pauses_at_success", "creeps_after_success", "twitches_after_success"), MOVED_LATER
    ),
    "result_before_acceptance": OFF_TARGET,
    "drives_away_and_succeeds": replace(OFF_TARGET, modes=(Mode.IDLE, Mode.SAFE)),
    "rejects_once": Expected((Reason.NAVIGATION_REJECTED,), 0.5),
    **dict.fromkeys(("oscillates", "drives_away", "spins_at_the_target"), DEADLINE),
    "cancels_itself": Expected((Reason.NAVIGATION_PREEMPTED,), 0.5),
    "loses_the_result": Expected((None, Reason.NAVIGATION_TIMEOUT)),
    "gives_nan": Expected((None, Reason.NAVIGATION_TIMEOUT, Reason.DRIVE_DEADLINE)),
    "races": Expected((None, *Reason), modes=tuple(Mode), moved_m=1.1),
}


@dataclass(frozen=True, slots=True)
class Drive:
    """One command to a rover with a navigation, by a seed.

    Attributes:
        path: whether it is followPath, otherwise moveTo.
        range_m: bound of the coordinates.
        sensed: whether the rover has all sensors, and so all monitors.
    """

    behaviour: str
    gate: NavigationGate
    path: bool
    seed: int
    range_m: float = RANGE_M
    sensed: bool = False

    def __str__(self) -> str:
        command = "followPath" if self.path else "moveTo"
        sensors = ", all sensors" if self.sensed else ""
        return f"{self.behaviour}, {command}, gate {self.gate.value}{sensors}, seed {self.seed}"

    def start(self) -> Pose:
        """Return where the rover stands."""
        random = Random(f"start {self.seed}")
        if self.sensed:
            return Pose()
        return Pose(random.uniform(-1, 1), random.uniform(-1, 1), 0.0, random.uniform(-pi, pi))

    def waypoints(self) -> tuple[Waypoint, ...]:
        """Return one target, or two to four waypoints, some to be passed; half with a heading."""
        random = Random(f"{self.behaviour} {self.path} {self.seed}")
        count = random.randrange(2, 5) if self.path else 1
        return tuple(self._waypoint(random, index + 1 == count) for index in range(count))

    def _waypoint(self, random: Random, last: bool) -> Waypoint:
        x_m, y_m = (random.uniform(-self.range_m, self.range_m) for _ in range(2))
        heading_rad = random.uniform(-pi, pi) if random.random() < 0.5 else None
        if last or random.random() < 0.3:
            return Waypoint(x_m, y_m, heading_rad)
        return Waypoint(x_m, y_m, None, PASSING_M)

    def request(self) -> MoveTo | FollowPath:
        """Return the command."""
        return FollowPath(self.waypoints()) if self.path else MoveTo(self.waypoints()[0])


@dataclass(frozen=True, slots=True)
class DriveResult:
    """How a drive ended, by ground truth.

    Attributes:
        off_m, off_rad: distance to the target at the end, and of the heading if there is one.
        missed_m: how much more than its tolerance it kept away from a waypoint.
        braking_s: time from the end until the rover was stationary.
        moved_m: path after the end.
        known_s: time from the last event of the navigation, or the first request, to the end.
    """

    stage: Stage
    reason: Reason | None
    text: str
    off_m: float
    off_rad: float
    missed_m: float
    braking_s: float
    moved_m: float
    known_s: float
    mode: Mode

    def __str__(self) -> str:
        reason = "" if self.reason is None else f" {self.reason.name}"
        return (
            f"{self.stage.name}{reason} after {self.known_s:.2f} s, {self.off_m:.3f} m and"
            f" {self.off_rad:.3f} rad off, moved {self.moved_m:.3f} m after it, stationary after"
            f" {self.braking_s:.2f} s, then {self.mode.name}: {self.text}"
        )


class Watch:
    """Follows a command to its end and beyond, by ground truth."""

    def __init__(self, bench: NavigatedBench, number: int, waypoints: tuple[Waypoint, ...]) -> None:
        self._bench, self._number, self._waypoints = bench, number, waypoints
        self._nearest_m = [inf] * len(waypoints)
        self._next = 0

    @property
    def ended(self) -> bool:
        stages = self._bench.stages(self._number)
        return bool(stages) and stages[-1].terminal

    def step(self) -> None:
        """Let one tick pass."""
        self._bench.step()
        point = self._bench.rover.truth.point
        while self._next < len(self._waypoints):
            waypoint, nearest_m = self._waypoints[self._next], self._nearest_m
            distance_m = waypoint.point.distance_m(point)
            nearest_m[self._next] = min(nearest_m[self._next], distance_m)
            if distance_m > (waypoint.tolerance_m or MAX_OFF_M):
                break
            self._next += 1

    def result(self, limit_s: float = LIMIT_S) -> DriveResult:
        """Let time pass until the end and beyond it."""
        bench, rover = self._bench, self._bench.rover
        for _ in range(round(limit_s / STEP_S)):
            if self.ended:
                break
            self.step()
        assert self.ended, f"no end within {limit_s} s: {bench.stages(self._number)}"
        report, end_s, braking_s = bench.last(self._number), rover.now_s, 0.0
        moved_m = rover.moved_m
        target, truth = self._waypoints[-1], rover.truth
        off_rad = 0.0
        if target.heading_rad is not None:
            off_rad = abs(wrap_rad(target.heading_rad - truth.heading_rad))
        event_s = rover.last_event_s if rover.last_event_s < inf else rover.first_request_s
        for _ in range(round(WATCH_S / STEP_S)):
            bench.step()
            if not rover.is_stationary:
                braking_s = rover.now_s - end_s
        missed_m = (
            nearest_m - (each.tolerance_m or MAX_OFF_M)
            for each, nearest_m in zip(self._waypoints, self._nearest_m, strict=True)
        )
        assert report.stage is not None
        assert not isinstance(report.reason, UnknownReason)
        return DriveResult(
            report.stage,
            report.reason,
            report.text,
            hypot(target.x_m - truth.x_m, target.y_m - truth.y_m),
            off_rad,
            max(0.0, *missed_m),
            braking_s,
            rover.moved_m - moved_m,
            end_s - event_s,
            bench.executive.mode,
        )


def carry_out(drive: Drive, folder: Path) -> DriveResult:
    """Drive, and watch the rover after the end."""
    navigation = StrangeNavigation(drive.behaviour, drive.seed)
    start, sensed = drive.start(), drive.sensed
    with NavigatedBench(folder, drive.gate, navigation, start=start, sensed=sensed) as bench:
        bench.run(3.0 if sensed else 1.0)
        bench.submit(drive.request(), 1)
        return Watch(bench, 1, drive.waypoints()).result()


def judge(drive: Drive, result: DriveResult) -> Iterator[tuple[DriveFault, str]]:
    """Yield what is wrong with the result of a drive."""
    expected = (EXPECTED | EXPECTED_OF_STRANGE)[drive.behaviour]
    about = f"{drive}: {result}"
    yield from judge_success(result, about)
    if result.reason not in expected.reasons:
        honest = drive.behaviour in HONEST
        yield DriveFault.FALSE_ALARM if honest else DriveFault.END, about
    elif result.reason is not None and result.known_s > expected.known_s + 1e-6:
        yield DriveFault.LATE, about
    if result.moved_m > expected.moved_m:
        yield DriveFault.MOVED, about
    if result.mode not in expected.modes:
        yield DriveFault.MODE, about


def judge_success(result: DriveResult, about: str) -> Iterator[tuple[DriveFault, str]]:
    """Yield whether a success is silent about an error, or the rover goes on moving."""
    if result.stage is Stage.EXECUTED and (
        result.off_m > MAX_OFF_M
        or result.off_rad > MAX_OFF_RAD
        or result.missed_m > 0.0
        or result.moved_m > MAX_OFF_M
    ):
        yield DriveFault.SILENT_SUCCESS, about
    if result.braking_s > MAX_BRAKING_S + 1e-6 and "races" not in about:
        yield DriveFault.BRAKING, about


def drives(
    count: int, seed: int, behaviours: Iterable[str], sensed: bool = False
) -> Iterator[Drive]:
    """Yield so many drives of each behaviour, by each command and gate."""
    for behaviour in behaviours:
        for gate in NavigationGate:
            for path in (False, True):
                for number in range(count):
                    drawn = seed * 1_000_000 + number
                    yield Drive(
                        behaviour, gate, path, drawn, SENSED_RANGE_M if sensed else RANGE_M, sensed
                    )
