"""What the laser sees near the rover, and what of it the rover would drive or turn into.

Modelled on the collision monitor of Nav2: a zone in which the rover slows down, and its footprint,
moved ahead in time, in which nothing may be before it can stand. Pure geometry in the axes of
base_link.
"""

from dataclasses import dataclass
from math import atan2, ceil, cos, hypot, inf, isfinite, isnan, pi, radians, sin
from typing import Final, NamedTuple

from executive.obstacles.local_map import directions_of
from executive.obstacles.zones import Footprint
from executive.settings import Settings
from executive.values.facts import LaserScan
from executive.values.geometry import Velocity, wrap_rad

FEWEST_POINTS: Final = 2
"""Of a scan that are something: a single one may be dust."""
BESIDE_M: Final = 0.055
"""Free on either side of the footprint of a rover that drives."""
TURNING_M: Final = 0.02
"""Free on either side of the footprint of a rover that turns on the spot."""
TURN_BRAKING: Final = 4.0
"""Angular deceleration by linear deceleration, in 1/m, of a base that is told to stand."""
STEP_M: Final = 0.05
STEP_RAD: Final = 0.05
"""In which the footprint is moved ahead."""
NEARER_M: Final = 0.01
"""What is near already is met if it comes this much nearer."""
REACH_M: Final = 3.0
"""Points that are farther than that from base_link are not looked at."""
SLOWEST_MPS: Final = 0.02
SLOWEST_RADPS: Final = 0.05
"""A rover that is slower stands."""
SECTORS: Final = 24
SECTOR_RAD: Final = 2 * pi / SECTORS
"""Width of the sectors that are judged: 0.26 m at 1 m, half the width of a Jackal."""
WAY_RAD: Final = radians(46)
"""Sectors whose middle is as near to the direction of travel are driven into: arcs bend."""
EDGE_M: Final = 0.03
"""Distance to the hull of what is too near to measure (REP 117): more than NEARER_M, so that the
rover may not come nearer."""


@dataclass(frozen=True, slots=True)
class LaserPoint:
    """A point that the laser sees, in the axes of base_link, and how far it is from the hull."""

    x_m: float
    y_m: float
    gap_m: float


@dataclass(frozen=True, slots=True)
class FreeSpace:
    """What must stay free around a footprint: ahead and behind, and on either side."""

    along_m: float
    beside_m: float


class Sector(NamedTuple):
    """A sector of the newest scan: the share of its rays that is unusable, since when too many."""

    bearing_rad: float
    share: float
    since_s: float


