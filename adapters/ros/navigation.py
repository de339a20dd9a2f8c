"""`NavigationClient`: a navigation's action servers, by the interfaces of Nav2 or similar ones.

Interfaces differ between the distributions of ROS: packages are imported when a node starts, and
fields are used if the imported type has them. All facts are observed by `poll`, once a tick.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any, Final, assert_never

from action_msgs.msg import GoalStatus
from rclpy.node import Node

from adapters.ros.navigation_messages import (
    Task,
    action_type,
    error_name,
    feedback_fact,
    goal_message,
    missed_poses,
    planned_points,
    stamped_pose,
)
from adapters.ros.parameters import declare_optional_text
from adapters.ros.polled_action import ACTIVE, PolledAction
from adapters.ros.transforms import frame_names
from executive.settings import RelativeActions
from executive.values.clock import Clock
from executive.values.facts import Fact, NavigationState, NavigationStatus, PlannedPath
from executive.values.geometry import Point, Pose, TargetFrame
from executive.values.ports import DriveBy, NavigateTo, NavigationGoal, PathRequest, TurnBy

TO_POSE, THROUGH_POSES, PATH = "to_pose", "through_poses", "compute_path"
TURN, DRIVE = "turn", "drive"
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
RESULT_RETRY_S: Final = 1.0
PATH_ANSWER_S: Final = 2.0
MAX_ABANDONED: Final = 200
_ENDS: Final = {
    GoalStatus.STATUS_SUCCEEDED: NavigationState.SUCCEEDED,
    GoalStatus.STATUS_CANCELED: NavigationState.CANCELLED,
    GoalStatus.STATUS_ABORTED: NavigationState.ABORTED,
}
_LOG = logging.getLogger(__name__)


@dataclass(slots=True)
class _SentGoal:
    """A goal that was sent.

    Attributes:
        result_due_s: when its result is requested again, which may be lost.
    """

    goal: NavigationGoal
    action: PolledAction
    uuid: bytes = b""
    accepted: bool = False
    preempted: bool = False
    result_due_s: float = inf


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
        self._waiting: NavigationGoal | None = None
        self._sent: _SentGoal | None = None
        self._aborted: _SentGoal | None = None
        self._abandoned: dict[bytes, None] = {}
        self._paths: dict[int, tuple[PathRequest, float]] = {}
        self._map_to_odom: Pose | None = None
        names = ACTIONS | RELATIVE[relative]
        made = {key: self._make_action(node, key, *default) for key, default in names.items()}
        self._missing = {key: each for key, each in made.items() if isinstance(each, str)}
        self._actions = {key: each for key, each in made.items() if not isinstance(each, str)}
        for text in dict.fromkeys(self._missing.values()):
            _LOG.warning("no navigation: %s", text)

    def _make_action(self, node: Node, key: str, name: str, kind_name: str) -> PolledAction | str:
        """Return an action, or why there is none."""
        given = declare_optional_text(node, f"navigation.{key}.action", f"action {key}")
        type_key = f"navigation.{key}.type"
        kind = action_type(type_key, declare_optional_text(node, type_key, "its type") or kind_name)
        if isinstance(kind, str):
            return kind
        return PolledAction(node, kind, given or name, self._on_status, self._on_feedback)

    def navigate(self, goal: NavigationGoal) -> None:
        """Send a goal under a new UUID after the answer to a cancel; abandon the last goal."""
        self._abandon()
        self._waiting = goal

    def cancel(self) -> None:
        """Cancel all goals of all servers, and any that was sent and is accepted later."""
        self._abandon()
        for key, action in self._actions.items():
            if key != PATH:
                action.cancel_all(self._clock.now_s())

    def plan(self, request: PathRequest) -> None:
        """Request a path; exactly one `PlannedPath` answers."""
        self._paths[request.number] = request, self._clock.now_s() + PATH_ANSWER_S
        action = self._action(PATH)
        if isinstance(action, str):
            self._answer_path(request, action)
            return
        frame = self._frames[request.frame]
        start, goal = (stamped_pose(each, frame) for each in (request.start, request.goal))

        def on_answer(accepted: bool) -> None:
            if accepted:
                action.request_result(uuid, lambda _, result: self._on_path(request, result))
            else:
                self._answer_path(request, "the planner rejected the request")

        uuid = action.send(action.kind.Goal(start=start, goal=goal, use_start=True), on_answer)

    def poll(self, map_to_odom: Pose | None) -> None:
        """Process answers and statuses, then observe the facts.

        Args:
            map_to_odom: pose of the odometry frame in the map, or None.
        """
        self._map_to_odom, now_s = map_to_odom, self._clock.now_s()
        for action in self._actions.values():
            action.poll(now_s)
        if not any(each.is_cancelling(now_s) for each in self._actions.values()):
            self._send()
        if self._sent is not None and now_s >= self._sent.result_due_s:
            self._sent.result_due_s = now_s + RESULT_RETRY_S
            self._request_result(self._sent)
        for request, until_s in list(self._paths.values()):
            if now_s > until_s:
                self._answer_path(request, f"the planner is silent for {PATH_ANSWER_S:g} s")
        facts, self._facts = self._facts, []
        for fact in facts:
            self._observe(fact)

    def _action(self, key: str) -> PolledAction | str:
        """Return an action with a server, or why there is none."""
        action = self._actions.get(key)
        if action is None:
            return self._missing.get(key, f"navigation.relative does not offer the action {key}")
        return action if action.ready else f"there is no action server {action.name}"

    def _abandon(self) -> None:
        self._waiting = self._aborted = None
        if self._sent is not None:
            self._abandoned[self._sent.uuid] = None
            self._sent = None
        if len(self._abandoned) > MAX_ABANDONED:
            del self._abandoned[next(iter(self._abandoned))]

    def _send(self) -> None:
        goal, self._waiting = self._waiting, None
        if goal is None:
            return
        for each in self._actions.values():
            each.end_cancel()
        action = self._action(_key(goal.task))
        if isinstance(action, str):
            self._report(goal, NavigationState.UNAVAILABLE, text=action)
            return
        sent = self._sent = _SentGoal(goal, action)
        frame = self._frames[goal.task.frame] if isinstance(goal.task, NavigateTo) else ""
        message = goal_message(action.kind, goal.task, frame)
        sent.uuid = action.send(message, lambda accepted: self._on_answer(sent, accepted))

    def _on_answer(self, sent: _SentGoal, accepted: bool) -> None:
        if accepted and sent.uuid in self._abandoned:
            sent.action.cancel(sent.uuid)
        elif sent is self._sent and accepted:
            self._on_accepted(sent)
        elif sent is self._sent and not sent.accepted:
            self._end(sent, NavigationState.REJECTED)

    def _on_accepted(self, sent: _SentGoal) -> None:
        if not sent.accepted:
            sent.accepted = True
            self._report(sent.goal, NavigationState.ACCEPTED)
            self._request_result(sent)

    def _request_result(self, sent: _SentGoal) -> None:
        def on_result(status: int, result: Any) -> None:
            if sent is self._sent:
                known = status in _ENDS
                text = "" if known else "the server does not know the goal"
                self._end(sent, _ENDS.get(status, NavigationState.LOST), result, text)

        sent.action.request_result(sent.uuid, on_result)

    def _on_status(self, action: PolledAction, statuses: dict[bytes, tuple[int, int]]) -> None:
        active = {uuid: at_ns for uuid, (status, at_ns) in statuses.items() if status in ACTIVE}
        for uuid in active.keys() & self._abandoned.keys():
            action.cancel(uuid)
        sent = self._sent or self._aborted
        if sent is None or sent.action is not action or sent.uuid not in statuses:
            return
        self._on_accepted(sent)  # its answer may be lost
        status, since_ns = statuses[sent.uuid]
        if status in _ENDS:
            sent.result_due_s = min(sent.result_due_s, self._clock.now_s() + RESULT_RETRY_S)
        others = active.keys() - self._abandoned.keys()
        if not sent.preempted and any(active[uuid] > since_ns for uuid in others):
            sent.preempted = True
            text = f"another client sent a goal to {action.name}"
            self._report(sent.goal, NavigationState.PREEMPTED, text=text)

    def _on_feedback(self, uuid: bytes, feedback: Any) -> None:
        sent = self._sent
        if sent is not None and uuid == sent.uuid and sent.accepted:
            self._facts.append(feedback_fact(sent.goal, feedback))

    def _end(
        self, sent: _SentGoal, state: NavigationState, result: Any = None, text: str = ""
    ) -> None:
        self._abandon()
        if state is NavigationState.ABORTED:
            self._aborted = sent  # the cause may be a goal of another client, which arrives later
        self._report(sent.goal, state, result, text)

    def _report(
        self, goal: NavigationGoal, state: NavigationState, result: Any = None, text: str = ""
    ) -> None:
        code = int(getattr(result, "error_code", 0))
        text = text or str(getattr(result, "error_msg", ""))
        name, missed = error_name(code), missed_poses(result)
        self._facts.append(NavigationStatus(goal.number, state, code, name, text, missed))

    def _on_path(self, request: PathRequest, result: Any) -> None:
        code, path = int(result.error_code), result.path
        frame, wanted = path.header.frame_id.lstrip("/"), self._frames[request.frame]
        to_frame = self._map_to_odom
        if frame in ("", wanted):
            to_frame = Pose()
        elif to_frame is not None and request.frame is TargetFrame.ODOM:
            to_frame = to_frame.inverse
        if code or not path.poses:
            text = getattr(result, "error_msg", "") or error_name(code)
            self._answer_path(request, f"the planner has no path: {text or code}")
        elif to_frame is None or frame not in ("", *self._frames.values()):
            self._answer_path(request, f"no transform from {frame} of the path to {wanted}")
        else:
            points = planned_points(path, to_frame)
            self._answer_path(request, "" if points else "the path is not finite", points)

    def _answer_path(self, request: PathRequest, text: str, points: tuple[Point, ...] = ()) -> None:
        if self._paths.get(request.number, (None,))[0] is request:
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
        case _:
            assert_never(task)
