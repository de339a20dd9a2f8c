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
from executive.commands.intake import in_map
from executive.faults import Reaction
from executive.goals import Context, Goal
from executive.values.geometry import Point, Pose, TargetFrame, path_length_m
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
        self._context = context
        self._numbers = numbers
        in_its_map = in_map(goal.command.request, context.settings)
        self._frame = TargetFrame.MAP if in_its_map else TargetFrame.ODOM
        ends = [context.status.pose]
        for each in targets:
            point, heading_rad = Point(each.x_m, each.y_m), each.heading_rad
            if heading_rad is None:
                heading_rad = ends[-1].point.bearing_rad(point)
            ends.append(Pose(point.x_m, point.y_m, heading_rad=heading_rad))
        self._ends = tuple(ends)
        self._points, self._parts = [ends[0].point], 0
        self._request: PathRequest | None = None
        self._until_s = context.clock.now_s() + PLANNER_WAIT_S

    def path(self) -> LegPath | None:
        """Return the path, or None while it is awaited; requests the next part in this tick."""
        if self._request is not None:
            answer = self._context.status.planned_path(self._request.number)
            if answer is None:
                late = self._context.clock.now_s() >= self._until_s
                return self._straight(f"{NO_PATH} in time") if late else None
            points = [self._in_odom(each) for each in answer.points]
            if missing := self._unusable(points, answer.text):
                return self._straight(missing)
            self._points += points
            self._parts += 1
        if self._parts + 1 == len(self._ends):
            points = [*self._points, self._ends[-1].point]
            return self._found(tuple(points), "")
        start, end = self._ends[self._parts : self._parts + 2]
        into = self._origin.inverse
        number = next(self._numbers)
        self._request = PathRequest(number, into.compose(start), into.compose(end), self._frame)
        self._context.intents.path = self._request
        return None

    @property
    def _origin(self) -> Pose:
        """Origin of the requests' frame in the odometry frame."""
        status = self._context.status
        if self._frame is TargetFrame.ODOM:
            return status.odom_origin
        origin = status.map_origin
        return Pose() if isinstance(origin, Refusal) else origin

    def _in_odom(self, point: Point) -> Point:
        return self._origin.compose(Pose(point.x_m, point.y_m)).point

    def _unusable(self, points: list[Point], text: str) -> str:
        """Return why points are no path between the requested ends; empty if they are one."""
        if not points:
            return text or NO_PATH
        if not all(isfinite(each.x_m) and isfinite(each.y_m) for each in points):
            return "the planner's path is not finite"
        start, end = self._ends[self._parts : self._parts + 2]
        for name, wanted, given in (("begins", start, points[0]), ("ends", end, points[-1])):
            if (gap_m := wanted.point.distance_m(given)) > MAX_END_GAP_M:
                return f"the planner's path {name} {gap_m:.2f} m from where it should"
        return ""

    def _straight(self, missing: str) -> LegPath:
        return self._found(tuple(each.point for each in self._ends), missing)

    def _found(self, points: tuple[Point, ...], missing: str) -> LegPath:
        straight_m = path_length_m([each.point for each in self._ends])
        return LegPath(points, missing, max(0.0, path_length_m(points) - straight_m))
