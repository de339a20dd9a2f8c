"""Stops and ends of motions on ice, slopes and firm ground, in lock step: does the rover stand?

An end that is EXECUTED while the rover truly moves is false. The same module in another checkout of
the product measures that one.
"""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import hypot, pi, radians, tan
from pathlib import Path
from random import Random
from statistics import median
from tempfile import TemporaryDirectory
from typing import Final

from executive.commands import Command, DriveFor, MoveForward, Request, SetTravelSpeed, Stop
from executive.settings import SecondOdometrySettings, Settings, load_settings
from executive.values.reports import Identity, Report, Stage
from sim.rover import faults
from sim.rover.features import FrictionPatch
from sim.rover.lockstep import LockStep
from sim.rover.world import StartPose, World
from tests.support.figures import Figure, Goal

SENSORS: Final = ("imu", "second", "gaps")
"""Beside wheels and IMU: nothing, a second odometry, one with a gap in its frames at the stop."""
MOVING_MPS: Final = 0.05
LIMIT_S: Final = 25.0
STATIONARY: Final = 1.1
"""Friction over slope on which a rover can be parked. One that slides since before it was started
never stood: its accelerometer cannot tell the slide from the bias that it learns at rest."""
STOP: Final = Identity("MOE", 9)
GO: Final = Identity("MOE", 2)


