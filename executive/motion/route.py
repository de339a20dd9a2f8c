"""The waypoints that a leg passes before it ends, and the progress of the rover along them."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Final

from executive.commands import Waypoint
from executive.motion.plan import ANY_RAD, PASSED_AT_ONCE, TrajectoryTarget
from executive.values.geometry import Point

AIM_SHARE: Final = 0.4
"""Ratio to a tolerance, within which a plan ends or passes a waypoint."""
ROOM_M: Final = 0.03
"""Reserve of a wide tolerance: more than the tracking error of the rover."""
SEEN_S: Final = 0.5
"""Timeout of odometry to confirm that the rover passed a waypoint, after the plan did."""


def aim_within_m(tolerance_m: float) -> float:
    """Return the tolerance for plans that end at a waypoint or pass it."""
    return max(AIM_SHARE * tolerance_m, tolerance_m - ROOM_M)


@dataclass(frozen=True, slots=True)
class _ViaPoint:
    target: TrajectoryTarget
    tolerance_m: float


class Route:
    """The waypoints to pass, in order, and the end.

    Args:
        through: the waypoints to pass with base_link.
        default_m: the tolerance of those without one.
        ahead_m: distance of the control point ahead of base_link.
        end: the end of the leg.

    Attributes:
        passed: number of waypoints passed within their tolerances, by odometry.
    """

    def __init__(
        self, through: Sequence[Waypoint], default_m: float, ahead_m: float, end: TrajectoryTarget
    ) -> None:
        self._places = []
        for each in through:
            near_m = each.tolerance_m or default_m
            aim_m = aim_within_m(near_m)
            target = TrajectoryTarget(each.x_m, each.y_m, 0.0, aim_m, ANY_RAD, ahead_m)
            self._places.append(_ViaPoint(target, near_m))
        self._targets = (*(each.target for each in self._places), end)
        self._behind_s: list[float] = []
        self._seen: Point | None = None
        self.passed = 0

    @property
    def end(self) -> int:
        """The index of the end, after those of the waypoints."""
        return len(self._places)

    @property
    def left(self) -> tuple[Point, ...]:
        """The remaining waypoints, and the end."""
        return tuple(each.point for each in self._targets[self.passed :])

    def observe(self, point: Point, now_s: float) -> bool:
        """Update with the position of base_link; return whether a waypoint was missed."""
        before, self._seen = self._seen or point, point
        if self.passed < self.end:
            place = self._places[self.passed]
            if passes_by(place.target.point, place.tolerance_m, before, point):
                self.passed += 1
        behind_s = self._behind_s[self.passed :]
        return bool(behind_s) and now_s - behind_s[0] > SEEN_S

    def plan_from(self, index: int, now_s: float) -> tuple[TrajectoryTarget, ...]:
        """Return the next via points and end, for plans after the first `index` waypoints."""
        self._behind_s = self._behind_s[:index]
        self._behind_s += [now_s] * (index - len(self._behind_s))
        return self._targets[index : index + PASSED_AT_ONCE + 1]


def passes_by(place: Point, tolerance_m: float, before: Point, after: Point) -> bool:
    """Return whether a straight line passes a point within a tolerance."""
    x_m, y_m = after.x_m - before.x_m, after.y_m - before.y_m
    squared = x_m**2 + y_m**2
    along = (place.x_m - before.x_m) * x_m + (place.y_m - before.y_m) * y_m
    part = min(max(along / squared, 0.0), 1.0) if squared else 0.0
    off_x_m = before.x_m + part * x_m - place.x_m
    return hypot(off_x_m, before.y_m + part * y_m - place.y_m) <= tolerance_m
