"""`GoalServers`: Nav2's actions under the node of the executive, one command for each goal.

A goal is EXECUTING once its command STARTED, and has SUCCEEDED only if that is EXECUTED. Its UUID
is the number of the command, so that the ledger knows it over restarts: a UUID that is sent to a
new process gets the recorded end, and moves nothing.
"""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from itertools import pairwise
from math import hypot
from typing import Any, Final

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from rclpy.action.server import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from adapters.ros.conversions import MessageError, quaternion
from adapters.ros.goal_requests import (
    ACTIONS,
    Frames,
    goal_request,
    number_of_uuid,
    time_allowance_s,
)
from executive.commands import (
    ROS_LINK,
    ROS_SOURCE,
    Command,
    FollowPath,
    MoveTo,
    PreemptionPolicy,
)
from executive.commands.lifecycle import Duplicate, Rejected, SubmitResult
from executive.core.ros_clients import CancelRequest
from executive.core.runner import Executive
from executive.values.geometry import STANDING, Pose, TargetFrame, wrap_rad
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, Report, Stage

ERROR_CODE: Final = 10_000
"""Added to the number of a reason, since Nav2 uses the numbers below."""
STATIONARY_S: Final = 2.0
"""Maximum time from a cancel to the end of the goal while the rover is not stationary."""
_LOG = logging.getLogger(__name__)


