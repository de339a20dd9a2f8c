"""`NavigatedRosRover`: a rover on `cmd_vel` with a navigation, behind a gate before the base."""

from collections.abc import Callable
from math import inf
from typing import Final

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool

from adapters.ros.conversions import MessageError, twist_of
from adapters.ros.navigation import NavigationClient
from adapters.ros.parameters import (
    ParameterError,
    Topic,
    Topics,
    declare_optional_text,
    type_name,
)
from adapters.ros.rover import LOCK_QOS, RosRover, Subscribe
from adapters.ros.subscription import TopicSubscription
from executive.settings import Settings
from executive.values.clock import Clock
from executive.values.facts import Fact, NavigationVelocity
from executive.values.geometry import Pose, Velocity
from executive.values.ports import NavigationGoal, PathRequest

SILENCE_S: Final = 1.0
"""Silence of the navigation's velocity after which its publishers are queried."""


class NavigatedRosRover(RosRover):
    """Sends goals to the navigation, and opens and shuts the lock of its input in the mux.

    The guard is one, too: it needs the lock alone, and `subscribe` creates everything else.
    """

    def __init__(self, node: Node, topics: Topics, clock: Clock, settings: Settings) -> None:
        """Create the publishers.

        Raises:
            ParameterError: the velocity topic is not the executive's input of the mux.
        """
        super().__init__(node, topics, clock, settings)
        navigation, mux = settings.navigation, settings.mux
        assert navigation is not None
        self._clock, self._relative = clock, navigation.relative
        self._navigation_topic, self._gate = "", None
        if mux is not None and navigation.input is not None and navigation.lock is not None:
            self._navigation_topic = mux.topics[navigation.input].topic
            lock = mux.locks[navigation.lock].topic
            self._gate = node.create_publisher(Bool, lock, LOCK_QOS)

    def subscribe(self, add_subscription: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Subscribe to the navigation's velocity, and create the clients, too.

        Raises:
            ParameterError: an action's type, or the topic of the velocity.
        """
        super().subscribe(add_subscription, observe)
        node, name = self._node, self._navigation_topic
        if not name:
            key = "navigation.velocity.topic"
            name = declare_optional_text(node, key, "the navigation's velocity") or "nav_vel"
            own, other = (node.resolve_topic_name(each) for each in (self._topic.name, name))
            if own == other:
                raise ParameterError(
                    f"parameter {key} is {name}, the executive's own topic (cmd_vel.topic): have"
                    " the navigation publish on another one, or use gate lock"
                )
        self._navigation = NavigationClient(node, self._clock, observe, self._relative)
        self._velocities = NavigationVelocityTopic(node, name, self._clock, observe)

    def poll(self, map_to_odom: Pose | None) -> None:
        """Observe velocities and answers; see `PolledRover`."""
        self._navigation.poll(map_to_odom)
        self._velocities.poll()

    def navigate(self, goal: NavigationGoal) -> None:
        """Send a goal to the navigation."""
        self._navigation.navigate(goal)

    def cancel_navigation(self) -> None:
        """Cancel all goals of the navigation."""
        self._navigation.cancel()

    def plan_path(self, request: PathRequest) -> None:
        """Request a path of the navigation's planner."""
        self._navigation.plan(request)

    def open_gate(self, is_open: bool) -> None:
        """Publish the lock, from any thread; a relay is the core's."""
        if self._gate is not None:
            self._gate.publish(Bool(data=not is_open))

    def stop(self) -> None:
        """Shut the gate, and publish zero."""
        self.open_gate(False)
        super().stop()

    def emergency_stop(self) -> None:
        """Shut the gate, publish zero and lock the mux, from any thread."""
        self.open_gate(False)
        super().emergency_stop()

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last velocity and locks have been received; return whether they were."""
        timeout = Duration(seconds=timeout_s)
        shut = self._gate is None or self._gate.wait_for_all_acked(timeout)
        return super().flush(timeout_s) and shut


class NavigationVelocityTopic:
    """The navigation's velocity as facts, in the published type: Twist or TwistStamped."""

    def __init__(
        self, node: Node, name: str, clock: Clock, observe: Callable[[Fact], None]
    ) -> None:
        self._node, self._name, self._clock, self._observe = node, name, clock, observe
        self._checked_s = -inf
        self._subscribe(Twist)

    def _subscribe(self, kind: type) -> None:
        qos = QoSProfile(depth=10)  # type: ignore[no-untyped-call]
        topic = Topic(self._name, kind, qos, follows=True)
        self._kind = kind
        self._topic = TopicSubscription(self._node, topic, self._on_message, polled=True)

    def poll(self) -> None:
        """Observe the velocities; after a silence, subscribe to the published type."""
        self._topic.poll()
        now_s = self._clock.now_s()
        if now_s < self._checked_s + SILENCE_S:
            return
        self._checked_s = now_s
        name = self._node.resolve_topic_name(self._name)
        published = {each.topic_type for each in self._node.get_publishers_info_by_topic(name)}
        other = TwistStamped if self._kind is Twist else Twist
        if type_name(other) in published and type_name(self._kind) not in published:
            self._topic.close()
            self._subscribe(other)
        self._topic.follow()

    def _on_message(self, message: Twist | TwistStamped) -> None:
        self._checked_s = self._clock.now_s()
        twist = twist_of(message)
        velocity = Velocity(twist.linear.x, twist.angular.z)
        if not velocity.finite:
            raise MessageError(f"the navigation's velocity is not finite: {velocity}")
        self._observe(NavigationVelocity(velocity))
