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
from typing import Any, Final

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from rclpy.action.server import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from adapters.ros.conversions import MessageError, quaternion
from adapters.ros.goal_requests import ACTIONS, Frames, goal_request, number_of_uuid
from executive.commands import (
    ROS_LINK,
    ROS_SOURCE,
    Command,
    FollowPath,
    Motion,
    MoveTo,
    PreemptionPolicy,
    Waypoint,
)
from executive.commands.intake import localized
from executive.commands.lifecycle import Duplicate, Rejected, SubmitResult
from executive.core.ros_clients import CancelRequest
from executive.core.runner import Executive
from executive.values.geometry import STANDING, Pose, TargetFrame, wrap_rad
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, Stage

ERROR_CODE: Final = 10_000
"""Added to the number of a reason, since Nav2 uses the numbers below."""
STATIONARY_S: Final = 2.0
"""Maximum time from a cancel to the end of the goal while the rover is not stationary."""
_LOG = logging.getLogger(__name__)


class GoalServer(ActionServer):
    """An action server that knows the UUID of each request, and lets a goal end later."""

    requested = b""

    async def execute(self, taken_data: Mapping[str, Any]) -> None:
        """Store the UUID of a goal request, then serve it."""
        if "goal" in taken_data:
            self.requested = bytes(taken_data["goal"][1].goal_id.uuid)
        await super().execute(taken_data)  # type: ignore[no-untyped-call]

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Run a callback that ends the goal; without one, the goal is EXECUTING until then."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)  # type: ignore[no-untyped-call]


@dataclass(slots=True, eq=False)
class Goal:
    """A goal of an action, and its command; `handle` is None until it is accepted."""

    server: Any
    identity: Identity
    motion: Motion
    message: Any
    handle: Any = None
    last: Report | None = None
    steps: int = 0
    started_s: float | None = None
    start: Pose = field(default_factory=Pose)
    ended_s: float | None = None
    cancel_requested: bool = False

    @property
    def allowance_s(self) -> float:
        """Maximum duration from the start; 0 for no limit."""
        allowance = getattr(self.message, "time_allowance", None) or Duration()
        return float(allowance.sec + allowance.nanosec * 1e-9)


