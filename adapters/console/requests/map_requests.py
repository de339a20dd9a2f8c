"""HTTP requests of the map: steps of a plan aboard, and obstacles that the laser detected."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final

from aiohttp import web

from adapters.console.requests.commanding import Commanding
from adapters.console.requests.plan_steps import commands_of
from adapters.console.web import invalid, json_response, refused
from executive.commands import FollowPath, Motion, MoveTo, argument_values, declaration_of
from executive.plans import PlanNode, PlanStep, check_plan, nominal_steps, steps
from executive.settings import Settings, TargetFrame
from executive.values.geometry import Pose
from executive.values.reasons import Refusal

MAX_CYCLES: Final = 20
"""Maximum number of positions of a leaf in loops; chosen, not measured."""


@dataclass(frozen=True, slots=True)
class RouteStep:
    """A step of a plan, if each step before it succeeds.

    Attributes:
        node: path of its leaf, as in `PlanProgress`.
        number: number of its leaf, from 1.
        name, args: its request, as in `CommandStatus`.
        frame: frame of the points: odom or map.
        points: positions where it turns, and its end, m; empty without a motion, or if unknown.
        at: position at its end, m; None if unknown.
        times: number of remaining executions, those of loops included.
    """

    node: str
    number: int
    name: str
    args: dict[str, Any]
    frame: str
    points: tuple[tuple[float, ...], ...]
    at: tuple[float, ...] | None
    times: int


def route_of(
    root: PlanNode, settings: Settings, start: Pose | None, node: str | None = None, done: int = 0
) -> Iterator[RouteStep]:
    """Yield the steps of a plan in order; those of a loop once per position.

    Args:
        root: root node of the plan.
        settings: settings of the asset.
        start: start pose in the odometry frame; None if unknown.
        node: path of the present leaf, the first step; None for all steps.
        done: number of leaves that have ended or were skipped.
    """
    pose, frame = start, TargetFrame.ODOM
    numbers = {each.location.path: number for number, each in enumerate(steps(root), 1)}
    known: dict[str, set[object]] = {}
    remaining = _remaining(root, node, done)
    times = Counter(each.location.path for each in remaining)
    for step in remaining:
        request, points = step.request, []
        assert request is not None  # nominal steps have their requests
        if isinstance(request, MoveTo | FollowPath):
            wanted = request.frame or settings.frame
            pose, frame = (pose if wanted is frame else None) or Pose(), wanted
        if isinstance(request, Motion) and pose is not None:
            segments = request.segments(pose)
            points = [_position(each.end) for each in segments if each.by_m]
            pose = segments[-1].end
        path, at = step.location.path, None if pose is None else _position(pose)
        positions = known.setdefault(path, set())
        if at in positions or len(positions) == MAX_CYCLES:
            continue
        positions.add(at)
        yield RouteStep(
            node=path,
            number=numbers[path],
            name=declaration_of(type(request)).name,
            args=argument_values(request),
            frame=frame.value,
            points=tuple(points),
            at=at,
            times=times[path],
        )


def _remaining(root: PlanNode, node: str | None, done: int) -> Sequence[PlanStep]:
    """Return the nominal steps from a leaf on, or those after it if the leaf is not nominal."""
    listed = commands_of(root)
    if listed is not None:  # a suspended sequence may continue after its last leaf
        return listed[done:]
    nominal = [each for each in nominal_steps(root) if isinstance(each, PlanStep)]
    paths = [each.location.path for each in nominal]
    if node in paths:
        return nominal[paths.index(node) :]
    found = [each.location.number for each in steps(root) if each.location.path == node]
    return [each for each in nominal if not found or each.location.number > found[0]]


def _position(pose: Pose) -> tuple[float, float]:
    return round(pose.x_m, 3), round(pose.y_m, 3)


class MapRequests:
    """Serves these requests.

    Args:
        commanding: access to assets.
    """

    def __init__(self, commanding: Commanding) -> None:
        self._commanding = commanding

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.get("/api/plans/{asset}/{plan}/steps", self._steps),
            web.get("/api/obstacles/{asset}", self._obstacles),
        ]

    async def _steps(self, request: web.Request) -> web.Response:
        asset, plan_id = request.match_info["asset"], request.match_info["plan"]
        plan = await self._commanding.query(asset, lambda client: client.get_plan(plan_id))
        settings = self._commanding.settings(asset)
        root = None if settings is None else check_plan(plan, settings)
        if settings is None or root is None or isinstance(root, Refusal):
            text = f"plan {plan_id} does not fit the settings of {asset} that are installed here"
            raise refused(HTTPStatus.NOT_IMPLEMENTED, text)
        node, done = request.query.get("node"), _done_of(request)
        route = route_of(root, settings, _start_of(request), node, done)
        return json_response({"steps": list(route)})

    async def _obstacles(self, request: web.Request) -> web.Response:
        asset = request.match_info["asset"]
        found = await self._commanding.query(asset, lambda client: client.get_obstacles())
        return json_response({"obstacles": [(each.x, each.y, each.radius) for each in found]})


def _start_of(request: web.Request) -> Pose | None:
    """Return the start pose of a request, `start=x,y,heading`; None if it has none."""
    given = request.query.get("start")
    if given is None:
        return None
    try:
        x_m, y_m, heading_rad = map(float, given.split(","))
    except ValueError:
        raise invalid("start", "x,y,heading are needed, in m and rad") from None
    return Pose(x_m, y_m, heading_rad=heading_rad)


def _done_of(request: web.Request) -> int:
    try:
        return max(int(request.query.get("done", "0")), 0)
    except ValueError:
        raise invalid("done", "a number of leaves is needed") from None
