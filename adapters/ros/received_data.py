"""`ReceivedData` counts the messages of each source, and reports why messages are rejected."""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from rclpy.node import Node

from adapters.ros.conversions import IgnoredMessageError, MessageError
from adapters.ros.parameters import Topic, type_name
from adapters.ros.subscription import matching_qos, mismatch
from executive.values.facts import RejectedData, Source
from executive.values.reports import printable, without_figures

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
