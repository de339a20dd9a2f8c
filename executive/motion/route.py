"""`Route`: the waypoints that a leg passes before it ends, and the rover's progress along them."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Final

from executive.commands import Waypoint
from executive.motion.trajectory import ANY_HEADING_TOLERANCE_RAD, MAX_VIA_POINTS, TrajectoryTarget
from executive.values.geometry import Point

TOLERANCE_RATIO: Final = 0.4
"""Ratio to a tolerance, within which a plan ends or passes a waypoint."""
TRACKING_MARGIN_M: Final = 0.03
"""Reserve of a wide tolerance: more than the tracking error of the rover."""
PASS_CONFIRMATION_S: Final = 0.5
"""Timeout of odometry to confirm that the rover passed a waypoint, after the plan did."""


def planning_tolerance_m(tolerance_m: float) -> float:
    """Return the tolerance for plans that end at a waypoint or pass it."""
    return max(TOLERANCE_RATIO * tolerance_m, tolerance_m - TRACKING_MARGIN_M)


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

    Attributes:
        passed: number of waypoints passed within their tolerances, by odometry.
    """

    def __init__(
        self, through: Sequence[Waypoint], default_m: float, ahead_m: float, end: TrajectoryTarget
    ) -> None:
        self._points = []
        for each in through:
            near_m = each.tolerance_m or default_m
            aim_m = planning_tolerance_m(near_m)
            target = TrajectoryTarget(
                each.x_m, each.y_m, 0.0, aim_m, ANY_HEADING_TOLERANCE_RAD, ahead_m
            )
            self._points.append(_ViaPoint(target, near_m))
        self._targets = (*(each.target for each in self._points), end)
        self._behind_s: list[float] = []
        self._last_point: Point | None = None
        self.passed = 0

    @property
    def end(self) -> int:
        """The index of the end, after those of the waypoints."""
        return len(self._points)

    @property
    def remaining(self) -> tuple[Point, ...]:
        """The remaining waypoints, and the end."""
        return tuple(each.point for each in self._targets[self.passed :])

    def observe(self, point: Point, now_s: float) -> bool:
        """Update with the position of base_link; return whether a waypoint was missed."""
        before, self._last_point = self._last_point or point, point
        if self.passed < self.end:
            via = self._points[self.passed]
            if passes_within(via.target.point, via.tolerance_m, before, point):
                self.passed += 1
        behind_s = self._behind_s[self.passed :]
        return bool(behind_s) and now_s - behind_s[0] > PASS_CONFIRMATION_S

    def plan_from(self, index: int, now_s: float) -> tuple[TrajectoryTarget, ...]:
        """Return the next via points and end, for plans after the first `index` waypoints."""
        self._behind_s = self._behind_s[:index]
        self._behind_s += [now_s] * (index - len(self._behind_s))
        return self._targets[index : index + MAX_VIA_POINTS + 1]


def passes_within(point: Point, tolerance_m: float, before: Point, after: Point) -> bool:
    """Return whether a straight line passes a point within a tolerance."""
    x_m, y_m = after.x_m - before.x_m, after.y_m - before.y_m
    squared = x_m**2 + y_m**2
    along = (point.x_m - before.x_m) * x_m + (point.y_m - before.y_m) * y_m
    part = min(max(along / squared, 0.0), 1.0) if squared else 0.0
    off_x_m = before.x_m + part * x_m - point.x_m
    return hypot(off_x_m, before.y_m + part * y_m - point.y_m) <= tolerance_m
