"""`check_bag` plays a bag of a robot through the fault monitors of its asset.

Without commanded velocities in the bag, those of its odometry are used, smoothed and earlier: the
robot did as commanded. Each fault is then a false one, unless the robot was at fault.
"""

from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf, isfinite
from pathlib import Path
from statistics import fmean
from typing import Any, Final

from rclpy.node import Node

from adapters.ros.check.advice import Advice, TopicResult
from adapters.ros.check.check import CheckResult, asset_node, result
from adapters.ros.check.figures import Arrived, timing
from adapters.ros.check.listening import ReceivedTopic, fact_readers
from adapters.ros.conversions import MessageError
from adapters.ros.parameters import declare_topics, type_name
from adapters.ros.sensors import declare_sensor_topics
from executive.faults import Reaction
from executive.safety import FaultMonitor
from executive.settings import Sensor, Settings, TurnSource, load_settings
from executive.values.clock import ManualClock
from executive.values.facts import Fact, Imu, Joints, Odometry
from executive.values.geometry import STANDING, Velocity

TIMEOUT_S: Final = 0.5
"""Timeout of the base without velocity commands: the default of ros2_control."""
LEAD_S, SMOOTHING_S = 0.1, 0.15
"""The assumed command: the velocity of the odometry later by the first, over both sides of it."""
STANDING_MPS: Final = 0.01
"""Velocity (also rad/s) of an assumed command that is zero."""
EPISODE_S: Final = 1.0
"""Time without a fault after which its next start is counted again."""
VELOCITIES: Final = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
CMD_VEL: Final = "cmd_vel"


class BagError(ValueError):
    """A bag cannot be read, or lacks odometry or commands; the text gives the correction."""


@dataclass(slots=True)
class _BagTopic:
    """A topic of the asset in the bag.

    Attributes:
        types: accepted message types.
        own_name: full name by the asset, and `name`, that in the bag; empty if it has none.
        fitting: all topics of these types in the bag.
    """

    key: str
    types: tuple[str, ...]
    own_name: str
    received: ReceivedTopic
    name: str = ""
    fitting: list[str] = field(default_factory=list)
    facts: list[tuple[float, Any]] = field(default_factory=list)

    @property
    def result(self) -> TopicResult:
        problems = self.received.problems
        if not self.name and self.key != CMD_VEL:
            problems = ["the bag does not have it"]
        name, timed = self.name or self.own_name, timing(self.received.times)
        return TopicResult(self.key, name, self.types[0], (), tuple(problems), (), timed)


def check_bag(asset: str, path: Path, namespace: str | None) -> CheckResult:
    """Check a bag: rosbag2 (folder, MCAP or SQLite file) or ROS 1.

    Raises:
        BagError: the bag cannot be read, or has no odometry.
        SettingsError: the files of the asset are invalid.
    """
    settings = load_settings(asset)
    topics = _topics_in(path, asset, settings, namespace)
    by_key = {each.key: each for each in topics}
    silent = {
        each.value: None
        for each in Sensor
        if each.value not in by_key or not by_key[each.value].facts
    }
    odometry_settings = settings.odometry
    if Sensor.IMU.value in silent:
        odometry_settings = replace(odometry_settings, turn=TurnSource.ODOMETRY, turn_scale=1.0)
    sensors = replace(settings.sensors, **silent)
    present = replace(settings, sensors=sensors, odometry=odometry_settings)
    odometry = by_key["odometry"].facts
    facts = _sorted(topics)
    measured = [Arrived(*each) for each in facts if isinstance(each[1], Odometry | Imu | Joints)]
    commands = [each for each in facts if isinstance(each[1], Velocity)]
    observed = [each for each in facts if not isinstance(each[1], Velocity)]
    faults = _faults(present, observed, commands or _assumed(odometry, settings.tick_s))
    notes = [Advice(f"{odometry[-1][0]:.0f} s were played, with {len(faults)} kinds of faults")]
    if not commands:
        notes.append(Advice("no commanded velocity in the bag: it is assumed by the odometry"))
    results = tuple(each.result for each in topics)
    return result(asset, settings, results, measured, faults, notes)


def bag_drive(asset: str, path: Path, namespace: str | None) -> list[tuple[float, Any]]:
    """Return velocity commands and facts of a bag with their times of arrival, s.

    Raises:
        BagError: the bag cannot be read, or has no odometry, or no commands.
        SettingsError: the files of the asset are invalid.
    """
    topics = _topics_in(path, asset, load_settings(asset), namespace)
    topic = next(each for each in topics if each.key == CMD_VEL)
    if not topic.facts:
        several = f"; it has {', '.join(topic.fitting)}" if topic.fitting else ""
        raise BagError(
            f"{path}: has no velocity commands on {topic.name or topic.own_name}{several}: record"
            " the topic that the base receives, and write its name into cmd_vel of the asset's ROS"
            " parameters"
        )
    last_s = [(at_s, next_s) for (at_s, _), (next_s, _) in pairwise([*topic.facts, (inf, None)])]
    topic.facts += [(a_s + TIMEOUT_S, STANDING) for a_s, b_s in last_s if b_s - a_s > TIMEOUT_S]
    return _sorted(topics)


