"""Goals of a navigation on ROS: answers of its servers, and missing ones."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from math import inf, nan
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Path
from rclpy.action.server import ActionServer
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.node import Node

from adapters.ros import ParameterError, ros_node, single_threaded
from adapters.ros.goal_servers import _installed_actions
from adapters.ros.navigated_rover import NavigationVelocityTopic
from adapters.ros.navigation import NavigationClient
from adapters.ros.navigation_messages import (
    action_type,
    error_name,
    feedback_fact,
    goal_message,
    planned_points,
)
from adapters.ros.polled_action import PolledAction
from executive.settings import RelativeActions
from executive.values.clock import SystemClock
from executive.values.facts import (
    Fact,
    NavigationFeedback,
    NavigationState,
    NavigationStatus,
    NavigationVelocity,
    PlannedPath,
    RejectedData,
)
from executive.values.geometry import Point, Pose, TargetFrame, Velocity
from executive.values.ports import (
    DriveBy,
    NavigateTo,
    NavigationGoal,
    PathRequest,
    TurnBy,
)
from executive.values.reports import Identity
from tests.support.navigation import Navigation
from tests.support.navigation_server import NavigationServer

pytestmark = pytest.mark.ros

LIMIT_S = 30.0
ODOM, MAP = TargetFrame.ODOM, TargetFrame.MAP
COMMAND = Identity("test", 1)


class Pair:
    """A client and, on a node of its own, what serves it."""

    def __init__(self, node: Node, servers: Node, executor: SingleThreadedExecutor) -> None:
        self.node, self.servers, self.executor = node, servers, executor
        self.facts: list[Fact] = []
        self.client = NavigationClient(node, SystemClock(), self.facts.append, RelativeActions.NAV2)
        self.map_to_odom: Pose | None = None

    def until(self, done: Callable[[], bool], what: str, *, ticks: bool = True) -> None:
        deadline_s = time.monotonic() + LIMIT_S
        while not done():
            assert time.monotonic() < deadline_s, f"waited in vain: {what}: {self.facts}"
            self.spin(ticks=ticks)

    def spin(self, *, ticks: bool = True) -> None:
        with suppress(TimeoutException):
            self.executor.spin_once(timeout_sec=0.01)
        if ticks:
            self.client.poll(self.map_to_odom)

    def serve(self, behaviour: str) -> Navigation:
        """Serve a simulated navigation at the origin, and wait for its discovery."""
        navigation = Navigation(behaviour)
        NavigationServer(self.servers, self.executor, navigation)
        self.until(lambda: not isinstance(self.client._action("to_pose"), str), "a server")
        self.until(lambda: not isinstance(self.client._action("compute_path"), str), "a planner")
        return navigation

    def navigate(self, number: int, *poses: Pose) -> None:
        self.client.navigate(
            NavigationGoal(number, NavigateTo(poses or (Pose(2.0),), ODOM), COMMAND)
        )

    def states(self, number: int) -> list[NavigationState]:
        return [each.state for each in self.of(NavigationStatus) if each.number == number]

    def of(self, kind: type) -> list[Any]:
        return [each for each in self.facts if isinstance(each, kind)]


@contextmanager
def pair_of_nodes(*ros_arguments: str) -> Iterator[Pair]:
    with (
        ros_node("executive", "jackal", ros_arguments=ros_arguments) as node,
        ros_node("navigation", "jackal") as servers,
        single_threaded(servers) as executor,
    ):
        yield Pair(node, servers, executor)


@pytest.fixture
def pair(ros_domain: int, nav2_msgs: None) -> Iterator[Pair]:
    assert ros_domain > 0
    assert nav2_msgs is None
    with pair_of_nodes() as pair:
        yield pair
        pair.client.cancel()
        for _ in range(30):  # no goal may be left that the executor has not begun
            pair.spin()


def test_a_goal_is_accepted_feeds_back_and_ends(pair: Pair) -> None:
    pair.navigate(1)
    pair.until(lambda: bool(pair.states(1)), "an answer without a server")
    (status,) = pair.of(NavigationStatus)
    assert status.state is NavigationState.UNAVAILABLE
    assert status.text == "there is no action server /jackal/navigate_to_pose"
    pair.serve("feedback_lies")
    pair.navigate(2, Pose(0.4))
    pair.until(lambda: NavigationState.SUCCEEDED in pair.states(2), "its end")
    assert pair.states(2) == [NavigationState.ACCEPTED, NavigationState.SUCCEEDED]
    remaining = [each.remaining_m for each in pair.of(NavigationFeedback)]
    assert remaining == sorted(remaining, reverse=True)
    assert remaining[-1] < 0.2


@pytest.mark.parametrize(
    ("behaviour", "state", "code_name"),
    [
        ("rejects", NavigationState.REJECTED, ""),
        ("aborts", NavigationState.ABORTED, "ComputePathToPose NO_VALID_PATH"),
        ("succeeds_at_once", NavigationState.SUCCEEDED, ""),
    ],
)
def test_an_end_is_reported_with_its_code(
    pair: Pair, behaviour: str, state: NavigationState, code_name: str
) -> None:
    pair.serve(behaviour)
    pair.navigate(1)
    pair.until(lambda: state in pair.states(1), "its end")
    last = pair.of(NavigationStatus)[-1]
    assert (last.state, last.code_name) == (state, code_name)


def test_an_abandoned_goal_is_cancelled_when_it_is_accepted(pair: Pair) -> None:
    navigation = pair.serve("honest")
    cancelled: list[object] = []
    cancel = navigation.cancel

    def record(key: object | None = None) -> list[object]:
        cancelled.append(key)
        return cancel(key)

    navigation.cancel = record  # type: ignore[method-assign]
    pair.navigate(1)
    pair.client.poll(None)  # sent, and not answered
    sent = pair.client._sent
    assert sent is not None
    pair.navigate(2)
    pair.until(lambda: NavigationState.ACCEPTED in pair.states(2), "the second")
    pair.until(lambda: sent.uuid in cancelled, "the cancel of the first")
    assert pair.states(1) == []
    second = pair.client._sent
    assert second is not None
    assert second.uuid != sent.uuid


@pytest.mark.parametrize(
    "task",
    [
        NavigateTo((Pose(0.05), Pose(0.1)), ODOM),
        TurnBy(-0.03, 0.5),
        DriveBy(-0.03, 0.2),
    ],
    ids=["poses", "turn", "drive"],
)
def test_each_task_has_its_action(pair: Pair, task: NavigateTo | TurnBy | DriveBy) -> None:
    pair.serve("honest")
    pair.until(lambda: not isinstance(pair.client._action("drive"), str), "a server")
    pair.client.navigate(NavigationGoal(1, task, COMMAND))
    ends = [NavigationState.ACCEPTED, NavigationState.SUCCEEDED]
    pair.until(lambda: pair.states(1) == ends, "its end")


def test_relative_actions_of_a_create_3_have_fields_of_their_own() -> None:
    class Action:
        Goal = SimpleNamespace

    driven = goal_message(Action, DriveBy(-0.4, 0.2), "")
    assert (driven.distance, driven.max_translation_speed) == (-0.4, 0.2)
    turned = goal_message(Action, TurnBy(1.5, 0.7), "")
    assert (turned.angle, turned.max_rotation_speed) == (1.5, 0.7)


def test_feedback_is_read_by_the_fields_of_a_type() -> None:
    path = NavigationGoal(7, NavigateTo((Pose(), Pose(), Pose()), MAP), COMMAND)
    waypoint = SimpleNamespace(current_waypoint=1)
    assert feedback_fact(path, waypoint) == NavigationFeedback(7, None, 0, 2)
    lost = SimpleNamespace(distance_remaining=nan, number_of_recoveries=2)
    assert feedback_fact(path, lost) == NavigationFeedback(7, None, 2)
    drive = NavigationGoal(8, DriveBy(-1.0, 0.2), COMMAND)
    travelled = SimpleNamespace(distance_traveled=0.25)
    assert feedback_fact(drive, travelled) == NavigationFeedback(8, 0.75)


@pytest.mark.parametrize("abandoned", [False, True])
def test_an_acceptance_without_an_answer_is_found_in_the_status(
    pair: Pair, abandoned: bool
) -> None:
    navigation = pair.serve("honest")
    pair.navigate(1)
    pair.client.poll(None)
    sent = pair.client._sent
    assert sent is not None
    sent.action._send._waiting.clear()  # its answer is lost
    if abandoned:
        pair.client._abandon()
        pair.until(lambda: navigation.goal is not None, "its start")
        pair.until(lambda: navigation.goal is None, "its cancel")
        assert pair.states(1) == []
    else:
        pair.until(lambda: pair.states(1) == [NavigationState.ACCEPTED], "its acceptance")


def test_goals_of_a_process_before_and_of_others_are_cancelled(pair: Pair) -> None:
    navigation = pair.serve("honest")
    kind = import_module("nav2_msgs.action").NavigateToPose
    other = PolledAction(pair.servers, kind, "navigate_to_pose", lambda *_: None, lambda *_: None)
    pair.until(lambda: other.ready, "another client")
    goal = kind.Goal()
    goal.pose.pose.position.x = 5.0
    goal.pose.pose.orientation.w = 1.0
    other.send(goal, lambda _: None)
    pair.until(lambda: navigation.goal is not None, "its goal")
    pair.client.cancel()
    pair.until(lambda: navigation.goal is None, "the cancel, without a tick", ticks=False)
    pair.navigate(1)
    pair.until(lambda: NavigationState.ACCEPTED in pair.states(1), "a goal after it")
    other.send(goal, lambda _: None)
    pair.until(lambda: NavigationState.PREEMPTED in pair.states(1), "that it is preempted")
    last = pair.of(NavigationStatus)[-1]
    assert "another client sent a goal to /jackal/navigate_to_pose" in {
        each.text for each in pair.of(NavigationStatus)
    }, last


def test_a_cancel_before_the_discovery_is_sent_after_it(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair.client.cancel()
    pair.navigate(1)
    pair.until(lambda: bool(pair.states(1)), "an answer without a server")
    cancelled: list[object] = []
    cancels = pair.client._actions["to_pose"]._cancel
    monkeypatch.setattr(cancels, "call", lambda request, _: cancelled.append(request))
    pair.serve("honest")
    pair.until(lambda: bool(cancelled), "the cancel")


def test_a_server_that_does_not_know_the_goal_has_lost_it(pair: Pair) -> None:
    pair.serve("honest")
    pair.navigate(1)
    pair.until(lambda: NavigationState.ACCEPTED in pair.states(1), "its acceptance")
    sent = pair.client._sent
    assert sent is not None
    sent.uuid = bytes(16)
    pair.client._request_result(sent)
    pair.until(lambda: NavigationState.LOST in pair.states(1), "the loss")
    assert pair.of(NavigationStatus)[-1].text == "the server does not know the goal"
    result = SimpleNamespace(error_code=104, error_msg=1_000_000 * "x")
    pair.client._report(sent.goal, NavigationState.ABORTED, result)
    pair.client._paths[1] = PathRequest(1, Pose(), Pose(), ODOM), inf
    pair.client._answer_path(pair.client._paths[1][0], 1_000_000 * "x")
    pair.spin()
    assert pair.of(NavigationStatus)[-1].text == 300 * "x"
    assert pair.of(PlannedPath)[-1].text == 300 * "x"


def test_a_path_is_brought_into_the_frame_of_its_request(pair: Pair) -> None:
    request = PathRequest(1, Pose(), Pose(1.0), ODOM)
    pair.client.plan(request)
    pair.until(lambda: len(pair.of(PlannedPath)) == 1, "an answer without a planner")
    assert pair.of(PlannedPath)[0].points == ()
    kind = import_module("nav2_msgs.action").ComputePathToPose

    def plan(handle: Any) -> Any:
        handle.succeed()
        result = kind.Result(path=Path(poses=[PoseStamped() for _ in range(201)]))
        result.path.header.frame_id = "map"
        for index, each in enumerate(result.path.poses):
            each.pose.position.x = index * 0.05
        return result

    ActionServer(pair.servers, kind, "compute_path_to_pose", plan)  # type: ignore[no-untyped-call]
    pair.until(lambda: not isinstance(pair.client._action("compute_path"), str), "a planner")
    for number, map_to_odom in ((2, None), (3, Pose(1.0, 2.0))):
        pair.map_to_odom = map_to_odom
        pair.client.plan(PathRequest(number, Pose(), Pose(10.0), ODOM))
        pair.until(lambda: pair.of(PlannedPath)[-1].number == number, "an answer")  # noqa: B023
    _, without, path = pair.of(PlannedPath)
    assert "no transform from map of the path to odom" in without.text
    assert path.points[0] == Point(-1.0, -2.0)
    assert path.points[-1] == Point(9.0, -2.0)
    assert len(path.points) == 201


def test_a_planned_path_is_bounded() -> None:
    path = Path(poses=[PoseStamped() for _ in range(20_000)])
    for index, each in enumerate(path.poses):
        each.pose.position.x = 0.05 * index
    points = planned_points(path, Pose())
    assert len(points) <= 500
    assert (points[0].x_m, points[-1].x_m) == (0.0, 999.95)
    path.poses[-1].pose.position.y = nan
    assert planned_points(path, Pose()) == ()


def test_the_velocity_is_received_in_the_published_type(pair: Pair) -> None:
    received = NavigationVelocityTopic(
        pair.node, "nav_vel", SystemClock(), pair.facts.append, Twist
    )
    publisher = pair.servers.create_publisher(TwistStamped, "nav_vel", 1)
    twist = TwistStamped()
    twist.twist.linear.x = 0.5

    def velocity_received() -> bool:
        received.poll()
        publisher.publish(twist)
        return bool(pair.of(NavigationVelocity))

    pair.until(velocity_received, "a velocity")
    assert pair.of(NavigationVelocity)[0] == NavigationVelocity(Velocity(0.5, 0.0))
    (wrong,) = pair.of(RejectedData)
    assert wrong.reason.endswith("TwistStamped, and the mux receives geometry_msgs/msg/Twist")


def test_a_package_that_is_missing_is_named(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ros_domain > 0
    for name in [each for each in sys.modules if each.split(".")[0] == "nav2_msgs"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "nav2_msgs", None)
    with pair_of_nodes() as pair:
        pair.navigate(1)
        pair.spin()
        (status,) = pair.of(NavigationStatus)
        assert status.state is NavigationState.UNAVAILABLE
        assert "this ROS has no package nav2_msgs" in status.text
        assert "apt install ros-jazzy-nav2-msgs" in status.text


@pytest.mark.usefixtures("nav2_msgs")
def test_a_package_for_another_python_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = type(import_module("nav2_msgs.action").NavigateToPose)
    monkeypatch.setattr(kind, "_TYPE_SUPPORT", None)
    monkeypatch.setattr(kind, "__import_type_support__", lambda *_: None)
    text = action_type("type", "nav2_msgs/action/NavigateToPose", ("pose",))
    assert "no package nav2_msgs for this Python" in text
    assert "navigate_to_pose" not in _installed_actions()


@pytest.mark.usefixtures("nav2_msgs")
@pytest.mark.parametrize(
    "name",
    ["nav2_msgs/NavigateToPose", "std_msgs/action/Nothing", "nav2_msgs/action/ComputePathToPose"],
)
def test_a_type_that_is_none_is_refused(ros_domain: int, name: str) -> None:
    assert ros_domain > 0
    given = ("-p", f"navigation.to_pose.type:={name}")
    with pytest.raises(ParameterError, match=name), pair_of_nodes(*given):
        pass


def test_codes_have_names() -> None:
    assert error_name(0) == ""
    assert error_name(105) == "FollowPath FAILED_TO_MAKE_PROGRESS"
    assert error_name(714) == "BackUp COLLISION_AHEAD"
    assert error_name(723) == "DriveOnHeading COLLISION_AHEAD"
    assert error_name(716) == "BackUp"
    assert error_name(150) == "FollowPath"
    assert error_name(9101) == "NavigateThroughPoses FAILED_TO_LOAD_BEHAVIOR_TREE"
    assert error_name(905) == "Docking"
    assert error_name(50_000) == ""
