"""`PathPlanning` requests the path of a navigated leg from the navigation's planner.

The leg waits for it, and is then checked along it: clearance, battery, deadline. Without a path
the straight lines to its targets are checked instead, and the command reports that. The rover
stops before a zone on any path (fault `zone_ahead`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

from executive.checks import check_planned_path
from executive.commands import Waypoint
from executive.faults import Reaction
from executive.goals import Context, Goal
from executive.values.geometry import Point, Pose, path_length_m
from executive.values.ports import PLANNER_WAIT_S, PathRequest
from executive.values.reasons import Reason, Refusal

_STOPS: Final = {Reaction.PAUSE, Reaction.STOP, Reaction.SAFE}
NO_PATH: Final = "no path of the planner"
MAX_END_GAP_M: Final = 1.0
"""Maximum distance of a path's ends from those requested; Nav2's planner tolerates 0.5 m."""


@dataclass(frozen=True, slots=True)
class LegPath:
    """The path of a leg through its targets, in the odometry frame.

    Attributes:
        missing: why it consists of straight lines; empty if the planner gave it.
        longer_m: by how much it exceeds the straight lines.
    """

    points: tuple[Point, ...]
    missing: str
    longer_m: float

    def check(self, context: Context) -> Refusal | None:
        """Return a refusal if it violates the clearance to a zone or a known rock, or None.

        A path that is unknown is permitted near these only if their monitor stops the rover.
        """
        settings, zones = context.settings, context.status.obstacles.known
        refusal = check_planned_path(self.points, settings, zones, self.missing)
        if refusal is None and self.missing and zones.not_empty:
            reaction = settings.faults.zone_ahead.reaction
            if reaction not in _STOPS:
                text = f"{self.missing}, and zone_ahead does not stop the rover: {reaction.value}"
                return Refusal(Reason.PATH_BLOCKED, text)
        return refusal

    def __str__(self) -> str:
        length = f"{path_length_m(self.points):.2f} m"
        if self.missing:
            return f"straight line of {length} checked: {self.missing}"
        return f"planned path of {length}"


class PathPlanning:
    """Requests the path of a leg from the present pose, from target to target.

    Args:
        targets: in the odometry frame.
        numbers: of requests.
    """

    def __init__(
        self, context: Context, goal: Goal, targets: Sequence[Waypoint], numbers: Iterator[int]
    ) -> None:
        self._status, self._intents, self._clock = context.status, context.intents, context.clock
        self._goal, self._numbers = goal, numbers
        self._ends = [context.status.pose]
        for each in targets:
            point, heading_rad = Point(each.x_m, each.y_m), each.heading_rad
            if heading_rad is None:
                heading_rad = self._ends[-1].point.bearing_rad(point)
            self._ends.append(Pose(point.x_m, point.y_m, heading_rad=heading_rad))
        self._points, self._parts = [self._ends[0].point], 0
        self._request: PathRequest | None = None
        self._until_s = context.clock.now_s() + PLANNER_WAIT_S

    def path(self) -> LegPath | None:
        """Return the path, or None while it is awaited; requests the next part in this tick."""
        origin, frame = self._goal.target_frame(self._status)
        start, *later = self._ends[self._parts :]
        if self._request is not None:
            answer = self._status.planned_path(self._request.number)
            if answer is None:
                late = self._clock.now_s() >= self._until_s
                return self._found(f"{NO_PATH} in time") if late else None
            points = [origin.compose(Pose(each.x_m, each.y_m)).point for each in answer.points]
            if not points:
                return self._found(answer.text or NO_PATH)
            if missing := _mismatch(points, start.point, later[0].point):
                return self._found(missing)
            self._points, self._parts, self._request = (
                [*self._points, *points],
                self._parts + 1,
                None,
            )
            start, *later = later
        if not later:
            return self._found("")
        ends = origin.inverse.compose(start), origin.inverse.compose(later[0])
        self._request = self._intents.path = PathRequest(next(self._numbers), *ends, frame)
        return None

    def _found(self, missing: str) -> LegPath:
        straight = tuple(each.point for each in self._ends)
        points = straight if missing else (*self._points, straight[-1])
        longer_m = path_length_m(points) - path_length_m(straight)
        return LegPath(points, missing, max(0.0, longer_m))


def _mismatch(points: Sequence[Point], start: Point, end: Point) -> str:
    """Return why points are no path between two others; empty if they are one."""
    if not all(isfinite(each.x_m) and isfinite(each.y_m) for each in points):
        return "the planner's path is not finite"
    for name, gap_m in (
        ("begins", start.distance_m(points[0])),
        ("ends", end.distance_m(points[-1])),
    ):
        if gap_m > MAX_END_GAP_M:
            return f"the planner's path {name} {gap_m:.2f} m from where it should"
    return ""
