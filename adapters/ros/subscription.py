"""`TopicSubscription` to a topic with its publishers' QoS; `ReceivedData` counts its messages."""

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from adapters.ros.conversions import IgnoredMessageError, MessageError
from adapters.ros.parameters import Topic, type_name
from executive.values.facts import RejectedData, Source
from executive.values.reports import printable, without_figures


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
            self._options = {"callback_group": Unwaited(), "event_callbacks": quiet}
        self._create(matching_qos(node, topic))

    def follow(self) -> str | None:
        """Subscribe again if the publishers have changed; return why none matches, or None."""
        offered = _offered(self._node, self._topic)
        wanted = _matching(self._topic, offered)
        if offered and _policies(wanted) != _policies(self._qos):
            self.close()
            self._create(wanted)
        return mismatch(self._topic.name, ((each, wanted) for each in offered))

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)

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


class Unwaited(CallbackGroup):
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


IGNORED_IN_A_ROW: Final = 8
"""Consecutive ignored messages after which a source is rejected: other joints are published a few
times as often as the wheels, and a valid source repeats a stamp once or twice."""
MAX_REASON_LENGTH: Final = 300
"""Maximum length of a reason, which quotes messages: names of joints, formats of pictures."""
_STAMPED: Final = frozenset(Source) - {Source.BATTERY, Source.CAMERA}
"""Sources whose stamps are checked here; that of a picture is compared with its request."""
_LOG = logging.getLogger(__name__)


@dataclass(slots=True)
class _Tally:
    """Messages of a source since the last report; `ignored` in a row, `rate_hz` until then."""

    received: int = 0
    rejected: int = 0
    ignored: int = 0
    reason: str = ""
    reported: bool = False
    logged: str = ""
    rate_hz: float = 0.0
    stamp_s: float | None = None


class ReceivedData:
    """Counts the messages of each source, and reports rejected ones: at once, then each second.

    Args:
        node: gives access to the ROS graph.
        topics: topic of each source; `Source.VELOCITY` is published.
        report: called with the rejections.
    """

    def __init__(
        self,
        node: Node,
        topics: Mapping[Source, Topic],
        report: Callable[[RejectedData], None],
    ) -> None:
        self._node, self._topics, self._report = node, topics, report
        self._tallies = {source: _Tally() for source in topics}
        self._since_s = time.monotonic()

    @property
    def rejected(self) -> int:
        """Number of messages rejected since the last report."""
        return sum(each.rejected for each in self._tallies.values() if each.reason)

    def receiving(
        self, source: Source, fact_of: Callable[[Any], Any], observe: Callable[[Any], None]
    ) -> Callable[[Any], None]:
        """Return a callback for the messages of a source, which passes on their facts."""
        tally = self._tallies[source]

        def receive(message: Any) -> None:
            tally.received += 1
            try:
                fact = fact_of(message)
                if source in _STAMPED and fact.stamp_s == tally.stamp_s:
                    raise IgnoredMessageError("its stamps do not advance")
                observe(fact)
            except MessageError as error:
                self._reject(source, error)
            else:
                tally.ignored, tally.stamp_s = 0, getattr(fact, "stamp_s", None)

        return receive

    def _reject(self, source: Source, error: MessageError) -> None:
        tally = self._tallies[source]
        tally.rejected += 1
        tally.ignored += 1
        if isinstance(error, IgnoredMessageError) and tally.ignored < IGNORED_IN_A_ROW:
            return
        tally.reason = printable(str(error))[:MAX_REASON_LENGTH]
        if not tally.reported:
            tally.reported = True
            self._report(RejectedData(source, tally.reason, tally.rate_hz, tally.rate_hz))
        if (pattern := without_figures(tally.reason)) != tally.logged:
            tally.logged = pattern
            _LOG.warning("%s is rejected: %s", source.value, tally.reason)

    def report(self) -> None:
        """Report messages rejected since the last call, and topics sent but not received."""
        before_s, self._since_s = self._since_s, time.monotonic()
        period_s = max(self._since_s - before_s, 1e-3)
        for source, tally in self._tallies.items():
            tally.rate_hz, rejected_hz = tally.received / period_s, tally.rejected / period_s
            tally.reported = bool(tally.reason)
            if tally.reason:
                self._report(RejectedData(source, tally.reason, rejected_hz, tally.rate_hz))
            elif not tally.received and (reason := self._mismatch(source)):
                self._report(RejectedData(source, reason))
            tally.received, tally.rejected, tally.reason = 0, 0, ""

    def _mismatch(self, source: Source) -> str | None:
        """Return why no peer of a topic matches this node; None if one does or there is no peer."""
        topic, node = self._topics[source], self._node
        name, sent = node.resolve_topic_name(topic.name), source is Source.VELOCITY
        if sent and all(each.topic_name != name for each in node.publishers):
            return None  # a rover that executes whole motions
        find = node.get_subscriptions_info_by_topic if sent else node.get_publishers_info_by_topic
        others = [each for each in find(name) if each.node_name != node.get_name()]
        fitting = [each.qos_profile for each in others if each.topic_type == type_name(topic.type)]
        if others and not fitting:
            own = topic.type.__name__
            types = ", ".join(sorted({each.topic_type.rpartition("/")[2] for each in others}))
            if sent:
                return f"no subscriber to {topic.name} as {own}, the base subscribes as {types}"
            return f"{topic.name} is published as {types}, and subscribed to as {own}"
        wanted = topic.qos if sent else matching_qos(node, topic)
        return mismatch(
            topic.name, ((wanted, each) if sent else (each, wanted) for each in fitting)
        )