class GoalServer(ActionServer):
    """An action server that knows the UUID of the goal it decides on, and ends goals on request.

    Attributes:
        requested: UUID of the goal request, when its callback is called.
        cancels: called with the UUID of each cancel request, of zeros for all goals.
    """

    requested = b""
    cancels: Callable[[bytes], None] = staticmethod(lambda _: None)

    async def execute(self, taken_data: Mapping[str, Any]) -> None:
        """Note the UUIDs of the requests, then serve them."""
        if "goal" in taken_data:
            self.requested = bytes(taken_data["goal"][1].goal_id.uuid)
        if "cancel" in taken_data:
            self.cancels(bytes(taken_data["cancel"][1].goal_info.goal_id.uuid))
        await super().execute(taken_data)  # type: ignore[no-untyped-call]

    def notify_execute(self, goal_handle: Any, execute_callback: Callable[..., Any] | None) -> None:
        """Run a callback that ends the goal; without one, the goal is EXECUTING until then."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)  # type: ignore[no-untyped-call]


@dataclass(slots=True, eq=False)
class Goal:
    """A goal of an action, and its command.

    Attributes:
        action: name of the action.
        message: the goal.
        uuid: its UUID.
        allowance_s: maximum duration from its start; None for no limit.
        handle: None until it is accepted, or if its client is gone by then.
        answered: whether its request was answered.
        last: last report on the command.
        step: number of waypoints that were reached.
        started_s: when it started; None before.
        start: pose at that time.
        ended_s: when its command ended; None before.
        cancel_requested: whether its client cancels it.
    """

    action: str
    server: Any
    command: Command
    message: Any
    uuid: bytes
    allowance_s: float | None
    handle: Any = None
    answered: bool = False
    last: Report | None = None
    step: int = 0
    started_s: float | None = None
    start: Pose = field(default_factory=Pose)
    ended_s: float | None = None
    cancel_requested: bool = False


class GoalServers:
    """Serves the actions that the installed nav2_msgs has; none without that package.

    Args:
        node: serves them.
        executive: receives the commands.
        frames: frames of targets by their names.
        contained: returns a callback without exceptions.
        admit: whether another command may be submitted now.
        refuse: called with number and refusal of a goal that the core does not report.
    """

    def __init__(
        self,
        node: Node,
        executive: Executive,
        frames: Frames,
        contained: Callable[[Callable[..., None]], Callable[..., None]],
        admit: Callable[[], bool],
        refuse: Callable[[int, Refusal], None],
    ) -> None:
        self._node, self._executive, self._frames = node, executive, frames
        self._contained, self._admit, self._refuse = contained, admit, refuse
        self._odom = next(name for name, each in frames.items() if each is TargetFrame.ODOM)
        self._goals: dict[Identity, Goal] = {}
        group = ReentrantCallbackGroup()
        self._servers = [
            self._serve(name, kind, group) for name, kind in _installed_actions().items()
        ]

    def _serve(self, action: str, kind: Any, group: ReentrantCallbackGroup) -> Any:
        made: Any = GoalServer
        server = made(
            self._node,
            kind,
            f"{self._node.get_fully_qualified_name()}/{action}",
            lambda _: kind.Result(),
            callback_group=group,
            handle_accepted_callback=self._contained(self._on_accepted),
            cancel_callback=self._on_cancel,
        )
        server.register_goal_callback(partial(self._on_goal, action, server))
        server.cancels = self._contained(self._on_cancel_request)
        return server

    def close(self) -> None:
        """Destroy the servers."""
        for server in self._servers:
            server.destroy()

    def on_report(self, report: Report) -> None:
        """Continue the goal of a report's command."""
        goal = None if report.identity is None else self._goals.get(report.identity)
        if goal is not None and report.stage is not None:
            goal.last = report
            goal.step = report.step or goal.step
            self._continue(goal)

    def poll(self) -> None:
        """Send feedback, end cancelled goals of a stationary rover, apply time allowances."""
        for identity, goal in tuple(self._goals.items()):
            self._continue(goal)
            if goal.handle is None and goal.answered and goal.last and _is_over(goal.last):
                del self._goals[identity]
            if goal.started_s is None or goal.ended_s is not None or goal.handle is None:
                continue
            duration_s, allowance_s = time.monotonic() - goal.started_s, goal.allowance_s
            if allowance_s is not None and duration_s > allowance_s:
                goal.allowance_s = None
                self._cancel(goal, f"its time_allowance of {allowance_s:g} s is over")
            goal.handle.publish_feedback(self._feedback(goal, duration_s))

    async def _on_goal(self, action: str, server: GoalServer, message: Any) -> GoalResponse:
        """Submit the command of a goal, and decide on the goal by the answer."""
        uuid = server.requested
        number = number_of_uuid(uuid)
        identity = Identity(ROS_SOURCE, number)
        if identity in self._goals or not self._admit():  # the same request again, or a flood
            return GoalResponse.REJECT
        path = self._executive.settings.drive.path_waypoints
        try:
            request = goal_request(action, message, self._frames, path)
        except MessageError as error:
            self._refuse(number, Refusal(Reason.OUT_OF_RANGE, f"{action}: {error}"))
            return GoalResponse.REJECT
        command = Command(identity, request, ROS_LINK, preemption=PreemptionPolicy.REPLACE)
        goal = Goal(action, server, command, message, uuid, time_allowance_s(message))
        self._goals[identity] = goal
        answered = Future()  # type: ignore[no-untyped-call]
        self._executive.submit(command, answered.set_result)
        result: SubmitResult = await answered
        refusal = result.refusal if isinstance(result, Rejected) else None
        if isinstance(result, Duplicate):
            goal.last = goal.last or result.last_report
            if goal.last.stage is Stage.REJECTED:
                refusal = Refusal(Reason.DUPLICATE, f"refused before: {goal.last.text}")
        if goal.cancel_requested and refusal is None:
            refusal = Refusal(Reason.CANCELLED_BY_CLIENT, "cancelled before it was accepted")
            self._cancel(goal, refusal.text)
        goal.answered = True
        if refusal is None:
            return GoalResponse.ACCEPT
        del self._goals[identity]
        if refusal.reason in {Reason.DUPLICATE, Reason.LEDGER_FAILED}:
            self._refuse(number, refusal)
        return GoalResponse.REJECT

    def _on_accepted(self, handle: Any) -> None:
        goal = self._goals[Identity(ROS_SOURCE, number_of_uuid(bytes(handle.goal_id.uuid)))]
        goal.handle = handle
        self._continue(goal)

    def _on_cancel_request(self, uuid: bytes) -> None:
        """Cancel goals that wait for their answer: those of the request, or all."""
        for goal in self._goals.values():
            if goal.handle is None and (uuid == goal.uuid or not any(uuid)):
                goal.cancel_requested = True

    def _on_cancel(self, handle: Any) -> CancelResponse:
        identity = Identity(ROS_SOURCE, number_of_uuid(bytes(handle.goal_id.uuid)))
        goal = self._goals.get(identity)
        if goal is None:
            return CancelResponse.REJECT
        goal.cancel_requested = True
        self._cancel(goal, "cancelled by its client")
        return CancelResponse.ACCEPT

    def _cancel(self, goal: Goal, text: str) -> None:
        request = CancelRequest(goal.command.identity, text)
        self._executive.query(partial(self._executive.cancel, request))

    def _continue(self, goal: Goal) -> None:
        """Show the stage of the command as the status of the goal."""
        if goal.handle is None or goal.last is None or goal.last.stage is None:
            return
        stage, now_s = goal.last.stage, time.monotonic()
        if goal.started_s is None and stage not in {Stage.RECEIVED, Stage.ACCEPTED}:
            goal.started_s, goal.start = now_s, self._executive.status.pose
            goal.handle.execute()
        if not stage.terminal:
            return
        goal.ended_s = goal.ended_s or now_s
        stationary = self._executive.velocity == STANDING and self._executive.status.standing
        waits = goal.cancel_requested and stage is Stage.CANCELLED and not stationary
        if not waits or now_s - goal.ended_s > STATIONARY_S:
            del self._goals[goal.command.identity]
            goal.server.notify_execute(goal.handle, partial(self._conclude, goal, goal.last))

    def _conclude(self, goal: Goal, report: Report, handle: Any) -> Any:
        """End a goal as its command ended, and return the result."""
        if report.stage is Stage.EXECUTED:
            handle.succeed()
        elif handle.is_cancel_requested and report.reason is Reason.CANCELLED_BY_CLIENT:
            handle.canceled()
        else:
            handle.abort()
        result = goal.server.action_type.Result()
        text, code = report.text, 0
        if report.stage is not Stage.EXECUTED:
            reason = report.reason
            code = ERROR_CODE + (0 if reason is None else reason.value)
            text = f"{report.stage.name if report.stage else ''} {reason.name if reason else ''}:"
            text = f"{text} {report.text}"
        _set(result, error_code=code, error_msg=text)
        if goal.started_s is not None:
            _set(result, total_elapsed_time=_duration(time.monotonic() - goal.started_s))
        if code and hasattr(result, "missed_waypoints"):
            result.missed_waypoints = _missed(goal, code)
        return result

    def _feedback(self, goal: Goal, duration_s: float) -> Any:
        status = self._executive.status
        pose, feedback = status.pose, goal.server.action_type.Feedback()
        stamped = PoseStamped()
        stamped.header.frame_id = self._odom
        stamped.header.stamp = self._node.get_clock().now().to_msg()
        position = stamped.pose.position
        position.x, position.y, position.z = pose.x_m, pose.y_m, pose.z_m
        stamped.pose.orientation = quaternion(pose)
        waypoints = self._waypoints(goal.command.request)
        left = waypoints[goal.step :]
        _set(
            feedback,
            current_pose=stamped,
            navigation_time=_duration(duration_s),
            distance_remaining=_length_m(pose, left),
            number_of_poses_remaining=len(left),
            current_waypoint=min(goal.step, max(len(waypoints) - 1, 0)),
            angular_distance_traveled=abs(wrap_rad(pose.heading_rad - goal.start.heading_rad)),
            distance_traveled=pose.point.distance_m(goal.start.point),
        )
        return feedback

    def _waypoints(self, request: Any) -> tuple[Any, ...]:
        """Return the waypoints of a motion in the frame of the pose; none if that is unknown."""
        if not isinstance(request, MoveTo | FollowPath):
            return ()
        if request.frame is TargetFrame.MAP:
            origin = self._executive.status.map_origin
            if isinstance(origin, Refusal):
                return ()
            request = request.moved(origin)
        return (request.target,) if isinstance(request, MoveTo) else request.waypoints


