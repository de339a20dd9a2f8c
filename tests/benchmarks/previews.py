"""How well previews foretell: random motions, each previewed and then driven in lock step."""

import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import hypot, pi
from pathlib import Path
from random import Random
from statistics import median
from typing import Final

from executive.commands import (
    Command,
    DriveFor,
    FollowPath,
    Motion,
    MoveForward,
    MoveTo,
    RotateBy,
    RotateTo,
    Waypoint,
)
from executive.preview import Preview
from executive.settings import Controller, DriveLimits, Settings, load_settings
from executive.values.geometry import Pose, wrap_rad
from executive.values.reasons import Refusal
from executive.values.reports import Identity, Stage
from sim.rover import World
from sim.rover.lockstep import LockStep
from tests.benchmarks.competitors import OWN
from tests.support.figures import Figure, Goal, quantile

BRICK: Final = "brick"
"""Drives MOCUP."""
REST_S: Final = 0.5
LIMIT_S: Final = 200.0
NEAR_S: Final = 4.0
"""Targets lie in a square about the origin that is twice as far across as this takes."""
IN_TIME: Final = 0.05
"""Of the duration, by which a preview may be wrong."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One motion, previewed and driven.

    Attributes:
        off_s, off_j: what it took beyond its preview; energy by the battery of the simulation.
        off_m, off_rad: in truth, from where the preview has it end, seen from where it began.
    """

    motion: Motion
    preview: Preview
    off_s: float
    off_m: float
    off_rad: float
    off_j: float

    @property
    def in_time(self) -> bool:
        """Whether it took what it was to take, to 5 % of that."""
        return abs(self.off_s) <= IN_TIME * self.preview.duration_s

    @property
    def within(self) -> bool:
        """Whether place and heading are within two sigma."""
        return self.off_m <= self.preview.within_m and self.off_rad <= self.preview.within_rad


def random_motion(random: Random, controller: Controller | None, drive: DriveLimits) -> Motion:
    """Return a motion to near the origin, or one that leads from anywhere to not far from there."""
    near_m = NEAR_S * drive.travel_speed_mps
    match random.randrange(6):
        case 0 | 1:
            return MoveTo(_waypoint(random, random.random() < 0.7, near_m), controller)
        case 2:
            count = random.randint(2, 4)
            positions = [_waypoint(random, False, near_m) for _ in range(count - 1)]
            last = _waypoint(random, random.random() < 0.7, near_m)
            return FollowPath((*positions, last), controller)
        case 3:
            return MoveForward(random.choice((-1.0, 1.0)) * random.uniform(0.2, 3.0))
        case 4:
            angle_rad = random.uniform(-pi, pi)
            return RotateTo(angle_rad) if random.random() < 0.5 else RotateBy(angle_rad)
        case _:
            speed_mps = random.uniform(-0.8, 0.8) * drive.travel_speed_mps
            return DriveFor(speed_mps, random.uniform(-1.0, 1.0), random.uniform(1.0, 4.0))


def _waypoint(random: Random, headed: bool, near_m: float) -> Waypoint:
    x_m, y_m = random.uniform(-near_m, near_m), random.uniform(-near_m, near_m)
    return Waypoint(x_m, y_m, random.uniform(-pi, pi) if headed else None)


def drive(settings: Settings, motions: Sequence[Motion], seed: int) -> list[Outcome | None]:
    """Preview and drive motions, one after the other; None: refused, or not EXECUTED."""
    with tempfile.TemporaryDirectory() as folder:
        lockstep = LockStep(settings, World(), Path(folder), seed)
        lockstep.run(REST_S)
        outcomes = [_drive_one(lockstep, motion, i) for i, motion in enumerate(motions, 1)]
        lockstep.executive.simulate_crash()
    return outcomes


