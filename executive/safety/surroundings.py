"""`LaserSurroundings`: laser points near the rover, and collisions of its motion with them.

Modelled on the collision monitor of Nav2: a slow-down zone, and a footprint that is moved ahead in
time and must stay free until the rover can stop. Pure geometry in the axes of base_link.
"""

from dataclasses import dataclass
from math import atan2, ceil, cos, hypot, inf, isfinite, isnan, pi, radians, sin
from typing import Final, NamedTuple

from executive.obstacles.local_map import directions_of
from executive.obstacles.zones import Footprint
from executive.settings import Settings
from executive.values.facts import LaserScan
from executive.values.geometry import Velocity, wrap_rad

MIN_POINTS: Final = 2
"""Minimum number of points of an obstacle: a single one may be dust."""
DRIVE_SIDE_CLEARANCE_M: Final = 0.055
"""Side clearance of the footprint while driving."""
TURN_SIDE_CLEARANCE_M: Final = 0.02
"""Side clearance of the footprint in a turn on the spot."""
TURN_BRAKING: Final = 4.0
"""Ratio of angular to linear deceleration of a braking base, in 1/m. Chosen, not measured."""
STEP_M: Final = 0.05
STEP_RAD: Final = 0.05
"""Step sizes of the footprint's motion."""
APPROACH_M: Final = 0.01
"""Minimum approach to a point inside the margin that counts as a collision."""
MAX_RANGE_M: Final = 3.0
"""Maximum range of points, from base_link."""
STANDSTILL_MPS: Final = 0.02
STANDSTILL_RADPS: Final = 0.05
"""Speeds below which the rover is stationary."""
SECTORS: Final = 24
SECTOR_RAD: Final = 2 * pi / SECTORS
"""Width of the sectors that are judged: 0.26 m at 1 m, half the width of a Jackal."""
AHEAD_SECTOR_RAD: Final = radians(46)
"""Maximum angle between a sector and the direction of travel; wide, as arcs bend."""
EDGE_M: Final = 0.03
"""Distance from the hull of a return that is too close to measure (REP 117): more than APPROACH_M,
so that the rover cannot approach it."""


@dataclass(frozen=True, slots=True)
class LaserPoint:
    """A laser point, in the axes of base_link, and its distance from the hull."""

    x_m: float
    y_m: float
    gap_m: float


@dataclass(frozen=True, slots=True)
class FreeSpace:
    """The clearance around a footprint: ahead and behind, and on either side."""

    along_m: float
    side_m: float


class Sector(NamedTuple):
    """A sector of the newest scan, its share of unusable rays, and since when it is too high."""

    bearing_rad: float
    share: float
    since_s: float


