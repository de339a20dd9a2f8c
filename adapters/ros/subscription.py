"""`TopicSubscription`: subscribes with the quality of service of the topic's publishers."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from adapters.ros.parameters import Topic, type_name


class TopicSubscription:
    """A subscription to a topic of the parameter file.

    If the file does not state the reliability, it is best effort until the publishers are known,
    which any publisher matches, then that of the publishers.

    Args:
        node: receives the messages.
        topic: name, type and quality of service.
        callback: called with each message.
        polled: whether messages wait until `poll`, and wake no executor.
    """

    def __init__(
        self, node: Node, topic: Topic, callback: Callable[[Any], None], *, polled: bool = False
    ) -> None:
        self._node, self._topic, self._callback = node, topic, callback
        self._options: dict[str, Any] = {}
        if polled:
            quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
            self._options = {"callback_group": _Unwaited(), "event_callbacks": quiet}
        self._create(matching_qos(node, topic))

    def follow(self) -> str | None:
        """Subscribe again if the publishers have changed; return why none matches, or None."""
        offered = _offered(self._node, self._topic)
        wanted = _matching(self._topic, offered)
        if offered and _policies(wanted) != _policies(self._qos):
            self._node.destroy_subscription(self._subscription)
            self._create(wanted)
        return mismatch(self._topic.name, ((each, wanted) for each in offered))

    def poll(self) -> None:
        """Process the messages that wait."""
        waiting = self._subscription.handle
        with waiting:
            for _ in range(self._qos.depth):
                taken = waiting.take_message(self._topic.type, False)
                if taken is None:
                    break
                self._callback(taken[0])

    def _create(self, qos: QoSProfile) -> None:
        topic, self._qos = self._topic, qos
        self._subscription: Subscription = self._node.create_subscription(
            topic.type, topic.name, self._callback, qos, **self._options
        )


class _Unwaited(CallbackGroup):
    """Callback group of subscriptions that no executor waits for."""

    def can_execute(self, entity: Any) -> bool:
        """Return False."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Ignore the call: no execution begins."""


def matching_qos(node: Node, topic: Topic) -> QoSProfile:
    """Return the quality of service of a subscription: the file's, or that of the publishers."""
    return _matching(topic, _offered(node, topic))


def _matching(topic: Topic, offered: Sequence[QoSProfile]) -> QoSProfile:
    if not topic.follows:
        return topic.qos
    reliable = {each.reliability for each in offered} == {ReliabilityPolicy.RELIABLE}
    latched = {each.durability for each in offered} == {DurabilityPolicy.TRANSIENT_LOCAL}
    return QoSProfile(  # type: ignore[no-untyped-call]
        depth=topic.qos.depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else topic.qos.durability,
    )


def mismatch(topic: str, ends: Iterable[tuple[QoSProfile, QoSProfile]]) -> str | None:
    """Return why a topic connects none of its publishers and subscriptions; None if one, or none.

    Args:
        topic: its name.
        ends: what each publisher offers and the subscription requests, or the reverse.
    """
    found = [_difference(*each) for each in ends]
    return f"{topic}: {found[0]}" if found and all(found) else None


def _offered(node: Node, topic: Topic) -> list[QoSProfile]:
    name, kind = node.resolve_topic_name(topic.name), type_name(topic.type)
    infos = node.get_publishers_info_by_topic(name)
    return [each.qos_profile for each in infos if each.topic_type == kind]


def _policies(qos: QoSProfile) -> tuple[ReliabilityPolicy, DurabilityPolicy]:
    return qos.reliability, qos.durability


def _difference(offered: QoSProfile, wanted: QoSProfile) -> str | None:
    reliable, latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
    if wanted.reliability is reliable and offered.reliability is ReliabilityPolicy.BEST_EFFORT:
        return "publisher is best effort, subscription reliable"
    if wanted.durability is latched and offered.durability is DurabilityPolicy.VOLATILE:
        return "publisher is volatile, subscription transient local"
    return None
