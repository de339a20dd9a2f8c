"""`NavigatedBase` simulates a rover with its navigation in a preview: it follows the path."""

from math import copysign

from executive.preview.preview_rover import KinematicBase
from executive.settings import Settings
from executive.values.clock import ManualClock
from executive.values.facts import (
    Fact,
    NavigationFeedback,
    NavigationState,
    NavigationStatus,
    PlannedPath,
)
from executive.values.geometry import STANDING, Point, Pose, TargetFrame, Velocity, wrap_rad
from executive.values.ports import NavigateTo, NavigationGoal, PathRequest

CORNER_RAD = 0.5
"""Maximum corner of a path that is turned while driving; others are turned on the spot. Chosen."""
END_M = END_RAD = 0.15
"""Distance and angle from its target where the navigation ends; chosen. Nav2: at most 0.25."""


class NavigatedBase(KinematicBase):
    """Base with a navigation that drives along the planner's path exactly, at the maximum speeds.

    Without such a path it drives straight to each pose. Its odometry frame is that of the pose.

    Args:
        map_origin: origin of the map in the odometry frame.
        speeds: its maximum speeds.

    Attributes:
        path_request: the path that the copy waits for; None if it waits for none.
    """

    def __init__(
        self,
        clock: ManualClock,
        settings: Settings,
        pose: Pose,
        map_origin: Pose,
        speeds: Velocity,
    ) -> None:
        super().__init__(clock, settings, pose)
        self._origins = {TargetFrame.ODOM: Pose(), TargetFrame.MAP: map_origin}
        self._speeds = speeds
        self._turns_on_spot = settings.drive.min_turning_radius_m is None
        self._is_open = False
        self._goal: NavigationGoal | None = None
        self._planned: list[Point] = []
        self._left: list[Point] = []
        self._heading_rad = pose.heading_rad
        self._due: list[Fact] = []
        self.path_request: PathRequest | None = None

    def plan_path(self, request: PathRequest) -> None:
        """Wait for `provide_path`."""
        self.path_request = request

    def provide_path(self, points: tuple[Point, ...], text: str) -> None:
        """Answer the request by points in the frame of the pose, or by why there are none."""
        request, self.path_request = self.path_request, None
        if request is not None:
            self._planned += points
            into = self._origins[request.frame].inverse
            answer = tuple(into.compose(Pose(each.x_m, each.y_m)).point for each in points)
            self._due.append(PlannedPath(request.number, answer, text))

    def navigate(self, goal: NavigationGoal) -> None:
        """Accept a goal, and follow the path that was planned for it."""
        self._goal, self._left, self._planned = goal, self._planned, []
        self._due.append(NavigationStatus(goal.number, NavigationState.ACCEPTED))
        assert isinstance(goal.task, NavigateTo)
        origin = self._origins[goal.task.frame]
        ends = [origin.compose(each) for each in goal.task.poses]
        points = [each.point for each in ends]
        self._left = [*self._left[:-1], points[-1]] if self._left else points
        self._heading_rad = ends[-1].heading_rad

    def cancel_navigation(self) -> None:
        """End the goal."""
        self._goal = None

    def open_gate(self, is_open: bool) -> None:
        """Move by the navigation while the gate is open."""
        self._is_open = is_open

    def drive(self, velocity: Velocity) -> None:
        """Apply a velocity command, unless the navigation drives."""
        if not self._is_open:
            super().drive(velocity)

    def advance(self) -> None:
        """Advance to the clock's time."""
        goal, now_s = self._goal, self._clock.now_s()
        if goal is None or not self._is_open:
            super().advance()
            return
        self._pending.clear()
        before, passed_s, self._at_s = self.pose, now_s - self._at_s, now_s
        left_s = self._follow(passed_s)
        turned_rad = wrap_rad(self.pose.heading_rad - before.heading_rad)
        moved_m = before.point.distance_m(self.pose.point)
        if passed_s:
            self.velocity = Velocity(moved_m / passed_s, turned_rad / passed_s)
        self._due.append(NavigationFeedback(goal.number, None))
        if left_s:
            self._goal, self.velocity = None, STANDING
            self._due.append(NavigationStatus(goal.number, NavigationState.SUCCEEDED))

    def facts(self) -> tuple[Fact, ...]:
        """Return the facts that it reports now, those of the navigation once."""
        due, self._due = tuple(self._due), []
        return (*super().facts(), *due)

    def _follow(self, left_s: float) -> float:
        """Follow the path for a time; return the time that is left at its end."""
        while self._left and left_s:
            at = self.pose.point
            point, is_last = self._left[0], len(self._left) == 1
            length_m = max(0.0, at.distance_m(point) - (END_M if is_last else 0.0))
            if length_m:
                left_s = self._turn(at.bearing_rad(point), left_s, CORNER_RAD)
            moved_m = min(length_m, self._speeds.travel_mps * left_s)
            left_s = max(0.0, left_s - moved_m / self._speeds.travel_mps)
            if moved_m == length_m:
                del self._left[0]
            ahead = self.pose.ahead(moved_m)
            self.pose = Pose(ahead.x_m, ahead.y_m, heading_rad=self.pose.heading_rad)
        if not self._left:
            by_rad = wrap_rad(self._heading_rad - self.pose.heading_rad)
            by_rad = copysign(max(0.0, abs(by_rad) - END_RAD), by_rad)
            left_s = self._turn(self.pose.heading_rad + by_rad, left_s, 0.0)
        return left_s

    def _turn(self, heading_rad: float, left_s: float, free_rad: float) -> float:
        """Turn for a time, at once up to an angle; return the time that is left."""
        by_rad = wrap_rad(heading_rad - self.pose.heading_rad)
        if self._turns_on_spot and abs(by_rad) > free_rad:
            turned_rad = min(abs(by_rad), self._speeds.rotate_radps * left_s)
            left_s = max(0.0, left_s - turned_rad / self._speeds.rotate_radps)
            by_rad = copysign(turned_rad, by_rad)
        heading_rad = wrap_rad(self.pose.heading_rad + by_rad)
        self.pose = Pose(self.pose.x_m, self.pose.y_m, heading_rad=heading_rad)
        return left_s
