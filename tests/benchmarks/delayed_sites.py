"""Random sites, and the operator of a rover on them behind a delay, in lock step.

The operator sees rocks near the rover in pictures, thinks, and sends paths. `Mission` plays one
site; a committed path is extended ahead of the rover, else each path waits for the end of the one
before.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil, hypot, inf, radians
from pathlib import Path
from random import Random
from typing import Any, Final

from adapters.twin import PredictedPose
from adapters.twin.twin import REPORT_MARGIN_S
from executive.commands import (
    ConfirmPose,
    FollowPath,
    MoveForward,
    Request,
    Resume,
    RotateBy,
    Waypoint,
)
from executive.obstacles.detour import search_detour
from executive.obstacles.zones import ROUNDING_M, KnownRock, Zones
from executive.settings import Settings, load_settings
from executive.values.geometry import Point, Pose, path_length_m, wrap_rad
from executive.values.reports import TERMINAL, Identity, Stage
from sim.rover import World
from sim.rover.faults import LeftWheelsStuck
from sim.rover.lockstep import LockStep
from sim.rover.world import Clearing, Scatter, SoilShape, StartPose
from tests.support.delayed import DelayedLink

LENGTH_M: Final = 16.0
START: Final = Point(-LENGTH_M / 2, 0.0)
GOAL: Final = Point(LENGTH_M / 2, 0.0)
SPEED_MPS: Final = 0.5
SIGHT_M: Final = 6.0
THINK_S: Final = 5.0
PICTURE_S: Final = 2.0
"""From a picture to its last octet."""
PICTURES_S: Final = 1.0
"""Between two pictures on the move."""
STUCK_S: Final = 1.5
CLEARANCE_M: Final = 0.6
"""Of planned paths from the centres' outlines: half a rover, and what drift and slip may add."""
BORDER_M: Final = 0.6
"""How far within sight a path has to end."""
EXTENSION_M: Final = 0.5
"""The shortest path worth sending, unless it reaches the goal."""
STEP_M: Final = 0.1
LONG_S: Final = 60.0
MAX_MISSION_S: Final = 7200.0


def site(number: int) -> World:
    """Return a site: a third each flat, rough, and rough on a slope of 2 to 6°."""
    random = Random(f"site {number}")
    clearings = tuple(Clearing(each.x_m, each.y_m, 1.2) for each in (START, GOAL))
    return World(
        name=f"site {number}",
        ground=SoilShape(0.08 if number % 3 else 0.0, 4.0, 30.0, number),
        slope_rad=radians(random.uniform(2.0, 6.0)) if number % 3 == 2 else 0.0,
        friction=random.uniform(0.45, 0.75),
        scatter=Scatter(random.randint(70, 110), 24.0, seed=number, clearings=clearings),
        start=StartPose(START.x_m, START.y_m),
    )


def stuck_after_m(number: int) -> float | None:
    """Return the distance after which the left wheels stick, at every second site."""
    return Random(f"stuck {number}").uniform(2.0, 12.0) if number % 2 else None


@dataclass(frozen=True, slots=True)
class View:
    """A picture: when and from where it was taken, and the rocks in sight then."""

    utc_s: float
    pose: Pose
    rocks: tuple[KnownRock, ...]


@dataclass(frozen=True, slots=True)
class Judged:
    """A prediction, and the pose by odometry at the time of arrival.

    Attributes:
        unexpected: whether the wheels had stuck before, or a command was lost.
    """

    predicted: PredictedPose
    error_m: float
    off_path_m: float
    moving: bool
    unexpected: bool


@dataclass(slots=True)
class Played:
    """Result of a mission; a duration of None: it did not reach the goal."""

    duration_s: float | None = None
    contacts: int = 0
    refused: int = 0
    lost: int = 0
    judged: list[Judged] = field(default_factory=list)


Terms = Callable[[Pose], dict[str, Any]]
"""Returns fields of a command, by its planned start pose."""


