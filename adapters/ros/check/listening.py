"""`Listening` to a robot: receives the topics of its asset, and checks whether they fit."""

import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import partial
from math import isfinite, nan
from typing import Any, Final, get_type_hints

from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from adapters.ros.check.advice import Change, TopicResult
from adapters.ros.check.figures import MIN_MESSAGES, Arrived, timing
from adapters.ros.conversions import (
    BatteryReader,
    IgnoredMessageError,
    MessageError,
    odometry_fact,
    stamp_s,
)
from adapters.ros.parameters import Topic, Topics, declare_topics, type_name
from adapters.ros.rover import GUARD_NAME
from adapters.ros.sensors import SensorTopics, declare_sensor_topics, sensor_facts
from executive.settings import Settings
from executive.values.facts import EmergencyStop, Imu, Joints, Odometry

POLL_S: Final = 0.05
OWN_NODES: Final = {"executive", GUARD_NAME}
"""Nodes of a running executive, which are no part of the robot."""
SENT: Final = ("cmd_vel", "camera_pan", "camera_tilt", "camera_speed")
REQUIRED: Final = ("odometry", "cmd_vel")
DRIVEN: Final = (*REQUIRED, "emergency_stop")
"""Topics that must have no problem before a drive."""
GENERAL: Final = ("camera_pan_state", "camera_tilt_state", "emergency_stop", *SENT[1:])
"""Topics of types that other topics have, too: no other one is proposed."""
SIMULATION: Final = ("ground_truth", "camera_raw")


@dataclass(slots=True)
class ReceivedTopic:
    """Messages of a topic: times of arrival with stamps, and reasons for rejection.

    Attributes:
        fact_of: converts a message to a fact.
    """

    fact_of: Callable[[Any], Any]
    times: list[tuple[float, float]] = field(default_factory=list)
    rejected: Counter[str] = field(default_factory=Counter)
    ignored: Counter[str] = field(default_factory=Counter)

    def fact(self, message: Any, at_s: float) -> Any:
        """Return the fact of a message that arrives; None if it is rejected."""
        header = getattr(message, "header", None)
        self.times.append((at_s, nan if header is None else stamp_s(header.stamp)))
        try:
            return self.fact_of(message)
        except MessageError as error:
            ignored = isinstance(error, IgnoredMessageError)
            (self.ignored if ignored else self.rejected)[str(error)] += 1
            return None

    @property
    def problems(self) -> list[str]:
        """Reasons for rejection; other nodes may publish joints on the topic, too."""
        count = len(self.times)
        reasons = self.rejected + (self.ignored if self.ignored.total() == count else Counter())
        found = [
            f"{times} of {count} messages are rejected: {reason}"
            for reason, times in reasons.most_common(2)
        ]
        stamps_s = {stamp_s for _, stamp_s in self.times if isfinite(stamp_s)}
        if count >= MIN_MESSAGES and len(stamps_s) == 1:
            found.append(f"its stamps do not advance: all are {stamps_s.pop():g} s")
        return found


def fact_readers(sensors: SensorTopics) -> dict[str, Callable[[Any], Any]]:
    """Return the conversions of messages to facts, by the keys of their topics."""
    found = sensor_facts(sensors.joints, sensors.zero_is_free, sensors.mounting)
    return {
        "odometry": odometry_fact,
        "battery": BatteryReader(lambda _: None).fact,
        "emergency_stop": lambda message: EmergencyStop(message.data),
    } | {each.value: fact_of for each, fact_of in found.items()}


