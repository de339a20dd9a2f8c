"""A process that serves a navigation of tests on ROS 2 by the action names of Nav2.

    python -m tests.support.navigation_server --namespace /jackal --behaviour aborts_and_drives_on

It serves `navigate_to_pose`, `navigate_through_poses`, `follow_waypoints`, `spin` (by less than
half a turn), `backup`, `drive_on_heading`, and `compute_path_to_pose`: a straight path. It
publishes Twist (TwistStamped with `--stamped`) on `nav_vel`, and subscribes `odom` or the topic of
`--odometry`; all poses are in its frame. If a goal of another client preempts one, a second client
here has sent it. It needs nav2_msgs. SIGINT or SIGTERM ends it.
"""

import argparse
import signal
import time
from math import atan2, cos, sin
from typing import Any, Final
from uuid import uuid4

from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.action.client import ActionClient
from rclpy.action.server import ActionServer, CancelResponse, GoalResponse
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from adapters.ros import ros_node, single_threaded
from executive.values.geometry import Pose, wrap_rad
from tests.support.navigation import (
    FINE_TOLERANCE,
    GoalEnd,
    GoalFeedback,
    GoalResult,
    Navigation,
    ServerRestarted,
    beside,
)

STEP_S = 0.05
PATH_POINTS = 11
ANOTHER: Final = "another"
"""Key of the goal of another client in `Navigation`."""