def _topics_in(
    path: Path, asset: str, settings: Settings, namespace: str | None
) -> Sequence[_BagTopic]:
    """Return the topics of an asset with their messages in a bag."""
    with asset_node(asset, settings, namespace) as node:
        topics = _topics(node, settings)
    _read(path, topics)
    if not topics[0].facts:
        reasons = "; ".join(topics[0].received.problems) or "it has no message"
        raise BagError(f"{path}: its odometry cannot be used: {reasons}")
    return topics


def _sorted(topics: Iterable[_BagTopic]) -> list[tuple[float, Any]]:
    return sorted((each for topic in topics for each in topic.facts), key=lambda each: each[0])


def _topics(node: Node, settings: Settings) -> list[_BagTopic]:
    """Return the topics of the monitors, the odometry first."""
    topics, sensors = declare_topics(node), declare_sensor_topics(node, settings.sensors)
    listed = {"odometry": topics.odometry, CMD_VEL: topics.cmd_vel}
    listed |= {each.value: topic for each, topic in sensors.topics.items()}
    readers = fact_readers(sensors) | {CMD_VEL: _velocity}
    return [
        _BagTopic(
            key,
            VELOCITIES if key == CMD_VEL else (type_name(topic.type),),
            node.resolve_topic_name(topic.name),
            ReceivedTopic(readers[key]),
        )
        for key, topic in listed.items()
    ]


def _velocity(message: Any) -> Any:
    twist = getattr(message, "twist", message)
    velocity = Velocity(float(twist.linear.x), float(twist.angular.z))
    if not (isfinite(velocity.travel_mps) and isfinite(velocity.rotate_radps)):
        raise MessageError("the velocity is not finite")
    return velocity


def _read(path: Path, topics: Sequence[_BagTopic]) -> None:
    """Read the messages of the topics: by the asset's names, else the only one of its type."""
    from rosbags.highlevel import AnyReader, AnyReaderError

    try:
        with AnyReader([path]) as reader:
            types = {each.topic: each.msgtype for each in reader.connections}
            for topic in topics:
                fitting = [name for name, kind in types.items() if kind in topic.types]
                topic.fitting = fitting
                if topic.own_name in fitting or len(fitting) == 1:
                    topic.name = topic.own_name if topic.own_name in fitting else fitting[0]
                elif topic is topics[0]:
                    raise BagError(
                        f"{path}: {', '.join(fitting) or 'no topic'} of type {topic.types[0]}:"
                        " write the one to use into odometry of the asset's ROS parameters, or"
                        " give --namespace"
                    )
            wanted = {topic.name: topic for topic in topics if topic.name}
            connections = [each for each in reader.connections if each.topic in wanted]
            for connection, time_ns, octets in reader.messages(connections=connections):
                message = reader.deserialize(octets, connection.msgtype)
                topic, at_s = wanted[connection.topic], (time_ns - reader.start_time) * 1e-9
                if (fact := topic.received.fact(message, time_ns * 1e-9)) is not None:
                    topic.facts.append((at_s, fact))
    except (AnyReaderError, OSError) as error:
        raise BagError(f"{path}: cannot be read as a bag: {error}") from error


def _assumed(
    odometry: Sequence[tuple[float, Odometry]], tick_s: float
) -> list[tuple[float, Velocity]]:
    """Return the commands that a robot had which did as commanded."""
    times_s = [at_s for at_s, _ in odometry]
    commands = []
    for tick in range(int(times_s[0] / tick_s), int(times_s[-1] / tick_s)):
        at_s = tick * tick_s + LEAD_S
        first = bisect_left(times_s, at_s - SMOOTHING_S)
        near = odometry[first : max(first + 1, bisect_right(times_s, at_s + SMOOTHING_S))]
        speeds = (
            fmean(fact.velocity.travel_mps for _, fact in near),
            fmean(fact.velocity.rotate_radps for _, fact in near),
        )
        commands.append(
            (tick * tick_s, Velocity(*(v if abs(v) > STANDING_MPS else 0.0 for v in speeds)))
        )
    return commands


def _faults(
    settings: Settings, facts: Sequence[tuple[float, Fact]], commands: list[tuple[float, Velocity]]
) -> tuple[str, ...]:
    """Return the faults, each with its reaction, number of episodes, and first text."""
    clock = ManualClock()
    monitor, start_s = FaultMonitor(clock, settings), clock.now_s()
    first: dict[str, str] = {}
    episodes, last_s = Counter[str](), defaultdict[str, float](lambda: -EPISODE_S)
    facts_left, commands_left = deque(facts), deque(commands)
    velocity, now_s = STANDING, facts[0][0]
    while facts_left:
        now_s += settings.tick_s
        while facts_left and facts_left[0][0] <= now_s:
            at_s, fact = facts_left.popleft()
            clock.set(start_s + at_s)
            monitor.observe(fact)
        clock.set(start_s + now_s)
        while commands_left and commands_left[0][0] <= now_s:
            _, velocity = commands_left.popleft()
        monitor.history.command(velocity)
        for fault in monitor.check(velocity != STANDING).begun:
            if (reaction := fault.row.reaction) is Reaction.IGNORE:
                continue
            episodes[fault.name] += now_s - last_s[fault.name] >= EPISODE_S
            last_s[fault.name] = now_s
            text = f"{reaction.value}, first at {now_s:.1f} s: {fault.refusal.text}"
            first.setdefault(fault.name, text)
        monitor.active.clear()  # as by a resume at once
    return tuple(f"{count} × {name}: {first[name]}" for name, count in episodes.most_common())