class Listening:
    """Subscribes to all topics of an asset that the robot publishes.

    Any publisher matches these subscriptions, except to latched topics; the asset's own quality of
    service is compared.

    Attributes:
        facts: odometry, IMU and joint states, in order of arrival.
        odometry: the newest odometry.

    Raises:
        ParameterError: the parameter file of the asset is invalid.
    """

    def __init__(self, node: Node, settings: Settings) -> None:
        self._node = node
        self.topics = declare_topics(node)
        sensors = declare_sensor_topics(node, settings.sensors)
        self.facts: list[Arrived[Any]] = []
        self.odometry: Arrived[Odometry] | None = None
        self._stopped = False
        self._types = {
            name: hint.__metadata__[1:]
            for name, hint in get_type_hints(Topics, include_extras=True).items()
        }
        listed = {name: getattr(self.topics, name) for name in self._types}
        listed |= {each.value: topic for each, topic in sensors.topics.items()}
        self._listed: dict[str, Topic] = {
            key: topic
            for key, topic in listed.items()
            if topic is not None and key not in SIMULATION
        }
        readers = fact_readers(sensors)
        self._received = {
            key: ReceivedTopic(readers.get(key, lambda _: None))
            for key in self._listed
            if key not in SENT
        }
        for key, received in self._received.items():
            topic, callback = self._listed[key], partial(self._on_message, received)
            lenient = QoSProfile(  # type: ignore[no-untyped-call]
                depth=max(100, topic.qos.depth), reliability=ReliabilityPolicy.BEST_EFFORT
            )
            latched = topic.qos.durability is DurabilityPolicy.TRANSIENT_LOCAL
            qos = topic.qos if latched else lenient
            node.create_subscription(topic.type, topic.name, callback, qos)

    def _on_message(self, received: ReceivedTopic, message: Any) -> None:
        at_s = self.now_s
        fact = received.fact(message, at_s)
        if isinstance(fact, Odometry | Imu | Joints):
            self.facts.append(Arrived(at_s, fact))
        if isinstance(fact, Odometry):
            self.odometry = Arrived(time.monotonic(), fact)
        if isinstance(fact, EmergencyStop):
            self._stopped = fact.active

    @property
    def now_s(self) -> float:
        """The time of the node's clock, simulated if the asset has `use_sim_time`."""
        return float(self._node.get_clock().now().nanoseconds * 1e-9)

    def listen(self, executor: Executor, seconds: float) -> None:
        """Receive messages for a time of this machine's clock."""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            executor.spin_once(timeout_sec=POLL_S)

    def results(self) -> tuple[TopicResult, ...]:
        """Return the result of each topic."""
        return tuple(self._result(key, topic) for key, topic in self._listed.items())

    def _result(self, key: str, topic: Topic) -> TopicResult:
        node, sent = self._node, key in SENT
        name = node.resolve_topic_name(topic.name)
        peers = [each for each in self._peers(name, sent) if each.node_name not in OWN_NODES]
        labels = {f"{_path(each)} as {_short(each.topic_type)}" for each in peers}
        others = {} if peers or key in GENERAL else self._others(key, topic, sent)
        problems, changes = self._mismatch(key, topic, name, peers, others)
        received = self._received.get(key)
        if received is not None:
            problems += received.problems
            if not problems and not received.times:
                problems.append("there is a publisher, but no message was received")
        if key == "emergency_stop" and self._stopped:
            problems.append("it is active: release it at the robot")
        if key == "cmd_vel" and (publishers := self.publishers(OWN_NODES)):
            problems.append(f"{', '.join(publishers)} publishes velocities, too")
        return TopicResult(
            key,
            name,
            type_name(topic.type),
            tuple(sorted(labels)),
            tuple(problems),
            tuple(changes),
            None if received is None else timing(received.times),
            tuple(others),
        )

    def publishers(self, besides: Collection[str] = ()) -> list[str]:
        """Return other nodes that publish velocities on the topic of the asset."""
        name = self._node.resolve_topic_name(self.topics.cmd_vel.name)
        found = self._peers(name, sent=False)
        return sorted({_path(each) for each in found if each.node_name not in besides})

    def _peers(self, name: str, sent: bool) -> list[Any]:
        node = self._node
        find = node.get_subscriptions_info_by_topic if sent else node.get_publishers_info_by_topic
        return [each for each in find(name) if each.node_name != node.get_name()]

    def _mismatch(
        self, key: str, topic: Topic, name: str, peers: list[Any], others: dict[str, str]
    ) -> tuple[list[str], list[Change]]:
        """Return why the robot's end of a topic does not fit, and the lines that make it fit."""
        sent, own = key in SENT, type_name(topic.type)
        verb, role = ("subscribed to", "subscriber") if sent else ("published", "publisher")
        if not peers:
            found = "".join(f"; {each} ({_short(kind)}) would fit" for each, kind in others.items())
            changes = [] if key in REQUIRED or others else [Change(f"{key}.topic", "")]
            if len(others) == 1:
                ((other, kind),) = others.items()
                changes = [Change(f"{key}.topic", other)]
                changes += [Change(f"{key}.type", kind)] if kind != own else []
            return [f"no {role} of {name}{found}"], changes
        fitting = [each for each in peers if each.topic_type == own]
        if not fitting:
            types = sorted({each.topic_type for each in peers})
            accepted = [each for each in types if each in self._accepted(key, topic)]
            text = f"{verb} as {', '.join(map(_short, types))}, the asset has {_short(own)}"
            return [text], [Change(f"{key}.type", each) for each in accepted[:1]]
        misses = min((_missed(topic, each.qos_profile, sent) for each in fitting), key=len)
        texts = [f"{role} is {theirs}, the asset {mine}" for _, mine, theirs in misses]
        problems = [f"quality of service does not match: {'; '.join(texts)}"] if misses else []
        return problems, [Change(f"{key}.{policy}", theirs) for policy, _, theirs in misses]

    def _accepted(self, key: str, topic: Topic) -> set[str]:
        types = self._types.get(key, (topic.type,))
        return {type_name(each) for each in types if each is not None}

    def _others(self, key: str, topic: Topic, sent: bool) -> dict[str, str]:
        """Return other topics of an accepted type that have the end which the asset needs."""
        node, types = self._node, self._accepted(key, topic)
        listed = {node.resolve_topic_name(each.name) for each in self._listed.values()}
        return {
            name: next(iter(types & set(found)))
            for name, found in sorted(node.get_topic_names_and_types())
            if types & set(found) and name not in listed and self._peers(name, sent)
        }


def _path(end: Any) -> str:
    return f"{end.node_namespace.rstrip('/')}/{end.node_name}"


def _short(name: str) -> str:
    return name.rpartition("/")[2]


def _missed(topic: Topic, theirs: QoSProfile, sent: bool) -> list[tuple[str, str, str]]:
    """Return each policy that does not match, with the asset's and the robot's value."""
    missed = []
    for policy in ("reliability", "durability"):
        mine, other = getattr(topic.qos, policy), getattr(theirs, policy)
        wanted, offered = (other, mine) if sent else (mine, other)
        if wanted < offered:  # of each policy, the stronger value is the smaller number
            missed.append((policy, mine.name.lower(), other.name.lower()))
    return missed