@dataclass(frozen=True, slots=True)
class Case:
    """One stop, or the end of one motion.

    Attributes:
        friction: of the ground. Half a metre around the start it is firm if `firm_start`, and where
            the rover could not be parked.
        slope_rad, heading_rad: of the ground, which rises towards 0, and of the rover.
        speed_mps, rotate_radps: with which it drives.
        after_s: from the command to the stop; None where the motion ends by itself.
        gap_s: how long no frame of the second odometry arrives.
    """

    seed: int
    friction: float
    slope_rad: float
    heading_rad: float
    speed_mps: float
    rotate_radps: float
    firm_start: bool
    sensors: str
    after_s: float | None
    gap_s: float

    @property
    def ground(self) -> str:
        """Ice or firm."""
        return "ice" if self.friction < 0.3 else "firm"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of it.

    Attributes:
        stage, text: of the last report.
        took_s: from the stop, or from when the rover stood at the end of the motion.
        true_mps: how fast the rover truly went when that was reported.
        before_mps: the same when the stop was given.
        off_m: how far the rover truly is from where it believes to be.
        slid_m: slide that the inertial sensors felt.
        uncertain_m: how uncertain the position is said to be.
    """

    stage: str
    reason: str
    text: str
    took_s: float
    true_mps: float
    before_mps: float
    off_m: float
    slid_m: float
    uncertain_m: float
    reported: str

    @property
    def executed(self) -> bool:
        """Whether the rover is said to stand."""
        return self.stage == Stage.EXECUTED.name

    @property
    def false(self) -> bool:
        """Whether it is said to stand, and moves."""
        return self.executed and self.true_mps > MOVING_MPS


def cases(ice: int, firm: int, seed: int) -> list[Case]:
    """Return so many on ice, and on firm ground: a third with each set of sensors."""
    random, found = Random(seed), []
    for number in range(ice + firm):
        icy = number < ice
        speed_mps = random.uniform(0.3, 1.0)
        ends = random.random() < 0.25
        after_s = random.uniform(speed_mps + 0.2, speed_mps + 2.5)
        found.append(
            Case(
                seed=random.randrange(10**6),
                friction=random.uniform(0.05, 0.2) if icy else 0.6,
                slope_rad=radians(random.choice((0.0, random.uniform(0.0, 5.0)))),
                heading_rad=random.uniform(-pi, pi),
                speed_mps=speed_mps,
                rotate_radps=random.choice((0.0, 0.0, -0.3, 0.3)),
                firm_start=random.random() < 0.5,
                sensors=SENSORS[number % len(SENSORS)],
                after_s=None if ends else after_s,
                gap_s=random.uniform(1.5, 4.0),
            )
        )
    return found


def settings_of(sensors: str) -> Settings:
    jackal = load_settings("jackal")
    if sensors == "imu":
        return jackal
    second = SecondOdometrySettings(2, False)
    return replace(jackal, sensors=replace(jackal.sensors, second_odometry=second))


def world_of(case: Case) -> World:
    firm = (FrictionPatch(x_m=0.0, y_m=0.0, length_m=1.0, width_m=1.0, friction=0.6),)
    return World(
        slope_rad=case.slope_rad,
        friction=case.friction,
        patches=firm
        if case.firm_start or case.friction <= STATIONARY * tan(case.slope_rad)
        else (),
        start=StartPose(heading_rad=case.heading_rad),
    )


class Run:
    """One case, played."""

    def __init__(self, case: Case, folder: Path) -> None:
        self.case = case
        self.lock = LockStep(settings_of(case.sensors), world_of(case), folder, case.seed)

    @property
    def true_mps(self) -> float:
        """How fast the rover truly goes."""
        return hypot(*self.lock.rover.data.qvel[:2].tolist())

    def submit(self, identity: Identity, request: Request) -> None:
        self.lock.submit(Command(identity, request, "direct"))

    def last(self, identity: Identity) -> Report:
        return [each for each in self.lock.downlink_record.reports if each.identity == identity][-1]

    def ended(self, identity: Identity) -> bool:
        last = self.last(identity)
        return last.stage is not None and last.stage.terminal

    def play(self) -> Outcome:
        """Play it."""
        case, lock = self.case, self.lock
        lock.run(2.0)
        self.submit(Identity("MOE", 1), SetTravelSpeed(case.speed_mps))
        lock.run(0.1)
        if case.after_s is None:
            distance_m = case.speed_mps * 2.0
            request: Request = (
                MoveForward(distance_m)
                if case.rotate_radps == 0.0
                else DriveFor(case.speed_mps, case.rotate_radps, 2.5)
            )
            self.submit(GO, request)
            return self.finish(GO)
        self.submit(GO, DriveFor(case.speed_mps, case.rotate_radps, 50.0))
        lock.run(case.after_s)
        self.submit(STOP, Stop())
        return self.finish(STOP)

    def finish(self, identity: Identity) -> Outcome:
        """Wait for its end; the second odometry may have its gap first."""
        lock, case = self.lock, self.case
        before_mps, began_s = self.true_mps, lock.time_s
        gap_until_s = began_s + (case.gap_s if case.sensors == "gaps" else -1.0)
        standstill_s = None if identity == GO else began_s
        if case.sensors == "gaps":
            lock.rover.inject(faults.SecondOdometryLost())
        while not self.ended(identity) and lock.time_s < began_s + LIMIT_S:
            lock.run(0.01)
            if 0.0 < gap_until_s <= lock.time_s:
                lock.rover.clear(faults.SecondOdometryLost)
                gap_until_s = -1.0
            if identity == GO and lock.executive.velocity.travel_mps != 0.0:
                standstill_s = lock.time_s
        last, true_mps = self.last(identity), self.true_mps
        pose = lock.executive.status.pose
        off_m = pose.point.distance_m(lock.rover.true_pose.point)
        over_ground = lock.executive.safety.history.over_ground
        slid_m = 0.0 if over_ground is None else over_ground.slid_m
        uncertain_m = lock.executive.status.uncertainty.position_m
        lock.executive.simulate_crash()
        assert last.stage is not None
        reported = [
            r.text
            for r in lock.downlink_record.reports
            if r.identity == identity and r.stage is Stage.PROGRESS
        ]
        took_s = lock.time_s - (standstill_s or began_s)
        reason = "" if last.reason is None else last.reason.name
        return Outcome(
            last.stage.name,
            reason,
            last.text,
            took_s,
            true_mps,
            before_mps,
            off_m,
            slid_m,
            uncertain_m,
            reported[-1] if reported else "",
        )


def play(case: Case) -> Outcome:
    """Play a case in a folder of its own."""
    with TemporaryDirectory() as folder:
        return Run(case, Path(folder)).play()


def measure(ice: int, firm: int, seed: int, log: Callable[[str], object]) -> list[Figure]:
    """Play so many cases on ice and on firm ground; return what came of them."""
    groups: dict[tuple[str, str], list[Outcome]] = defaultdict(list)
    for case in cases(ice, firm, seed):
        outcome = play(case)
        if outcome.false:
            log(f"false: {case}: {outcome}")
        what = "motion" if case.after_s is None else "stop"
        groups[f"{case.ground} {what}", case.sensors].append(outcome)
    return [figure for names, found in sorted(groups.items()) for figure in _figures(names, found)]


def _figures(names: tuple[str, str], found: list[Outcome]) -> list[Figure]:
    name, beside = ", ".join(names), f"of {len(found)}"
    done = [each for each in found if each.executed]
    figures = [
        Figure(f"{name}: false", sum(each.false for each in found), "", beside, Goal(0)),
        Figure(f"{name}: EXECUTED", len(done), "", beside),
    ]
    took_s = [each.took_s for each in done]
    return [*figures, Figure(f"{name}: median", median(took_s), "s")] if took_s else figures