class LaserSurroundings:
    """What is known of what stands around an asset.

    Attributes:
        spots: what the newest scan shows outside the rover itself.
        scanned_s: when a new scan last came; minus infinity before the first.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.spots: tuple[LaserPoint, ...] = ()
        self.scanned_s = -inf
        self._stamp_s = -inf
        self._sectors: dict[int, Sector] = {}

    @property
    def footprint(self) -> Footprint | None:
        """What the rover covers of the ground."""
        return self.settings.footprint

    @property
    def laser(self) -> bool:
        """Whether there are scans to be watched."""
        return self.settings.sensors.laser is not None and self.footprint is not None

    def see(self, scan: LaserScan, now_s: float) -> None:
        """Take a scan that is newer than the last, without what is the rover itself."""
        if self.footprint is None or not isfinite(scan.stamp_s) or scan.stamp_s == self._stamp_s:
            return
        self._stamp_s, self.scanned_s = scan.stamp_s, now_s
        directions = directions_of(scan)
        least_m, most_m = scan.range_min_m, min(scan.range_max_m, REACH_M)
        found = []
        rays: dict[int, list[bool]] = {}
        for range_m, (cosine, sine) in zip(scan.ranges_m, directions, strict=True):
            number = round(atan2(sine, cosine) / SECTOR_RAD) % SECTORS
            rays.setdefault(number, []).append(isnan(range_m))
            if range_m == -inf:
                found.append(_at_edge(cosine, sine, self.footprint))
            elif least_m <= range_m <= most_m:
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
        """Return the blindest sector towards which a velocity leads; None if the laser sees there.

        Of a rover that turns on the spot all sectors count; outside of the field of view none does.

        Args:
            velocity: of the rover.
            allowed: greatest share of unusable rays.
            since_s: a sector counts that has been blind since then.
        """
        if not moves(velocity):
            return None
        on_spot = abs(velocity.travel_mps) < SLOWEST_MPS
        ahead_rad = 0.0 if velocity.travel_mps > 0 else pi
        found = [
            each
            for each in self._sectors.values()
            if each.share > allowed and each.since_s <= since_s
            if on_spot or abs(wrap_rad(each.bearing_rad - ahead_rad)) <= WAY_RAD
        ]
        return max(found, key=lambda each: each.share, default=None)

    def braking_s(self, velocity: Velocity, latency_s: float) -> float:
        """Return for how long the velocity would have to be held to go the way of braking."""
        braking_mps2 = self.settings.drive.braking_mps2
        return latency_s + max(
            abs(velocity.travel_mps) / (2.0 * braking_mps2),
            abs(velocity.rotate_radps) / (2.0 * TURN_BRAKING * braking_mps2),
        )

    def met(self, velocity: Velocity, held_s: float, margin_m: float) -> LaserPoint | None:
        """Return what the rover comes too near to by a velocity that is held; None if nothing.

        Of several points the second nearest.
        """
        if self.footprint is None or not moves(velocity):
            return None
        length_m = velocity.travel_mps * held_s
        turn_rad = velocity.rotate_radps * held_s
        margin = FreeSpace(margin_m, self._beside_m if length_m else TURNING_M)
        near = self._within_reach(length_m, abs(turn_rad), margin)
        if len(near) < FEWEST_POINTS:
            return None
        steps = max(1, ceil(max(abs(length_m) / STEP_M, abs(turn_rad) / STEP_RAD)))
        moved = [
            self._moved(length_m * k / steps, turn_rad * k / steps) for k in range(1, steps + 1)
        ]
        return _second_nearest(
            [spot for spot in near if _is_met(spot, moved, self.footprint, margin)]
        )

    def _within_reach(
        self, length_m: float, turn_rad: float, margin: FreeSpace
    ) -> list[LaserPoint]:
        """Return the points that a motion may lead to, and perhaps some more."""
        footprint = self.footprint
        assert footprint is not None
        corners_m = footprint.radius_m * min(turn_rad, 2.0)
        aside_m = abs(length_m) * min(turn_rad, 1.0) + corners_m
        half_m = footprint.length_m / 2 + margin.along_m + corners_m
        front_m, back_m = half_m + max(length_m, 0.0), -half_m + min(length_m, 0.0)
        side_m = footprint.width_m / 2 + margin.beside_m + aside_m
        return [
            spot for spot in self.spots if back_m < spot.x_m < front_m and abs(spot.y_m) < side_m
        ]

    def _moved(self, length_m: float, turn_rad: float) -> tuple[float, float, float, float, float]:
        """Return where an arc of the control point leads: place, cosine and sine, offset."""
        ahead_m, half_rad = self.settings.turn_drive.control_point_m, turn_rad / 2
        chord_m = length_m * (sin(half_rad) / half_rad if half_rad else 1.0)
        x_m, y_m = ahead_m + chord_m * cos(half_rad), chord_m * sin(half_rad)
        return x_m, y_m, cos(turn_rad), sin(turn_rad), ahead_m

    @property
    def _beside_m(self) -> float:
        """What must stay free on either side: less along what is nearer already."""
        footprint = self.footprint
        assert footprint is not None
        along = [spot for spot in self.spots if abs(spot.x_m) < footprint.length_m / 2]
        nearest = _second_nearest(along)
        left_m = BESIDE_M if nearest is None else nearest.gap_m - NEARER_M
        return max(0.0, min(BESIDE_M, left_m))

    def near(self, velocity: Velocity, within_m: float) -> LaserPoint | None:
        """Return what stands so near in the direction in which the rover drives; None if nothing.

        Of several points the second nearest.
        """
        if self.footprint is None or abs(velocity.travel_mps) < SLOWEST_MPS:
            return None
        sign = 1.0 if velocity.travel_mps > 0 else -1.0
        half_m, side_m = self.footprint.length_m / 2, self.footprint.width_m / 2 + BESIDE_M
        return _second_nearest(
            [
                spot
                for spot in self.spots
                if half_m < sign * spot.x_m < half_m + within_m and abs(spot.y_m) < side_m
            ]
        )


def moves(velocity: Velocity) -> bool:
    """Return whether a rover at a velocity goes anywhere."""
    return abs(velocity.travel_mps) >= SLOWEST_MPS or abs(velocity.rotate_radps) >= SLOWEST_RADPS


def _is_met(
    spot: LaserPoint,
    moved: list[tuple[float, float, float, float, float]],
    footprint: Footprint,
    margin: FreeSpace,
) -> bool:
    """Return whether a point is within the margin, and nearer than now, anywhere on the way."""
    along_m = footprint.length_m / 2 + margin.along_m
    beside_m = footprint.width_m / 2 + margin.beside_m
    for place_x_m, place_y_m, cosine, sine, ahead_m in moved:
        dx_m, dy_m = spot.x_m - place_x_m, spot.y_m - place_y_m
        x_m, y_m = dx_m * cosine + dy_m * sine + ahead_m, dy_m * cosine - dx_m * sine
        within = abs(x_m) < along_m and abs(y_m) < beside_m
        if within and _gap_m(x_m, y_m, footprint) < spot.gap_m - NEARER_M:
            return True
    return False


def _gap_m(x_m: float, y_m: float, footprint: Footprint) -> float:
    """Return how far a point is from the hull; 0 within it."""
    ahead_m, aside_m = abs(x_m) - footprint.length_m / 2, abs(y_m) - footprint.width_m / 2
    return hypot(max(ahead_m, 0.0), max(aside_m, 0.0))


def _at_edge(cosine: float, sine: float, footprint: Footprint) -> LaserPoint:
    """Return a point just outside the hull, for a ray of which something is too near to measure."""
    along_m = footprint.length_m / 2 / abs(cosine) if cosine else inf
    away_m = min(along_m, footprint.width_m / 2 / abs(sine) if sine else inf) + EDGE_M
    x_m, y_m = away_m * cosine, away_m * sine
    return LaserPoint(x_m, y_m, _gap_m(x_m, y_m, footprint))


def _second_nearest(spots: list[LaserPoint]) -> LaserPoint | None:
    if len(spots) < FEWEST_POINTS:
        return None
    return sorted(spots, key=lambda spot: spot.gap_m)[FEWEST_POINTS - 1]
