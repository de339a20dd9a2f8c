"""`NavigationClient`: a navigation's action servers, by the interfaces of Nav2 or similar ones.

Interfaces differ between the distributions of ROS: packages are imported when a node starts, and
fields are used if the imported type has them. All facts are observed by `poll`, once a tick.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, Final

from action_msgs.msg import GoalStatus
from rclpy.node import Node

from adapters.ros.conversions import Precision, round_measurement
from adapters.ros.navigation_errors import error_name
from adapters.ros.navigation_messages import (
    Task,
    action_type,
    feedback_fact,
    goal_message,
    missed_poses,
    stamped_pose,
    thinned,
)
from adapters.ros.parameters import declare_optional_text
from adapters.ros.polled_action import ACTIVE, ENDED, PolledAction, Statuses
from adapters.ros.transforms import frame_names
from executive.settings import RelativeActions
from executive.values.clock import Clock
from executive.values.facts import Fact, NavigationState, NavigationStatus, PlannedPath
from executive.values.geometry import Point, Pose, TargetFrame
from executive.values.ports import DriveBy, NavigateTo, NavigationGoal, PathRequest, TurnBy

TO_POSE, THROUGH_POSES, PATH, TURN, DRIVE = (
    *("to_pose", "through_poses", "compute_path"),
    *("turn", "drive"),
)
ACTIONS: Final = {
    TO_POSE: ("navigate_to_pose", "nav2_msgs/action/NavigateToPose"),
    THROUGH_POSES: ("navigate_through_poses", "nav2_msgs/action/NavigateThroughPoses"),
    PATH: ("compute_path_to_pose", "nav2_msgs/action/ComputePathToPose"),
}
"""Name and type of each action if the parameter file gives none: Nav2's."""
RELATIVE: Final[dict[RelativeActions, dict[str, tuple[str, str]]]] = {
    RelativeActions.OFF: {},
    RelativeActions.NAV2: {
        TURN: ("spin", "nav2_msgs/action/Spin"),
        DRIVE: ("drive_on_heading", "nav2_msgs/action/DriveOnHeading"),
    },
    RelativeActions.CREATE3: {
        TURN: ("rotate_angle", "irobot_create_msgs/action/RotateAngle"),
        DRIVE: ("drive_distance", "irobot_create_msgs/action/DriveDistance"),
    },
}
CANCEL_FOR_S: Final = 10.0
"""Maximum duration of the repetition of a cancel without an answer; a discovery takes less."""
CANCEL_RETRY_S: Final = 1.0
CANCEL_ANSWER_S: Final = 0.5
"""Maximum wait of a new goal for the answer to a cancel, which would cancel that goal, too."""
RESULT_RETRY_S: Final = 1.0
SERVER_CHECK_S: Final = 0.5
PATH_ANSWER_S: Final = 2.0
MAX_ABANDONED: Final = 200
_ENDS: Final = {
    GoalStatus.STATUS_SUCCEEDED: NavigationState.SUCCEEDED,
    GoalStatus.STATUS_CANCELED: NavigationState.CANCELLED,
    GoalStatus.STATUS_ABORTED: NavigationState.ABORTED,
}
_LOG = logging.getLogger(__name__)


@dataclass(slots=True)
class _Server:
    """An action, and the cancel of all its goals, which is repeated until it is answered."""

    action: PolledAction
    cancel_until_s: float = -inf
    cancelled_s: float = -inf

    def awaits_cancel(self, now_s: float) -> bool:
        return now_s < min(self.cancel_until_s, self.cancelled_s + CANCEL_ANSWER_S)


@dataclass(slots=True)
class _SentGoal:
    """A goal that was sent and has not ended.

    Attributes:
        servers: ids of the servers when one of them reported the goal; None before.
        ended_s: when its status reported an end; its result is awaited.
    """

    goal: NavigationGoal
    server: _Server
    uuid: bytes = b""
    accepted: bool = False
    preempted: bool = False
    servers: frozenset[bytes] | None = None
    ended_s: float = inf


