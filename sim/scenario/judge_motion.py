"""Findings about where the rover truly is, whether it moves, and in which mode."""

from collections.abc import Sequence
from itertools import groupby
from math import degrees, hypot, radians
from typing import Final

from executive.geometry import wrap_rad
from executive.modes import Mode
from sim.scenario.expectations import ModeIs, Movement, PoseIs, RoverMoves
from sim.scenario.finding import NEVER, Finding
from sim.scenario.record import Record, TruePose, between

STILL_M: Final = 0.02
STILL_RAD: Final = radians(2.0)
"""A rover stands that stays within these of where it was."""
BRAKING_S: Final = 1.5
"""After this long in STOPPED or SAFE the rover has come to rest, from whatever speed."""
HELD: Final = frozenset({Mode.STOPPED, Mode.SAFE})


def pose(expected: PoseIs, record: Record) -> Finding:
    """Compare the true pose at a time."""
    place = expected.pose
    wanted = f"x {place.x_m:.2f} y {place.y_m:.2f} ± {expected.tolerance_m:g} m"
    if place.heading_rad is not None:
        wanted += f", {_angle(place.heading_rad)} ± {_angle(expected.heading_tolerance_rad)}"
    wanted += f" {expected.when}"
    seen = record.sample(record.poses, expected)
    if seen is None:
        return Finding("true pose", wanted, NEVER, False)
    true = seen.pose
    away_m = hypot(true.x_m - place.x_m, true.y_m - place.y_m)
    found = f"x {true.x_m:.3f} y {true.y_m:.3f}, {away_m:.3f} m off"
    holds = away_m <= expected.tolerance_m
    if place.heading_rad is not None:
        off_rad = abs(wrap_rad(true.heading_rad - place.heading_rad))
        found += f", {_angle(true.heading_rad)}, {_angle(off_rad)} off"
        holds = holds and off_rad <= expected.heading_tolerance_rad
    return Finding("true pose", wanted, found, holds)


def movement(expected: RoverMoves, record: Record) -> Finding:
    """Look whether the rover moves in a while."""
    wanted = f"{expected.rover.value} {expected.period}"
    poses = record.during(record.poses, expected)
    if not poses:
        return Finding("rover", wanted, NEVER, False)
    away_m, turned_rad = _travel(poses)
    stands = away_m <= STILL_M and turned_rad <= STILL_RAD
    return Finding(
        "rover",
        wanted,
        f"went {away_m:.3f} m, turned {_angle(turned_rad)}",
        stands is (expected.rover is Movement.STANDS),
    )


def mode(expected: ModeIs, record: Record) -> Finding:
    """Compare the mode at a time."""
    wanted = f"{expected.mode.name} {expected.when}"
    seen = record.sample(record.modes, expected)
    if seen is None:
        return Finding("mode", wanted, NEVER, False)
    return Finding("mode", wanted, seen.mode.name, seen.mode is expected.mode)


def stands_while_held(record: Record) -> Finding:
    """Hold the rover to stand while it is STOPPED or SAFE."""
    worst_m = worst_rad = 0.0
    for held, seen in groupby(record.modes, key=lambda seen: seen.mode in HELD):
        if held:
            times = [each.time_s for each in seen]
            away_m, turned_rad = _travel(between(record.poses, times[0] + BRAKING_S, times[-1]))
            worst_m, worst_rad = max(worst_m, away_m), max(worst_rad, turned_rad)
    return Finding(
        "promise",
        "no motion while STOPPED or SAFE",
        f"went {worst_m:.3f} m, turned {_angle(worst_rad)}",
        worst_m <= STILL_M and worst_rad <= STILL_RAD,
    )


def _travel(poses: Sequence[TruePose]) -> tuple[float, float]:
    """Return how far from the first pose any other is, in metres and radians."""
    away_m = turned_rad = 0.0
    for seen in poses:
        first, other = poses[0].pose, seen.pose
        away_m = max(away_m, hypot(other.x_m - first.x_m, other.y_m - first.y_m))
        turned_rad = max(turned_rad, abs(wrap_rad(other.heading_rad - first.heading_rad)))
    return away_m, turned_rad


def _angle(angle_rad: float) -> str:
    return f"{degrees(angle_rad):.1f}°"