class NavigationServer:
    """A navigation on a node. A restart of it destroys its action servers, and makes new ones.

    Attributes:
        located: whether it has received odometry.
    """

    def __init__(
        self,
        node: Node,
        executor: Executor,
        navigation: Navigation,
        stamped: bool = False,
        odometry: str = "odom",
    ) -> None:
        self._node, self._executor, self._navigation = node, executor, navigation
        self._stamped = stamped
        self._pose = Pose()
        self.located = False
        self._goals: dict[object, tuple[Any, Any, Future]] = {}
        self._starts: dict[object, tuple[Pose, float]] = {}
        self._servers: list[Any] = []
        self._others: set[bytes] = set()
        kind = TwistStamped if stamped else Twist
        self._velocity = node.create_publisher(kind, "nav_vel", 1)
        qos = QoSProfile(  # type: ignore[no-untyped-call]
            depth=5, reliability=ReliabilityPolicy.BEST_EFFORT
        )
        node.create_subscription(Odometry, odometry, self._on_odometry, qos)
        self._serve()
        from nav2_msgs.action import NavigateToPose

        self._another: Any = ActionClient(  # type: ignore[no-untyped-call]
            node, NavigateToPose, "navigate_to_pose"
        )
        node.create_timer(STEP_S, self._step)

    def _on_odometry(self, message: Any) -> None:
        self._pose, self.located = _pose_of(message.pose.pose), True

    def _serve(self) -> None:
        from nav2_msgs import action

        self._offer(action.NavigateToPose, "navigate_to_pose")
        self._offer(action.NavigateThroughPoses, "navigate_through_poses")
        self._offer(action.FollowWaypoints, "follow_waypoints")
        self._offer(action.Spin, "spin")
        self._offer(action.BackUp, "backup")
        self._offer(action.DriveOnHeading, "drive_on_heading")
        self._serve_action(action.ComputePathToPose, "compute_path_to_pose", self._plan)

    def _serve_action(self, kind: Any, name: str, execute: Any, **callbacks: Any) -> None:
        self._servers.append(
            ActionServer(self._node, kind, name, execute, **callbacks)  # type: ignore[no-untyped-call]
        )

    def _offer(self, kind: Any, name: str) -> None:
        navigation = self._navigation

        async def on_request(_: Any) -> GoalResponse:
            if navigation.behaviour == "never_answers":
                await Future(executor=self._executor)  # type: ignore[no-untyped-call]
            rejects = navigation.behaviour == "rejects" or not navigation.active
            return GoalResponse.REJECT if rejects else GoalResponse.ACCEPT

        def on_accepted(handle: Any) -> None:
            key = bytes(handle.goal_id.uuid)
            ended = Future(executor=self._executor)  # type: ignore[no-untyped-call]
            if key in self._others:
                self._goals[key] = self._goals[ANOTHER] = handle, kind.Feedback, ended
                handle.execute()
                return
            poses = self._poses_of(handle.request, backward=name == "backup")
            navigation.submit(key, poses, time.monotonic())
            goal = navigation.goal
            if goal is not None and goal.key == key and not _has_poses(handle.request):
                goal.tolerance = FINE_TOLERANCE
                goal.reverse = hasattr(handle.request, "target") and (
                    name == "backup" or handle.request.target.x < 0.0
                )
            self._goals[key] = handle, kind.Feedback, ended
            handle.execute()

        async def execute(handle: Any) -> Any:
            ended: GoalResult = await self._goals[bytes(handle.goal_id.uuid)][-1]
            result = kind.Result(error_code=ended.code)
            if hasattr(result, "error_msg"):  # not in Jazzy
                result.error_msg = ended.text
            if ended.end is GoalEnd.SUCCEEDED:
                handle.succeed()
            elif ended.end is GoalEnd.CANCELLED and handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return result

        def on_cancel(handle: Any) -> CancelResponse:
            key = bytes(handle.goal_id.uuid)
            cancelling = navigation.cancel(ANOTHER if key in self._others else key)
            return CancelResponse.ACCEPT if cancelling else CancelResponse.REJECT

        self._serve_action(
            kind,
            name,
            execute,
            goal_callback=on_request,
            handle_accepted_callback=on_accepted,
            cancel_callback=on_cancel,
        )

    def _poses_of(self, request: Any, *, backward: bool) -> list[Pose]:
        now = self._pose
        if hasattr(request, "target_yaw"):
            heading_rad = wrap_rad(now.heading_rad + request.target_yaw)
            return [Pose(now.x_m, now.y_m, heading_rad=heading_rad)]
        if hasattr(request, "target"):
            ahead_m = -abs(request.target.x) if backward else request.target.x
            return [beside(now, ahead_m * cos(now.heading_rad), ahead_m * sin(now.heading_rad))]
        if hasattr(request, "pose"):
            return [_pose_of(request.pose.pose)]
        # From Kilted on the poses of NavigateThroughPoses are a nav_msgs/Goals.
        stamped = getattr(request.poses, "goals", request.poses)
        return [_pose_of(each.pose) for each in stamped][getattr(request, "goal_index", 0) :]

    async def _plan(self, handle: Any) -> Any:
        from nav2_msgs.action import ComputePathToPose

        request, result = handle.request, ComputePathToPose.Result()
        result.path.header.frame_id = request.goal.header.frame_id
        start = _pose_of(request.start.pose) if request.use_start else self._pose
        end = _pose_of(request.goal.pose)
        for index in range(PATH_POINTS):
            part = index / (PATH_POINTS - 1)
            each = PoseStamped(header=result.path.header)
            each.pose.position.x = start.x_m + (end.x_m - start.x_m) * part
            each.pose.position.y = start.y_m + (end.y_m - start.y_m) * part
            each.pose.orientation.w = 1.0
            result.path.poses.append(each)
        handle.succeed()
        return result

    def _step(self) -> None:
        velocity = self._navigation.step(time.monotonic(), self._pose)
        events, self._navigation.events = self._navigation.events, []
        for event in events:
            match event:
                case GoalFeedback(key) if key in self._goals:
                    self._feed(event)
                case GoalResult(key) if key in self._goals:
                    self._goals[key][-1].set_result(event)  # type: ignore[no-untyped-call]
                case ServerRestarted():
                    self._restart()
                case _:  # of a goal before the restart, or of another client
                    pass
        goal = self._navigation.goal
        if goal is not None and goal.key == ANOTHER and not self._others:
            self._send_another(goal.poses[-1])
        if velocity is not None:
            self._publish(velocity.travel_mps, velocity.rotate_radps)

    def _send_another(self, pose: Pose) -> None:
        """Send the goal of another client, that the navigation drives to already."""
        uuid = uuid4().bytes
        self._others.add(uuid)
        kind = self._another._action_type
        goal = kind.Goal()
        goal.pose.pose.position.x, goal.pose.pose.position.y = pose.x_m, pose.y_m
        self._another.send_goal_async(goal, goal_uuid=UUID(uuid=list(uuid)))

    def _restart(self) -> None:
        for each in self._servers:
            each.destroy()
        self._servers.clear()
        self._goals.clear()
        self._starts.clear()
        self._serve()

    def _publish(self, travel_mps: float, rotate_radps: float) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z = travel_mps, rotate_radps
        if self._stamped:
            stamped = TwistStamped(twist=twist)
            stamped.header.stamp = self._node.get_clock().now().to_msg()
            stamped.header.frame_id = "base_link"
            self._velocity.publish(stamped)
        else:
            self._velocity.publish(twist)

    def _feed(self, event: GoalFeedback) -> None:
        handle, make_feedback, _ = self._goals[event.key]
        message = make_feedback()
        pose = self._pose
        start, first_m = self._starts.setdefault(event.key, (pose, event.remaining_m))
        if hasattr(message, "distance_remaining"):
            message.current_pose.header.frame_id = "odom"
            message.current_pose.pose.position.x = pose.x_m
            message.current_pose.pose.position.y = pose.y_m
            message.current_pose.pose.orientation.z = sin(pose.heading_rad / 2)
            message.current_pose.pose.orientation.w = cos(pose.heading_rad / 2)
            message.distance_remaining = float(event.remaining_m)
            message.number_of_recoveries = event.recoveries
            remaining_s = int(event.remaining_m / self._navigation.speed_mps)
            message.estimated_time_remaining.sec = remaining_s
        goal = self._navigation.goal
        _fill(
            message,
            number_of_poses_remaining=event.poses_remaining,
            current_waypoint=0 if goal is None else goal.index,
            distance_traveled=float(max(0.0, first_m - event.remaining_m)),
            angular_distance_traveled=float(wrap_rad(pose.heading_rad - start.heading_rad)),
        )
        handle.publish_feedback(message)


