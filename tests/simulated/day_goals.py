"""The goals of a day, judged by the true state of the rover and by what the ground received."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot
from typing import Final
from zlib import crc32

from tests.simulated.day import LEAD_S, SHELTER_M, Day, DayScene, Site
from tests.simulated.resting import TakenPicture

SITE_M: Final = 1.5
"""A picture is one of a site if it was taken within this distance of it."""
HOME_M: Final = 0.5
DIRECTIONS: Final = 4
_APART_RAD: Final = 0.5
SAMPLES_PER_S: Final = 0.1
"""Positions that the ground receives in a pass, measured in it, per second of the pass."""
FULL: Final = 0.85
LEAST_CHARGE: Final = 0.05
_NIGHT_STEPS: Final = 200


@dataclass(frozen=True, slots=True)
class Goal:
    """One goal of a day, and whether it was reached."""

    name: str
    reached: bool


def judge(scene: DayScene) -> tuple[Goal, ...]:
    """Return the goals of a day that was played."""
    day, rover = scene.day, scene.rover
    stored = {crc32(path.read_bytes()) for path in scene.files.rglob("*") if path.is_file()}
    pictures = [each for each in rover.pictures if each.checksum in stored]
    goals = [goal for site in day.sites for goal in _site_goals(day, site, pictures)]
    for number, each in enumerate(day.passes, 1):
        taken = any(each.begin_s <= one.at_s - LEAD_S < each.end_s for one in pictures)
        seen = sum(
            each.begin_s <= at_s < each.end_s and now_s < each.end_s
            for at_s, now_s in scene.received.samples
        )
        goals.append(
            Goal(f"pass {number}", taken and seen >= SAMPLES_PER_S * (each.end_s - each.begin_s))
        )
    night = [
        day.sunset_s + (day.sunrise_s - day.sunset_s) * step / _NIGHT_STEPS
        for step in range(_NIGHT_STEPS + 1)
    ]
    homes = [rover.pose_at(LEAD_S + at_s) for at_s in night]
    goals += [
        Goal("home for the night", all(hypot(p.x_m, p.y_m) <= SHELTER_M for p in homes)),
        Goal("charged for the night", rover.charge_at(LEAD_S + day.sunset_s) >= FULL),
        Goal("survived the night", rover.lowest_charge >= LEAST_CHARGE),
        Goal("home at the end", _at_home(scene)),
    ]
    return tuple(goals)


def _site_goals(day: Day, site: Site, pictures: list[TakenPicture]) -> Iterator[Goal]:
    """Yield the goals of a site: a picture, and where wanted pictures in four directions."""
    begin_s, end_s = (day.sunrise_s, day.end_s) if site.morning else (0.0, day.sunset_s)
    near = [
        each
        for each in pictures
        if site.distance_m(each.pose) <= SITE_M and begin_s <= each.at_s - LEAD_S < end_s
    ]
    yield Goal(f"site {site.name}", bool(near))
    if site.panorama:
        directions: list[float] = []
        for pan_rad in sorted(each.angles.pan_rad for each in near):
            if not directions or pan_rad - directions[-1] >= _APART_RAD:
                directions.append(pan_rad)
        yield Goal(f"panorama {site.name}", len(directions) >= DIRECTIONS)


def _at_home(scene: DayScene) -> bool:
    """Return whether the rover is at home at the end, and was away in the morning."""
    day, rover = scene.day, scene.rover
    end = rover.pose_at(LEAD_S + day.end_s)
    away = any(since_s - LEAD_S > day.sunrise_s for since_s, _ in rover.track)
    return away and hypot(end.x_m, end.y_m) <= HOME_M
