"""What a laser sees of rocks, and a rover without physics that carries one."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, hypot, inf, pi, sin, sqrt

from executive.values.facts import LaserScan
from executive.values.geometry import Point, Pose
from tests.support.kinematic import KinematicRover

RAYS = 360


@dataclass(frozen=True)
class Disc:
    """A rock as the laser sees it."""

    x_m: float
    y_m: float
    radius_m: float

    def away_m(self, position: Point) -> float:
        """How far a place is from its surface."""
        return hypot(position.x_m - self.x_m, position.y_m - self.y_m) - self.radius_m


def scan_of(pose: Pose, discs: Sequence[Disc], stamp_s: float) -> LaserScan:
    """Return a scan all around from a pose."""
    ranges_m = []
    for ray in range(RAYS):
        bearing_rad = pose.heading_rad - pi + 2 * pi * ray / RAYS
        nearest_m = inf
        for disc in discs:
            dx_m, dy_m = disc.x_m - pose.x_m, disc.y_m - pose.y_m
            along_m = dx_m * cos(bearing_rad) + dy_m * sin(bearing_rad)
            aside_m = dy_m * cos(bearing_rad) - dx_m * sin(bearing_rad)
            if along_m > 0.0 and abs(aside_m) < disc.radius_m:
                nearest_m = min(nearest_m, along_m - sqrt(disc.radius_m**2 - aside_m**2))
        ranges_m.append(nearest_m if nearest_m <= 20.0 else inf)
    return LaserScan(stamp_s, -pi, 2 * pi / RAYS, 0.1, 20.0, tuple(ranges_m))


@dataclass
class ScanningRover(KinematicRover):
    """Sees rocks ten times a second.

    Attributes:
        discs: what is there; a test may change it.
        blind: whether the laser is silent.
        nearest_m: how near the disc in which the rover turns has come to any.
    """

    discs: list[Disc] = field(default_factory=list)
    nearest_m: float = inf
    steps: int = 0
    blind: bool = False

    def advance(self, step_s: float) -> None:
        super().advance(step_s)
        self.steps += 1
        away_m = [disc.away_m(self.pose.point) - 0.3335 for disc in self.discs]
        self.nearest_m = min([self.nearest_m, *away_m])
        if self.steps % 2 == 0 and not self.blind:
            self.facts.append(scan_of(self.pose, self.discs, self.steps * step_s))