class LaserSurroundings:
    """The obstacles around an asset, by its laser.

    Attributes:
        spots: the points of the newest scan outside of the rover itself.
        scanned_s: arrival of the last new scan; minus infinity before the first.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.spots: tuple[LaserPoint, ...] = ()
        self.scanned_s = -inf
        self._stamp_s = -inf
        self._sectors: dict[int, Sector] = {}

    @property
    def footprint(self) -> Footprint | None:
        """The outline of the rover."""
        return self.settings.footprint

    @property
    def laser(self) -> bool:
        """Whether scans are monitored."""
        return self.settings.sensors.laser is not None and self.footprint is not None

    def add_scan(self, scan: LaserScan, now_s: float) -> None:
        """Replace the points by those of a newer scan, without returns of the rover itself."""
        if self.footprint is None or not isfinite(scan.stamp_s) or scan.stamp_s == self._stamp_s:
            return
        self._stamp_s, self.scanned_s = scan.stamp_s, now_s
        directions = directions_of(scan)
        least_m, max_m = scan.range_min_m, min(scan.range_max_m, MAX_RANGE_M)
        found = []
        rays: dict[int, list[bool]] = {}
        for range_m, (cosine, sine) in zip(scan.ranges_m, directions, strict=True):
            number = round(atan2(sine, cosine) / SECTOR_RAD) % SECTORS
            rays.setdefault(number, []).append(isnan(range_m))
            if range_m == -inf:
                found.append(_at_edge(cosine, sine, self.footprint))
            elif least_m <= range_m <= max_m:
                x_m, y_m = range_m * cosine, range_m * sine
                gap_m = _gap_m(x_m, y_m, self.footprint)
                if gap_m > 0.0:
                    found.append(LaserPoint(x_m, y_m, gap_m))
        self.spots = tuple(found)
        self._note_sectors(rays, now_s)

    def _note_sectors(self, rays: dict[int, list[bool]], now_s: float) -> None:
        allowed, before, self._sectors = self.settings.faults.laser_blind.bound, self._sectors, {}
        for number, unusable in rays.items():
            share, last = sum(unusable) / len(unusable), before.get(number)
            since_s = now_s if last is None or last.share <= allowed else last.since_s
            self._sectors[number] = Sector(wrap_rad(number * SECTOR_RAD), share, since_s)

    def blind(self, velocity: Velocity, allowed: float, since_s: float) -> Sector | None:
        """Return the sector with the maximum share of unusable rays ahead; None if it is visible.

        In a turn on the spot all sectors count. Those outside of the field of view do not.

        Args:
            velocity: of the rover.
            allowed: maximum share of unusable rays.
            since_s: a sector counts if it has been blind since then.
        """
        if not is_moving(velocity):
            return None
        on_spot = abs(velocity.travel_mps) < STANDSTILL_MPS
        ahead_rad = 0.0 if velocity.travel_mps > 0 else pi
        found = [
            each
            for each in self._sectors.values()
            if each.share > allowed and each.since_s <= since_s
            if on_spot or abs(wrap_rad(each.bearing_rad - ahead_rad)) <= AHEAD_SECTOR_RAD
        ]
        return max(found, key=lambda each: each.share, default=None)

    def braking_s(self, velocity: Velocity, latency_s: float) -> float:
        """Return the duration of the velocity, if held, for the braking distance."""
        braking_mps2 = self.settings.drive.braking_mps2
        return latency_s + max(
            abs(velocity.travel_mps) / (2.0 * braking_mps2),
            abs(velocity.rotate_radps) / (2.0 * TURN_BRAKING * braking_mps2),
        )

    def predicted_contact(
        self, velocity: Velocity, held_s: float, margin_m: float
    ) -> LaserPoint | None:
        """Return a collision point of the rover at a held velocity, or None.

        Of several points the second nearest: a single one may be dust.
        """
        if self.footprint is None or not is_moving(velocity):
            return None
        length_m = velocity.travel_mps * held_s
        turn_rad = velocity.rotate_radps * held_s
        margin = FreeSpace(margin_m, self._side_clearance_m if length_m else TURN_SIDE_CLEARANCE_M)
        near = self._within_reach(length_m, abs(turn_rad), margin)
        if len(near) < MIN_POINTS:
            return None
        steps = max(1, ceil(max(abs(length_m) / STEP_M, abs(turn_rad) / STEP_RAD)))
        moved = [
            self._moved(length_m * k / steps, turn_rad * k / steps) for k in range(1, steps + 1)
        ]
        return _second_nearest(
            [spot for spot in near if _is_contact(spot, moved, self.footprint, margin)]
        )

    def _within_reach(
        self, length_m: float, turn_rad: float, margin: FreeSpace
    ) -> list[LaserPoint]:
        """Return the points within reach of a motion, possibly with some more.

        In a corridor this takes 17 ms of CPU a second; testing all points took 96 ms.
        """
        footprint = self.footprint
        assert footprint is not None
        corners_m = footprint.radius_m * min(turn_rad, 2.0)
        aside_m = abs(length_m) * min(turn_rad, 1.0) + corners_m
        half_m = footprint.length_m / 2 + margin.along_m + corners_m
        front_m, back_m = half_m + max(length_m, 0.0), -half_m + min(length_m, 0.0)
        side_m = footprint.width_m / 2 + margin.side_m + aside_m
        return [
            spot for spot in self.spots if back_m < spot.x_m < front_m and abs(spot.y_m) < side_m
        ]

    def _moved(self, length_m: float, turn_rad: float) -> tuple[float, float, float, float, float]:
        """Return the pose after an arc of the control point: position, cosine, sine, offset."""
        ahead_m, half_rad = self.settings.turn_drive.control_point_m, turn_rad / 2
        chord_m = length_m * (sin(half_rad) / half_rad if half_rad else 1.0)
        x_m, y_m = ahead_m + chord_m * cos(half_rad), chord_m * sin(half_rad)
        return x_m, y_m, cos(turn_rad), sin(turn_rad), ahead_m

    @property
    def _side_clearance_m(self) -> float:
        """The required side clearance: less along obstacles that are already closer."""
        footprint = self.footprint
        assert footprint is not None
        along = [spot for spot in self.spots if abs(spot.x_m) < footprint.length_m / 2]
        nearest = _second_nearest(along)
        left_m = DRIVE_SIDE_CLEARANCE_M if nearest is None else nearest.gap_m - APPROACH_M
        return max(0.0, min(DRIVE_SIDE_CLEARANCE_M, left_m))

    def nearest_ahead(self, velocity: Velocity, within_m: float) -> LaserPoint | None:
        """Return the nearest point in the direction of travel within a distance, or None.

        Of several points the second nearest.
        """
        if self.footprint is None or abs(velocity.travel_mps) < STANDSTILL_MPS:
            return None
        sign = 1.0 if velocity.travel_mps > 0 else -1.0
        half_m, side_m = (
            self.footprint.length_m / 2,
            self.footprint.width_m / 2 + DRIVE_SIDE_CLEARANCE_M,
        )
        return _second_nearest(
            [
                spot
                for spot in self.spots
                if half_m < sign * spot.x_m < half_m + within_m and abs(spot.y_m) < side_m
            ]
        )


def is_moving(velocity: Velocity) -> bool:
    """Return whether a velocity counts as motion."""
    return (
        abs(velocity.travel_mps) >= STANDSTILL_MPS or abs(velocity.rotate_radps) >= STANDSTILL_RADPS
    )


def _is_contact(
    spot: LaserPoint,
    moved: list[tuple[float, float, float, float, float]],
    footprint: Footprint,
    margin: FreeSpace,
) -> bool:
    """Return whether the footprint, moved ahead, gets within the margin of a point, and closer."""
    along_m = footprint.length_m / 2 + margin.along_m
    beside_m = footprint.width_m / 2 + margin.side_m
    for position_x_m, position_y_m, cosine, sine, ahead_m in moved:
        dx_m, dy_m = spot.x_m - position_x_m, spot.y_m - position_y_m
        x_m, y_m = dx_m * cosine + dy_m * sine + ahead_m, dy_m * cosine - dx_m * sine
        within = abs(x_m) < along_m and abs(y_m) < beside_m
        if within and _gap_m(x_m, y_m, footprint) < spot.gap_m - APPROACH_M:
            return True
    return False


def _gap_m(x_m: float, y_m: float, footprint: Footprint) -> float:
    """Return the distance of a point from the hull; 0 within it."""
    ahead_m, aside_m = abs(x_m) - footprint.length_m / 2, abs(y_m) - footprint.width_m / 2
    return hypot(max(ahead_m, 0.0), max(aside_m, 0.0))


def _at_edge(cosine: float, sine: float, footprint: Footprint) -> LaserPoint:
    """Return a point just outside the hull, for a ray with a return too close to measure."""
    along_m = footprint.length_m / 2 / abs(cosine) if cosine else inf
    away_m = min(along_m, footprint.width_m / 2 / abs(sine) if sine else inf) + EDGE_M
    x_m, y_m = away_m * cosine, away_m * sine
    return LaserPoint(x_m, y_m, _gap_m(x_m, y_m, footprint))


def _second_nearest(spots: list[LaserPoint]) -> LaserPoint | None:
    if len(spots) < MIN_POINTS:
        return None
    return sorted(spots, key=lambda spot: spot.gap_m)[MIN_POINTS - 1]
