"""HTTP requests of the map: steps of a plan aboard, and obstacles that the laser detected."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final, TypeVar

from aiohttp import web

from adapters.console.requests.commanding import Commanding
from adapters.console.web import invalid, json_response, refused
from adapters.mal import MalError
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import describe_error
from executive.commands import FollowPath, Motion, MoveTo, argument_values, declaration_of
from executive.plans import PlanNode, PlanStep, check_plan, nominal_steps
from executive.settings import Settings, TargetFrame
from executive.values.geometry import Pose
from executive.values.reasons import Refusal

T = TypeVar("T")

QUERY_TIMEOUT_S: Final = 20.0


@dataclass(frozen=True, slots=True)
class RouteStep:
    """A step of a plan, if each step before it succeeds.

    Attributes:
        node: path of its leaf, as in `PlanProgress`.
        name, args: its request, as in `CommandStatus`.
        frame: frame of the points: odom or map.
        points: positions where it turns, and its end, m; empty without a motion, or if unknown.
    """

    node: str
    name: str
    args: dict[str, Any]
    frame: str
    points: tuple[tuple[float, ...], ...]


def route_of(root: PlanNode, settings: Settings, start: Pose | None) -> Iterator[RouteStep]:
    """Yield the steps of a plan in order.

    Args:
        root: root node of the plan.
        settings: settings of the asset.
        start: start pose in the odometry frame; None if unknown.
    """
    pose, frame = start, TargetFrame.ODOM
    for step in nominal_steps(root):
        if not isinstance(step, PlanStep):
            continue
        request, points = step.request, []
        if isinstance(request, MoveTo | FollowPath):
            wanted = request.frame or settings.frame
            pose, frame = (pose if wanted is frame else None) or Pose(), wanted
        if isinstance(request, Motion) and pose is not None:
            segments = request.segments(pose)
            points = [(each.end.x_m, each.end.y_m) for each in segments if each.by_m]
            pose = segments[-1].end
        name, args = declaration_of(type(request)).name, argument_values(request)
        yield RouteStep(step.location.path, name, args, frame.value, tuple(points))


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
        plan = await self._query(asset, lambda client: client.get_plan(plan_id))
        settings = self._commanding.settings(asset)
        root = None if settings is None else check_plan(plan, settings)
        if settings is None or root is None or isinstance(root, Refusal):
            text = f"plan {plan_id} does not fit the settings of {asset} that are installed here"
            raise refused(HTTPStatus.NOT_IMPLEMENTED, text)
        return json_response({"steps": list(route_of(root, settings, _start_of(request)))})

    async def _obstacles(self, request: web.Request) -> web.Response:
        found = await self._query(request.match_info["asset"], lambda each: each.get_obstacles())
        return json_response({"obstacles": [(each.x, each.y, each.radius) for each in found]})

    async def _query(self, asset: str, query: Callable[[MrsClient], Awaitable[T]]) -> T:
        try:
            async with asyncio.timeout(QUERY_TIMEOUT_S):
                return await query(self._commanding.client(asset))
        except MalError as error:
            raise refused(HTTPStatus.NOT_IMPLEMENTED, describe_error(error)) from error
        except (ConnectionError, TimeoutError) as error:
            text = f"{asset} does not answer: try again when its link is up"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text) from error


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