def _drive_one(lockstep: LockStep, motion: Motion, number: int) -> Outcome | None:
    status, rover = lockstep.executive.status, lockstep.rover
    preview = _previewed(lockstep, motion)
    if isinstance(preview, Refusal):
        return None
    seen, true, begun_j, begun_s = status.pose, rover.true_pose, rover.energy_j, lockstep.time_s
    lockstep.submit(Command(Identity("bench", number), motion, "direct"))
    lockstep.run_until(lambda: _stage(lockstep, number).terminal, LIMIT_S)
    took_s, took_j = lockstep.time_s - begun_s, rover.energy_j - begun_j
    lockstep.run(REST_S)
    if _stage(lockstep, number) is not Stage.EXECUTED:
        return None
    predicted, became = _seen_from(preview.end, seen), _seen_from(rover.true_pose, true)
    return Outcome(
        motion,
        preview,
        took_s - preview.duration_s,
        hypot(became.x_m - predicted.x_m, became.y_m - predicted.y_m),
        abs(wrap_rad(became.heading_rad - predicted.heading_rad)),
        0.0 if preview.energy_j is None else took_j - preview.energy_j,
    )


def _seen_from(pose: Pose, start: Pose) -> Pose:
    """Return a pose as seen from another."""
    apart_m, bearing_rad = start.point.distance_m(pose.point), start.point.bearing_rad(pose.point)
    position = Pose(heading_rad=bearing_rad - start.heading_rad).ahead(apart_m)
    heading_rad = wrap_rad(pose.heading_rad - start.heading_rad)
    return Pose(position.x_m, position.y_m, heading_rad=heading_rad)


def _previewed(lockstep: LockStep, motion: Motion) -> Preview | Refusal:
    run = lockstep.executive.preview(motion)
    if isinstance(run, Refusal):
        return run
    run.set_up()
    while run.result is None:
        run.advance(100)
    return run.result


def _stage(lockstep: LockStep, number: int) -> Stage:
    identity = Identity("bench", number)
    reports = lockstep.downlink_record.reports
    return next(
        (each.stage for each in reversed(reports) if each.identity == identity and each.stage),
        Stage.RECEIVED,
    )


def measure(
    count: int, names: Iterable[str], seed: int, settings: Settings, log: Callable[[str], None]
) -> list[Figure]:
    """Preview and drive so many random motions by each controller, or as MOCUP's brick does.

    Raises:
        SettingsError: casadi is not installed, and mpc is to drive.
    """
    figures = []
    for name in names:
        random, controller, asset = Random(seed), None, load_settings("mocup")
        if name != BRICK:
            controller = OWN[name].choice
            asset = replace(settings, controller=controller)
        motions = [random_motion(random, controller, asset.drive) for _ in range(count)]
        log(f"previews: {count} motions, {name} ...")
        figures += _figures(name, drive(asset, motions, seed))
    return figures


def _figures(name: str, outcomes: Sequence[Outcome | None]) -> list[Figure]:
    driven = [each for each in outcomes if each is not None]
    count = f"{len(driven)} random motions, {name}"
    shares = [abs(each.off_s) / each.preview.duration_s for each in driven]
    energies = [abs(e.off_j) / e.preview.energy_j for e in driven if e.preview.energy_j]
    return [
        Figure(f"{name}: refused or failed", len(outcomes) - len(driven), "", count, Goal(0)),
        Figure(f"{name}: duration off, median", 100 * median(shares), "%", count),
        Figure(f"{name}: duration off, p95", 100 * quantile(shares, 0.95), "%", count, Goal(5)),
        Figure(f"{name}: duration off, most", 100 * max(shares), "%", count),
        Figure(
            f"{name}: duration within 5 %",
            100 * sum(each.in_time for each in driven) / len(driven),
            "%",
            count,
        ),
        Figure(
            f"{name}: end within two sigma",
            100 * sum(each.within for each in driven) / len(driven),
            "%",
            count,
            Goal(93, at_least=True),
        ),
        *(
            Figure(f"{name}: energy off, {which}", 100 * quantile(energies, part), "%", count)
            for which, part in (("median", 0.5), ("p95", 0.95))
            if energies
        ),
    ]