class GoalServers:
    """Serves the actions that the installed nav2_msgs has; none without that package.

    Args:
        node: serves them.
        executive: receives the commands.
        frames: frames of targets by their names.
        contained: returns a callback without exceptions.
        admit: whether another command may be submitted now.
        refuse: called with a refusal that the core does not report.
    """

    def __init__(
        self,
        node: Node,
        executive: Executive,
        frames: Frames,
        contained: Callable[[Callable[..., None]], Callable[..., None]],
        admit: Callable[[], bool],
        refuse: Callable[[int, Reason, str], None],
    ) -> None:
        self._node, self._executive, self._frames = node, executive, frames
        self._admit, self._refuse = admit, refuse
        self._odom = next(name for name, each in frames.items() if each is TargetFrame.ODOM)
        self._goals: dict[Identity, Goal] = {}
        self._servers: list[Any] = []
        group, make = ReentrantCallbackGroup(), GoalServer  # a request waits for the ledger
        for action, kind in _installed_actions().items():
            server: Any = make(  # type: ignore[no-untyped-call]
                node,
                kind,
                f"{node.get_fully_qualified_name()}/{action}",
                kind.Result,
                callback_group=group,
                handle_accepted_callback=contained(self._on_accepted),
                cancel_callback=self._on_cancel,
            )
            server.register_goal_callback(partial(self._on_goal, action, server))
            self._servers.append(server)

    def close(self) -> None:
        """Destroy the servers."""
        for server in self._servers:
            server.destroy()

    def on_report(self, report: Report) -> None:
        """Continue the goal of a report's command."""
        goal = None if report.identity is None else self._goals.get(report.identity)
        if goal is not None and report.stage is not None:
            goal.last, goal.steps = report, report.step or goal.steps
            self._continue(goal)

    def poll(self) -> None:
        """Send feedback, end cancelled goals of a stationary rover, apply time allowances."""
        for goal in tuple(self._goals.values()):
            self._continue(goal)
            if goal.started_s is None or goal.ended_s is not None:
                continue
            duration_s = time.monotonic() - goal.started_s
            if 0.0 < goal.allowance_s < duration_s and not goal.cancel_requested:
                self._cancel(goal, f"its time_allowance of {goal.allowance_s:g} s is over")
            goal.handle.publish_feedback(self._feedback(goal, duration_s))

    async def _on_goal(self, action: str, server: Any, message: Any) -> GoalResponse:
        """Submit the command of a goal, and decide on the goal by the answer."""
        number = number_of_uuid(server.requested)
        identity = Identity(ROS_SOURCE, number)
        if identity in self._goals or not self._admit():  # the same request again, or a flood
            return GoalResponse.REJECT
        try:
            request = goal_request(action, message, self._frames)
        except MessageError as error:
            self._refuse(number, Reason.OUT_OF_RANGE, f"{action}: {error}")
            return GoalResponse.REJECT
        command = Command(identity, request, ROS_LINK, preemption=PreemptionPolicy.REPLACE)
        self._goals[identity] = goal = Goal(server, identity, request, message)
        answered = Future()  # type: ignore[no-untyped-call]
        self._executive.submit(command, answered.set_result)
        result: SubmitResult = await answered
        if isinstance(result, Duplicate):
            goal.last = goal.last or result.last_report
        if isinstance(result, Rejected) or (goal.last and goal.last.stage is Stage.REJECTED):
            del self._goals[identity]
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _goal_of(self, handle: Any) -> Goal | None:
        number = number_of_uuid(bytes(handle.goal_id.uuid))
        return self._goals.get(Identity(ROS_SOURCE, number))

    def _on_accepted(self, handle: Any) -> None:
        if (goal := self._goal_of(handle)) is not None:
            goal.handle = handle
            self._continue(goal)

    def _on_cancel(self, handle: Any) -> CancelResponse:
        goal = self._goal_of(handle)
        if goal is None:
            return CancelResponse.REJECT
        goal.cancel_requested = True
        self._cancel(goal, "cancelled by its client")
        return CancelResponse.ACCEPT

    def _cancel(self, goal: Goal, text: str) -> None:
        request = CancelRequest(goal.identity, text)
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
            del self._goals[goal.identity]
            goal.server.notify_execute(goal.handle, partial(self._end, goal, goal.last))

    def _end(self, goal: Goal, report: Report, handle: Any) -> Any:
        """End a goal as its command ended, and return the result."""
        result, text, code = goal.server.action_type.Result(), report.text, 0
        if report.stage is Stage.EXECUTED:
            handle.succeed()
        else:
            assert report.stage is not None
            assert report.reason is not None
            code = ERROR_CODE + report.reason.value
            text = f"{report.stage.name} {report.reason.name}: {text}"
            by_client = report.reason is Reason.CANCELLED_BY_CLIENT
            end = handle.canceled if handle.is_cancel_requested and by_client else handle.abort
            end()
        duration = _duration(time.monotonic() - (goal.started_s or 0.0))
        _set(result, error_code=code, error_msg=text, total_elapsed_time=duration)
        if code and hasattr(result, "missed_waypoints"):
            missed = import_module("nav2_msgs.msg").MissedWaypoint
            first = goal.message.goal_index + goal.steps
            result.missed_waypoints = [
                missed(index=index, goal=pose, error_code=code)
                for index, pose in enumerate(goal.message.poses)
                if index >= first
            ]
        return result

    def _feedback(self, goal: Goal, duration_s: float) -> Any:
        pose, stamped = self._executive.status.pose, PoseStamped()
        stamped.header.frame_id = self._odom
        stamped.header.stamp = self._node.get_clock().now().to_msg()
        position = stamped.pose.position
        position.x, position.y, position.z = pose.x_m, pose.y_m, pose.z_m
        stamped.pose.orientation = quaternion(pose)
        left = self._waypoints(goal)[goal.steps :]
        points = [pose.point, *(each.point for each in left)]
        feedback = goal.server.action_type.Feedback()
        _set(
            feedback,
            current_pose=stamped,
            navigation_time=_duration(duration_s),
            distance_remaining=sum(a.distance_m(b) for a, b in pairwise(points)),
            number_of_poses_remaining=len(left),
            current_waypoint=goal.steps,
            angular_distance_traveled=abs(wrap_rad(pose.heading_rad - goal.start.heading_rad)),
            distance_traveled=pose.point.distance_m(goal.start.point),
        )
        return feedback

    def _waypoints(self, goal: Goal) -> tuple[Waypoint, ...]:
        """Return the waypoints of a motion in the frame of the pose; none if that is unknown."""
        found = localized(goal.motion, self._executive.status, self._executive.settings)
        if isinstance(found, MoveTo):
            return (found.target,)
        return found.waypoints if isinstance(found, FollowPath) else ()


def _installed_actions() -> dict[str, Any]:
    """Return the types of the actions by name; none if nav2_msgs is not installed."""
    try:
        types = import_module("nav2_msgs.action")
    except ImportError as error:
        _LOG.info("no actions for ROS clients: %s (Nav2 installs ros-jazzy-nav2-msgs)", error)
        return {}
    return {name: getattr(types, kind) for name, kind in ACTIONS.items() if hasattr(types, kind)}


def _set(message: Any, **fields: Any) -> None:
    """Set the fields that this distribution's message has."""
    for name, value in fields.items():
        if hasattr(message, name):
            setattr(message, name, value)


def _duration(seconds: float) -> Duration:
    return Duration(sec=int(seconds), nanosec=int(seconds % 1.0 * 1e9))
