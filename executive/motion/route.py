"""The places that a leg leads through before it ends, and how far the rover has come along them."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Final

from executive.commands import Waypoint
from executive.motion.plan import ANY_RAD, PASSED_AT_ONCE, TrajectoryTarget
from executive.values.geometry import Point

AIM_SHARE: Final = 0.4
"""Of the tolerances: within which a plan ends, or passes a place."""
ROOM_M: Final = 0.03
"""Between the aim and a wide tolerance: more than the rover is beside its plans."""
SEEN_S: Final = 0.5
"""After a plan has led past a place, within which odometry is to see the rover pass it."""


def aim_within_m(tolerance_m: float) -> float:
    """Return within which distance of a place a plan ends there, or passes it."""
    return max(AIM_SHARE * tolerance_m, tolerance_m - ROOM_M)


@dataclass(frozen=True, slots=True)
class _ViaPoint:
    target: TrajectoryTarget
    tolerance_m: float


class Route:
    """The places to pass, in their order, and the end.

    Args:
        through: the places to pass with base_link.
        default_m: the tolerance of those that have none.
        ahead_m: of the control point, from base_link.
        end: where the leg ends.

    Attributes:
        passed: how many places odometry has seen the rover pass, within their tolerances.
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
        """The index of the end, after those of the places."""
        return len(self._places)

    @property
    def left(self) -> tuple[Point, ...]:
        """The places that are not passed yet, and the end."""
        return tuple(each.point for each in self._targets[self.passed :])

    def observe(self, point: Point, now_s: float) -> bool:
        """Note where odometry has base_link; return whether it missed a place that it passed."""
        before, self._seen = self._seen or point, point
        if self.passed < self.end:
            place = self._places[self.passed]
            if passes_by(place.target.point, place.tolerance_m, before, point):
                self.passed += 1
        behind_s = self._behind_s[self.passed :]
        return bool(behind_s) and now_s - behind_s[0] > SEEN_S

    def plan_from(self, index: int, now_s: float) -> tuple[TrajectoryTarget, ...]:
        """Return what to plan for once plans lead past so many places: some to pass, and an end."""
        self._behind_s = self._behind_s[:index]
        self._behind_s += [now_s] * (index - len(self._behind_s))
        return self._targets[index : index + PASSED_AT_ONCE + 1]


def passes_by(place: Point, tolerance_m: float, before: Point, after: Point) -> bool:
    """Return whether a straight line leads past a place, within a tolerance."""
    x_m, y_m = after.x_m - before.x_m, after.y_m - before.y_m
    squared = x_m**2 + y_m**2
    along = (place.x_m - before.x_m) * x_m + (place.y_m - before.y_m) * y_m
    part = min(max(along / squared, 0.0), 1.0) if squared else 0.0
    off_x_m = before.x_m + part * x_m - place.x_m
    return hypot(off_x_m, before.y_m + part * y_m - place.y_m) <= tolerance_m