class NavigationClient:
    """Sends goals to the navigation, and observes their states.

    A goal without an answer may be executed all the same. Its UUID is not used again, and it is
    cancelled if its acceptance arrives late, as an answer or in the status topic.

    Args:
        node: declares parameters, and creates clients.
        clock: the core's clock.
        observe: called by `poll`.
        relative: relative actions that are used.

    Raises:
        ParameterError: a type is not of the form package/action/Name, or not in its package.
    """

    def __init__(
        self,
        node: Node,
        clock: Clock,
        observe: Callable[[Fact], None],
        relative: RelativeActions = RelativeActions.OFF,
    ) -> None:
        self._clock, self._observe = clock, observe
        map_frame, odom, _ = frame_names(node)
        self._frames = {TargetFrame.ODOM: odom, TargetFrame.MAP: map_frame or "map"}
        self._facts: list[Fact] = []
        self._sent: _SentGoal | None = None
        self._aborted: _SentGoal | None = None
        self._waiting: NavigationGoal | None = None
        self._abandoned: dict[bytes, PolledAction] = {}
        self._paths: dict[int, tuple[PathRequest, float]] = {}
        self._checked_s = -inf
        self._map_to_odom: Pose | None = None
        self._servers: dict[str, _Server] = {}
        self._missing: dict[str, str] = {}
        for key, default in {**ACTIONS, **RELATIVE[relative]}.items():
            self._add(node, key, default)
        for text in dict.fromkeys(self._missing.values()):
            _LOG.warning("no navigation: %s", text)

    def _add(self, node: Node, key: str, default: tuple[str, str]) -> None:
        given = (
            declare_optional_text(node, f"navigation.{key}.{part}", f"{part} of {key}")
            for part in ("action", "type")
        )
        name, kind_name = (one or other for one, other in zip(given, default, strict=True))
        kind = action_type(f"navigation.{key}.type", kind_name)
        if isinstance(kind, str):
            self._missing[key] = kind
            return

        def on_status(statuses: Statuses) -> None:
            self._on_status(server, statuses)

        server = _Server(PolledAction(node, kind, name, on_status, self._on_feedback))
        self._servers[key] = server

    def navigate(self, goal: NavigationGoal) -> None:
        """Send a goal under a new UUID after the answer to a cancel; abandon the last goal."""
        self._abandon()
        self._waiting = goal

    def cancel(self) -> None:
        """Cancel all goals of all servers, and any that was sent and is accepted later."""
        self._abandon()
        until_s = self._clock.now_s() + CANCEL_FOR_S
        for key, server in self._servers.items():
            if key != PATH:
                server.cancel_until_s, server.cancelled_s = until_s, -inf
        self._cancel_all()

    def plan(self, request: PathRequest) -> None:
        """Request a path; exactly one `PlannedPath` answers."""
        until_s = self._clock.now_s() + PATH_ANSWER_S
        self._paths[request.number] = request, until_s
        server = self._server(PATH)
        if isinstance(server, str):
            self._answer_path(request, (), server)
            return
        action = server.action
        frame = self._frames[request.frame]
        start, goal = (stamped_pose(each, frame) for each in (request.start, request.goal))
        message = action.kind.Goal(start=start, goal=goal, use_start=True)

        def on_answer(accepted: bool) -> None:
            if accepted:
                action.request_result(uuid, lambda _, result: self._on_path(request, result))
            else:
                self._answer_path(request, (), "the planner rejected the request")

        uuid = action.send(message, on_answer)

    def poll(self, map_to_odom: Pose | None) -> None:
        """Process answers and statuses, then observe the facts.

        Args:
            map_to_odom: pose of the odometry frame in the map, or None.
        """
        self._map_to_odom = map_to_odom
        for server in self._servers.values():
            server.action.poll()
        now_s = self._clock.now_s()
        self._cancel_all()
        self._send(now_s)
        self._check_goal(now_s)
        for request, until_s in list(self._paths.values()):
            if now_s > until_s:
                text = f"the planner did not answer within {PATH_ANSWER_S:g} s"
                self._answer_path(request, (), text)
        facts, self._facts = self._facts, []
        for fact in facts:
            self._observe(fact)

    def _server(self, key: str) -> _Server | str:
        """Return the server of an action, or why there is none."""
        server = self._servers.get(key)
        if server is None:
            return self._missing.get(key, f"navigation.{key} is not used")
        return server if server.action.ready else f"there is no action server {server.action.name}"

    def _frame(self, task: Task) -> str:
        return self._frames[task.frame] if isinstance(task, NavigateTo) else ""

    def _abandon(self) -> None:
        self._waiting = self._aborted = None
        if self._sent is not None:
            self._abandoned[self._sent.uuid] = self._sent.server.action
            self._sent = None
        while len(self._abandoned) > MAX_ABANDONED:
            del self._abandoned[next(iter(self._abandoned))]

    def _cancel_all(self) -> None:
        now_s = self._clock.now_s()
        for server in self._servers.values():
            due = now_s >= server.cancelled_s + CANCEL_RETRY_S
            if due and now_s < server.cancel_until_s and server.action.ready:
                server.cancelled_s = now_s

                def on_answer(server: _Server = server) -> None:
                    server.cancel_until_s = -inf

                server.action.cancel(None, on_answer)

    def _send(self, now_s: float) -> None:
        goal = self._waiting
        if goal is None or any(each.awaits_cancel(now_s) for each in self._servers.values()):
            return
        self._waiting = None
        for each in self._servers.values():
            each.cancel_until_s = -inf
        server = self._server(_key(goal.task))
        if isinstance(server, str):
            self._report(goal, NavigationState.UNAVAILABLE, text=server)
            return
        sent = self._sent = _SentGoal(goal, server)
        message = goal_message(server.action.kind, goal.task, self._frame(goal.task))
        sent.uuid = server.action.send(message, lambda accepted: self._on_answer(sent, accepted))

    def _on_answer(self, sent: _SentGoal, accepted: bool) -> None:
        if sent is self._sent:
            if accepted:
                self._on_accepted(sent)
            elif not sent.accepted:
                self._end(sent, NavigationState.REJECTED)
        elif not accepted:
            self._abandoned.pop(sent.uuid, None)
        elif sent.uuid in self._abandoned:
            sent.server.action.cancel(sent.uuid)

    def _on_accepted(self, sent: _SentGoal) -> None:
        if not sent.accepted:
            sent.accepted = True
            self._report(sent.goal, NavigationState.ACCEPTED)
            self._request_result(sent)

    def _request_result(self, sent: _SentGoal) -> None:
        def on_result(status: int, result: Any) -> None:
            if sent is not self._sent:
                return
            if status in _ENDS:
                self._end(sent, _ENDS[status], result)
            else:
                self._end(sent, NavigationState.LOST, text="the server does not know the goal")

        sent.server.action.request_result(sent.uuid, on_result)

    def _on_status(self, server: _Server, statuses: Statuses) -> None:
        for uuid, (status, _) in statuses.items():
            if uuid in self._abandoned:
                if status in ACTIVE:
                    server.action.cancel(uuid)
                elif status in ENDED:
                    del self._abandoned[uuid]
        sent = self._sent or self._aborted
        if sent is None or sent.server is not server or sent.uuid not in statuses:
            return
        status, since_ns = statuses[sent.uuid]
        if sent.servers is None:
            sent.servers = server.action.servers()
        if status in ENDED:
            sent.ended_s = min(sent.ended_s, self._clock.now_s())
        self._on_accepted(sent)  # its answer may be lost
        later = (
            status in ACTIVE and at_ns > since_ns and uuid not in self._abandoned
            for uuid, (status, at_ns) in statuses.items()
        )
        if any(later) and not sent.preempted:
            sent.preempted = True
            text = f"another client sent a goal to {server.action.name}"
            self._report(sent.goal, NavigationState.PREEMPTED, text=text)

    def _check_goal(self, now_s: float) -> None:
        """Request a result again that was lost; detect another server."""
        sent = self._sent
        if sent is None or not sent.accepted:
            return
        if now_s > sent.ended_s + RESULT_RETRY_S:
            sent.ended_s = now_s
            self._request_result(sent)
        if sent.servers and now_s >= self._checked_s + SERVER_CHECK_S:
            self._checked_s = now_s
            found = sent.server.action.servers()
            if not found or found - sent.servers:
                text = f"{sent.server.action.name} has ended, or is served by another process"
                self._end(sent, NavigationState.LOST, text=text)

    def _on_feedback(self, uuid: bytes, feedback: Any) -> None:
        sent = self._sent
        if sent is not None and uuid == sent.uuid and sent.accepted:
            self._facts.append(feedback_fact(sent.goal, feedback))

    def _end(
        self, sent: _SentGoal, state: NavigationState, result: Any = None, text: str = ""
    ) -> None:
        self._sent = None
        if state is NavigationState.LOST:
            self._abandoned[sent.uuid] = sent.server.action
        if state is NavigationState.ABORTED:
            self._aborted = sent  # the cause may be a goal of another client, which arrives later
        code = int(getattr(result, "error_code", 0))
        text = text or str(getattr(result, "error_msg", ""))
        self._report(sent.goal, state, code=code, text=text, missed=missed_poses(result))

    def _report(
        self,
        goal: NavigationGoal,
        state: NavigationState,
        *,
        code: int = 0,
        text: str = "",
        missed: tuple[int, ...] = (),
    ) -> None:
        fact = NavigationStatus(goal.number, state, code, error_name(code), text, missed)
        self._facts.append(fact)

    def _on_path(self, request: PathRequest, result: Any) -> None:
        code, path = int(result.error_code), result.path
        if code or not path.poses:
            text = getattr(result, "error_msg", "") or error_name(code) or f"error code {code}"
            self._answer_path(request, (), f"the planner has no path: {text}")
            return
        frame = path.header.frame_id.lstrip("/") or self._frames[request.frame]
        to_frame = self._into(request.frame, frame)
        if to_frame is None:
            text = f"no transform from {frame} to {self._frames[request.frame]}"
            self._answer_path(request, (), f"the planned path is in {frame}: {text}")
            return
        each = (pose.pose.position for pose in path.poses)
        moved = (to_frame.compose(Pose(at.x, at.y)) for at in each)
        points = [
            Point(*(round_measurement(each, Precision.RANGE) for each in (at.x_m, at.y_m)))
            for at in moved
        ]
        if not all(isfinite(at.x_m) and isfinite(at.y_m) for at in points):
            self._answer_path(request, (), "the planned path is not finite")
            return
        self._answer_path(request, thinned(points))

    def _into(self, frame: TargetFrame, source: str) -> Pose | None:
        """Return the pose of a frame of the path in the frame of a request, or None."""
        odom, map_to_odom = self._frames[TargetFrame.ODOM], self._map_to_odom
        if source == self._frames[frame]:
            return Pose()
        if source not in self._frames.values() or map_to_odom is None:
            return None
        return map_to_odom if source == odom else map_to_odom.inverse

    def _answer_path(self, request: PathRequest, points: tuple[Point, ...], text: str = "") -> None:
        waiting = self._paths.get(request.number)
        if waiting is not None and waiting[0] is request:
            del self._paths[request.number]
            self._facts.append(PlannedPath(request.number, points, text))


def _key(task: Task) -> str:
    match task:
        case NavigateTo(poses):
            return TO_POSE if len(poses) == 1 else THROUGH_POSES
        case TurnBy():
            return TURN
        case DriveBy():
            return DRIVE
