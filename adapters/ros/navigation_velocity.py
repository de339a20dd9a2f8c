"""`NavigationVelocityTopic`: the velocity of a navigation, Twist or TwistStamped."""

from collections.abc import Callable
from math import inf
from typing import Final

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node

from adapters.ros.conversions import MessageError, twist_of
from adapters.ros.parameters import Topic, type_name
from adapters.ros.subscription import TopicSubscription
from executive.values.clock import Clock
from executive.values.facts import Fact, NavigationVelocity
from executive.values.geometry import Velocity

SILENCE_S: Final = 1.0
"""Silence of the topic after which its publishers are queried."""


class NavigationVelocityTopic:
    """The navigation's velocity as facts, of the type that is published: Twist or TwistStamped.

    Args:
        node: subscribes.
        topic: its name, and the type before a publisher is known.
        clock: the core's clock.
        observe: called by `poll` with each message.
    """

    def __init__(
        self, node: Node, topic: Topic, clock: Clock, observe: Callable[[Fact], None]
    ) -> None:
        self._node, self._topic, self._clock, self._observe = node, topic, clock, observe
        self._received_s = -inf
        self._subscription = TopicSubscription(node, topic, self._on_message, polled=True)

    def poll(self) -> None:
        """Observe the velocities; after a silence, subscribe to the published type."""
        self._subscription.poll()
        now_s = self._clock.now_s()
        if now_s < self._received_s + SILENCE_S:
            return
        self._received_s = now_s
        infos = self._node.get_publishers_info_by_topic(
            self._node.resolve_topic_name(self._topic.name)
        )
        kinds = {type_name(each): each for each in (Twist, TwistStamped)}
        published = [kinds[each.topic_type] for each in infos if each.topic_type in kinds]
        if published and self._topic.type not in published:
            self._subscription.close()
            qos = self._topic.qos
            self._topic = Topic(self._topic.name, published[0], qos, follows=True)
            self._subscription = TopicSubscription(
                self._node, self._topic, self._on_message, polled=True
            )
        self._subscription.follow()

    def _on_message(self, message: Twist | TwistStamped) -> None:
        self._received_s = self._clock.now_s()
        twist = twist_of(message)
        velocity = Velocity(twist.linear.x, twist.angular.z)
        if not velocity.finite:
            raise MessageError(f"the navigation's velocity is not finite: {velocity}")
        self._observe(NavigationVelocity(velocity))
