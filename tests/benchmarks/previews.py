"""How well previews predict: random motions, each previewed and then driven in lock step.

Also the maximum slices of previews and of searches for detours, as CPU time of the thread.
"""

import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import cos, hypot, pi, sin
from pathlib import Path
from random import Random
from statistics import median
from time import thread_time
from typing import Final

from executive.checks.path_check import best_detour
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
from executive.obstacles.detour import Detours
from executive.obstacles.zones import KeepOut, KnownRock, Zones
from executive.preview import Preview
from executive.preview.predictions import SLICE_TICKS
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
SLICE_MS: Final = Goal(5.0)
"""A tenth of a tick."""
IN_TIME: Final = 0.05
"""Of the duration, by which a preview may be wrong."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One motion, previewed and driven.

    Attributes:
        off_s, off_j: what it took beyond its preview; energy by the battery of the simulation.
        slice_s: maximum slice of its preview.
        off_m, off_rad: in truth, from where the preview has it end, seen from where it began.
    """

    motion: Motion
    preview: Preview
    off_s: float
    off_m: float
    off_rad: float
    off_j: float
    slice_s: float

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
    preview, slice_s = _previewed(lockstep, motion)
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
        slice_s,
    )


def _seen_from(pose: Pose, start: Pose) -> Pose:
    """Return a pose as seen from another."""
    apart_m, bearing_rad = start.point.distance_m(pose.point), start.point.bearing_rad(pose.point)
    position = Pose(heading_rad=bearing_rad - start.heading_rad).ahead(apart_m)
    heading_rad = wrap_rad(pose.heading_rad - start.heading_rad)
    return Pose(position.x_m, position.y_m, heading_rad=heading_rad)


def _previewed(lockstep: LockStep, motion: Motion) -> tuple[Preview | Refusal, float]:
    """Return the preview of a motion, or its refusal, and the duration of its maximum slice."""
    run = lockstep.executive.preview(motion)
    if isinstance(run, Refusal):
        return run, 0.0
    max_s = _took_s(run.set_up)
    while run.result is None:
        max_s = max(max_s, _took_s(partial(run.advance, SLICE_TICKS)))
    return run.result, max_s


def _took_s(work: Callable[[], object]) -> float:
    begun_s = thread_time()
    work()
    return thread_time() - begun_s


def crowd(seed: int) -> tuple[Zones, Waypoint]:
    """Return ten zones of ten sides and twenty rocks, and a target among them."""
    draw = Random(seed)
    found: list[tuple[float, float, float]] = []
    while len(found) < 30:
        corner = len(found) < 10
        x_m, y_m = draw.uniform(-2.0, 14.0), draw.uniform(-7.0, 7.0)
        radius_m = draw.uniform(0.3, 0.9) if corner else draw.uniform(0.1, 0.4)
        if hypot(x_m, y_m) > radius_m + 1.0:
            found.append((x_m, y_m, radius_m))
    angles = [2 * pi * index / 10 for index in range(10)]
    areas = tuple(
        KeepOut(f"z{i}", tuple((x_m + r_m * cos(at), y_m + r_m * sin(at)) for at in angles))
        for i, (x_m, y_m, r_m) in enumerate(found[:10])
    )
    rocks = tuple(KnownRock(f"r{i}", *each) for i, each in enumerate(found[10:]))
    target = Waypoint(draw.uniform(8.0, 12.0), draw.uniform(-5.0, 5.0))
    return Zones(keep_out=areas, rocks=rocks), target


def _max_search_s(settings: Settings, seed: int) -> float:
    """Return the duration of the maximum slice of a search in a crowd."""
    (zones, target), detours, max_s = crowd(seed), Detours(), 0.0
    find = partial(best_detour, target, Pose(), settings, zones, detours)
    while True:
        begun_s = thread_time()
        detours.advance()
        found = find()
        max_s = max(max_s, thread_time() - begun_s)
        if found is not None:
            return max_s


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
    max_ms = 1000 * max(_max_search_s(settings, each) for each in range(count))
    scenes = f"{count} scenes of 10 zones of 10 sides and 20 rocks"
    return [*figures, Figure("detour: maximum slice", max_ms, "ms", scenes, SLICE_MS)]


def _figures(name: str, outcomes: Sequence[Outcome | None]) -> list[Figure]:
    driven = [each for each in outcomes if each is not None]
    count = f"{len(driven)} random motions, {name}"
    shares = [abs(each.off_s) / each.preview.duration_s for each in driven]
    energies = [abs(e.off_j) / e.preview.energy_j for e in driven if e.preview.energy_j]
    return [
        Figure(f"{name}: refused or failed", len(outcomes) - len(driven), "", count, Goal(0)),
        Figure(
            f"{name}: maximum slice",
            1000 * max(each.slice_s for each in driven),
            "ms",
            count,
            SLICE_MS,
        ),
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