class Mission:
    """One site, driven by one operator.

    Args:
        number: of the site.
        round_trip_s: of the link.
        committed: whether paths are extended ahead of the rover.
        relative: whether legs are turns and drives instead of waypoints.
        loss: probability that a command is lost.
        stuck: whether wheels may stick; see `stuck_after_m`.
        terms: adds fields to each motion command.
    """

    def __init__(
        self,
        number: int,
        folder: Path,
        round_trip_s: float,
        *,
        committed: bool = True,
        relative: bool = False,
        loss: float = 0.0,
        stuck: bool = True,
        terms: Terms = lambda _: {},
    ) -> None:
        self._world = site(number)
        self._bench = LockStep(settings(), self._world, folder, seed=number, skips=True)
        self.link = DelayedLink(self._bench, round_trip_s / 2, loss, number)
        self._committed, self._relative, self._terms = committed, relative, terms
        self._stuck_after_m = stuck_after_m(number) if stuck else None
        self._stuck_until_s = 0.0
        self._rocks: dict[str, KnownRock] = {}
        self._views: deque[tuple[float, View]] = deque()
        self._next_view_s = 0.0
        self._end = self._world.start_pose
        self._motions: dict[Identity, float] = {}
        self._ended_utc_s = 0.0
        self._repair = False
        self._moving = False
        self._pending: deque[PredictedPose] = deque()
        self._next_prediction_s = 2.0
        self._prediction_s = 1.0 if round_trip_s < LONG_S else 5.0
        self.played = Played()

    def play(self, *, predicts: bool = True) -> Played:
        """Drive to the goal, or until two hours have passed."""
        bench, played = self._bench, self.played
        if not predicts:
            self._next_prediction_s = inf
        try:
            while bench.time_s < MAX_MISSION_S:
                self._step()
                off_m = self.link.pose.point.distance_m(GOAL)
                if off_m < BORDER_M and not bench.executive.goal_count:
                    played.duration_s = bench.time_s
                    break
            played.contacts = bench.rover.contacts
            played.lost = sum(lost for _, lost in self.link.sent)
            return played
        finally:
            self.link.twin.close()
            bench.executive.close()

    def _step(self) -> None:
        link, bench = self.link, self._bench
        link.step()
        self._stick()
        self._take_picture()
        self._judge()
        self._operate()
        times_s = [each for each, _ in self._views]
        if link.in_transit:
            times_s.append(self._next_prediction_s)
        if self._pending and link.in_transit:
            times_s.append(bench.time_s + self._pending[0].arrival_utc_s - link.utc_s)
        link.skip(min(times_s, default=inf) - bench.time_s)

    def _stick(self) -> None:
        rover, bench = self._bench.rover, self._bench
        if self._stuck_after_m is not None:
            if rover.true_pose.x_m - START.x_m > self._stuck_after_m and bench.executive.moving:
                rover.inject(LeftWheelsStuck())
                self._stuck_after_m, self._stuck_until_s = None, bench.time_s + STUCK_S
        elif self._stuck_until_s and bench.time_s >= self._stuck_until_s:
            rover.clear(LeftWheelsStuck)

    def _take_picture(self) -> None:
        """Take a picture every second of motion, and at each halt."""
        bench, link = self._bench, self.link
        halted = self._moving and not bench.executive.moving
        self._moving = bench.executive.moving
        due = bench.time_s >= self._next_view_s and (self._moving or self._repair)
        if halted or due or not self._next_view_s:
            self._next_view_s = bench.time_s + PICTURES_S
            true_pose = bench.rover.true_pose
            into = link.pose.compose(true_pose.inverse)
            seen = (
                KnownRock(f"{each.radius_m:.9f}", point.x_m, point.y_m, each.radius_m)
                for each in self._world.all_rocks
                if Point(each.x_m, each.y_m).distance_m(true_pose.point) < SIGHT_M + each.radius_m
                for point in (into.compose(Pose(each.x_m, each.y_m)).point,)
            )
            view = View(link.utc_s, link.pose, tuple(seen))
            self._views.append((bench.time_s + PICTURE_S + link.one_way_s + THINK_S, view))

    def _judge(self) -> None:
        """Predict once a second, and compare with the rover at the time of arrival."""
        bench, link = self._bench, self.link
        while self._pending and self._pending[0].arrival_utc_s <= link.utc_s + 1e-6:
            found = self._pending.popleft()
            self.played.judged.append(
                Judged(
                    found,
                    found.pose.point.distance_m(link.pose.point),
                    off_path_m(found.path, link.pose.point),
                    bench.executive.velocity.travel_mps != 0.0,
                    bool(self._stuck_until_s) or any(lost for _, lost in link.sent),
                )
            )
        if link.in_transit and bench.time_s >= self._next_prediction_s:
            self._next_prediction_s = bench.time_s + self._prediction_s
            predicted = link.twin.predict(link.utc_s)
            if predicted is not None:
                self._pending.append(predicted)

    def _operate(self) -> None:
        """Send the path that a picture shows to be free, once it has been thought over."""
        self._follow_up()
        while self._views and self._views[0][0] <= self._bench.time_s:
            view = self._views.popleft()[1]
            self._rocks |= {each.name: each for each in view.rocks}
            halted = not self._motions and view.utc_s >= self._ended_utc_s - 0.1
            if self._repair and halted:
                self._repair, self._end = False, view.pose
                self.link.send(Resume())
                self.link.send(ConfirmPose(0.0, 0.0))
            if not self._repair and (self._committed or halted):
                self._send(self._path(view))

    def _follow_up(self) -> None:
        """Learn how motions ended; one that failed, or was lost, needs another plan."""
        link = self.link
        for identity, sent_s in self._motions.items():
            stages = link.stages(identity)
            late_s = sent_s + 2 * link.one_way_s + REPORT_MARGIN_S
            if (stages and stages[-1] in TERMINAL) or (not stages and link.utc_s > late_s):
                self._repair |= not stages or stages[-1] is not Stage.EXECUTED
                self._ended_utc_s = link.utc_s - link.one_way_s
                del self._motions[identity]
                if stages and stages[-1] is Stage.FAILED:
                    self._motions.clear()  # it is stopped: those arrive before a resume
                break

    def _path(self, view: View) -> list[Point]:
        """Return the waypoints of the next path, none if it is not worth sending."""
        start, zones = self._end.point, Zones(rocks=tuple(self._rocks.values()))
        bounds_m = [(each, each.clearance_m(start, start) - ROUNDING_M) for each in zones]

        def leads(point: Point) -> bool:
            return all(
                each.clearance_m(start, point) >= min(CLEARANCE_M, free_m)
                for each, free_m in bounds_m
            )

        search = search_detour(start, GOAL, zones, CLEARANCE_M, leads)
        while True:
            try:
                next(search)
            except StopIteration as end:
                detour = end.value
                break
        corners = [start, *detour.corners, *([GOAL] if detour.reaches_goal else [])]
        path = list(_within(corners, view.pose.point, SIGHT_M - BORDER_M))
        far = path_length_m([start, *path]) >= EXTENSION_M
        return path if far or (path and path[-1] == GOAL) else []

    def _send(self, path: list[Point]) -> None:
        before = self._end
        if not path or before.point == GOAL:
            return
        if not self._relative:
            last = [before.point, *path][-2]
            self._end = Pose(path[-1].x_m, path[-1].y_m, heading_rad=last.bearing_rad(path[-1]))
            self._send_motion(FollowPath(tuple(Waypoint(p.x_m, p.y_m) for p in path)), before)
            return
        for point in path:
            heading_rad = before.point.bearing_rad(point)
            turned = replace(before, heading_rad=heading_rad)
            self._send_motion(RotateBy(wrap_rad(heading_rad - before.heading_rad)), before)
            self._send_motion(MoveForward(before.point.distance_m(point)), turned)
            before = self._end = Pose(point.x_m, point.y_m, heading_rad=heading_rad)

    def _send_motion(self, request: Request, begin: Pose) -> None:
        self._motions[self.link.send(request, **self._terms(begin))] = self.link.utc_s