def _installed_actions() -> dict[str, Any]:
    """Return the types of the actions by name; none if nav2_msgs is not installed."""
    try:
        types = import_module("nav2_msgs.action")
    except ImportError as error:
        _LOG.info("no actions for ROS clients: %s (Nav2 installs ros-jazzy-nav2-msgs)", error)
        return {}
    return {name: getattr(types, kind) for name, kind in ACTIONS.items() if hasattr(types, kind)}


def _is_over(report: Report) -> bool:
    return report.stage is not None and report.stage.terminal


def _set(message: Any, **fields: Any) -> None:
    """Set the fields that this distribution's message has."""
    for name, value in fields.items():
        if hasattr(message, name):
            setattr(message, name, value)


def _duration(seconds: float) -> Duration:
    return Duration(sec=int(seconds), nanosec=int(seconds % 1.0 * 1e9))


def _length_m(start: Pose, waypoints: tuple[Any, ...]) -> float:
    points = [start.point, *(each.point for each in waypoints)]
    return sum(hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in pairwise(points))


def _missed(goal: Goal, code: int) -> list[Any]:
    """Return the waypoints of FollowWaypoints that were not reached."""
    kind = import_module("nav2_msgs.msg").MissedWaypoint
    poses, first = goal.message.poses, goal.message.goal_index
    indices = range(first + goal.step, len(poses) * (goal.message.number_of_loops + 1))
    return [
        kind(index=each % len(poses), goal=poses[each % len(poses)], error_code=code)
        for each in indices
    ]