def _fill(message: Any, **fields: float) -> None:
    """Set those fields that the type of the message has."""
    for name, value in fields.items():
        if hasattr(message, name):
            setattr(message, name, value)


def _has_poses(request: Any) -> bool:
    return hasattr(request, "pose") or hasattr(request, "poses")


def _pose_of(pose: Any) -> Pose:
    q, p = pose.orientation, pose.position
    heading_rad = atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
    return Pose(p.x, p.y, heading_rad=heading_rad)


def serve(
    navigation: Navigation, namespace: str, stamped: bool = False, odometry: str = "odom"
) -> None:
    """Serve a navigation until SIGINT or SIGTERM."""
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: ended.append(received))
    with ros_node("stand_in_navigation", namespace) as node, single_threaded(node) as executor:
        server = NavigationServer(node, executor, navigation, stamped, odometry)
        while not (ended or server.located):
            executor.spin_once(timeout_sec=STEP_S)
        print("navigation serves:", navigation.behaviour, flush=True)
        while not ended:
            executor.spin_once(timeout_sec=STEP_S)


def main() -> None:
    """Serve the behaviour that the command line names."""
    names = Navigation.behaviours()
    parser = argparse.ArgumentParser(
        description="Navigation servers of tests.",
        epilog="\n".join(f"  {name}: {Navigation.description(name)}" for name in names),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--namespace", default="/jackal")
    parser.add_argument("--behaviour", default="honest", choices=names)
    parser.add_argument("--speed", type=float, default=0.6, help="m/s")
    parser.add_argument("--seed", type=int, default=0, help="of its random numbers")
    parser.add_argument("--stamped", action="store_true", help="publish TwistStamped")
    parser.add_argument("--odometry", default="odom", help="topic")
    options = parser.parse_args()
    navigation = Navigation(options.behaviour, options.seed, options.speed)
    serve(navigation, options.namespace, options.stamped, options.odometry)


if __name__ == "__main__":
    main()