def _within(corners: list[Point], centre: Point, radius_m: float) -> Iterator[Point]:
    """Yield the corners after the first up to where their line leaves a disc."""
    for start, end in pairwise(corners):
        length_m, last = start.distance_m(end), start
        for step in range(1, ceil(length_m / STEP_M) + 1):
            part = min(1.0, step * STEP_M / length_m)
            x_m = start.x_m + part * (end.x_m - start.x_m)
            point = Point(x_m, start.y_m + part * (end.y_m - start.y_m))
            if point.distance_m(centre) > radius_m:
                if step > 1:
                    yield last
                return
            last = point
        yield end


def off_path_m(path: tuple[Point, ...], point: Point) -> float:
    """Return the distance of a point from a polyline."""

    def off_m(start: Point, end: Point) -> float:
        dx_m, dy_m = end.x_m - start.x_m, end.y_m - start.y_m
        along = (point.x_m - start.x_m) * dx_m + (point.y_m - start.y_m) * dy_m
        part = min(1.0, max(0.0, along / (dx_m * dx_m + dy_m * dy_m or 1.0)))
        return hypot(start.x_m + part * dx_m - point.x_m, start.y_m + part * dy_m - point.y_m)

    return min(off_m(*pair) for pair in pairwise(path))


def settings() -> Settings:
    """Return the Jackal at the speed of these missions."""
    jackal = load_settings("jackal")
    return replace(jackal, drive=replace(jackal.drive, travel_speed_mps=SPEED_MPS))
