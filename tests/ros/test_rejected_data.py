"""What a robot sends that cannot be used, on real topics: reported with its rate and the reason."""

import re
from collections.abc import Callable, Iterator
from itertools import count
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, JointState, LaserScan
from std_msgs.msg import Bool

from adapters.ros import declare_sensor_topics
from executive.commands import MoveForward
from executive.commands.catalogue import Command
from executive.commands.lifecycle import Rejected
from executive.settings import ImuSettings, JointsSettings, LaserSettings, Sensor, Sensors
from executive.values.facts import Source
from executive.values.reports import Identity
from tests.ros.test_node import PARAMETERS, Bench, started

pytestmark = pytest.mark.ros

SENSORS = Sensors(ImuSettings(100), JointsSettings(50, 0.1, 0.5), laser=LaserSettings(10))


@pytest.fixture
def bench(ros_domain: int, tmp_path: Path) -> Iterator[Bench]:
    """Give an executive that ticks, with sensors."""
    assert ros_domain > 0
    with started(tmp_path, 0.05, sensors=SENSORS) as bench:
        yield bench


def odometry(stamp: int) -> OdometryMessage:
    message = OdometryMessage()
    message.header.stamp.sec = stamp
    message.pose.pose.orientation.w = 1.0
    return message


def changed(path: str, value: object) -> Callable[[int], OdometryMessage]:
    """Return what makes odometry with one field that is another."""

    def make(stamp: int) -> OdometryMessage:
        message: Any = odometry(stamp)
        *parents, name = path.split(".")
        part = message
        for each in parents:
            part = getattr(part, each)
        setattr(part, name, value)
        return message

    return make


def why(bench: Bench, source: Source) -> str:
    found = bench.executive.status.rejections.of(source)
    return "" if found is None else str(found)


def sends(bench: Bench, publisher: Any, make: Callable[[int], Any], source: Source) -> str:
    """Publish until a rejection is reported with its rate, and return it."""
    stamps = count(1)

    def reported() -> bool:
        publisher.publish(make(next(stamps)))
        return "Hz" in why(bench, source)

    bench.until(reported, f"a rejection of {source.value}")
    return why(bench, source)


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (changed("pose.pose.orientation.w", 0.0), r"orientation \(0.0, 0.0, 0.0, 0.0\) is not a"),
        (changed("pose.pose.orientation.w", 2.0), r"orientation \(0.0, 0.0, 0.0, 2.0\) is not a"),
        (changed("pose.pose.position.z", nan), "is not finite"),
        (changed("twist.twist.linear.x", nan), "is not finite"),
        (lambda _: odometry(0), "its stamps do not advance"),
    ],
)
def test_odometry_that_cannot_be_used_is_in_the_refusal(
    bench: Bench, make: Callable[[int], OdometryMessage], reason: str
) -> None:
    publisher = bench.publisher(OdometryMessage, bench.topics.odometry)
    text = sends(bench, publisher, make, Source.ODOMETRY)
    assert text.startswith("odometry arrives at ")
    status = bench.executive.status
    bench.until(lambda: not status.odometry_fresh and "Hz" in why(bench, Source.ODOMETRY), "age")
    answer = bench.submit(Command(Identity("MOE", 1), MoveForward(1.0), "direct"))
    assert isinstance(answer, Rejected)
    assert "the position of the rover is unknown; odometry arrives at " in answer.refusal.text
    assert "rejected: " in answer.refusal.text
    assert re.search(reason, answer.refusal.text)
    assert bench.executive.why.startswith("standing: no odometry; odometry arrives at ")


def test_unusable_sensors_give_the_reason(bench: Bench) -> None:
    reported = declare_sensor_topics(bench.rover, SENSORS)
    imu, joints, scan = (
        bench.publisher(kind, reported.topics[sensor])
        for kind, sensor in (
            (Imu, Sensor.IMU),
            (JointState, Sensor.JOINTS),
            (LaserScan, Sensor.LASER),
        )
    )
    arm = JointState(name=["joint1", "joint2"], velocity=[0.0, 0.0])
    text = sends(bench, joints, lambda _: arm, Source.JOINTS)
    assert "joint states lack front_left_wheel_joint, " in text
    assert text.endswith("; they name joint1, joint2")
    zero = Imu()
    zero.orientation.w = 1.0
    assert "all zero" in sends(bench, imu, lambda _: zero, Source.IMU)
    flat = LaserScan(range_min=0.1, range_max=30.0, ranges=[inf] * 9)
    assert "angles and bounds of the scan" in sends(bench, scan, lambda _: flat, Source.LASER)


def test_best_effort_for_a_reliable_subscription_is_reported(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain > 0
    reliable = ("-p", "odometry.reliability:=reliable")
    with started(tmp_path, 0.05, *reliable) as bench:
        best_effort = ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=1, reliability=best_effort)  # type: ignore[no-untyped-call]
        publisher = bench.rover.create_publisher(OdometryMessage, bench.topics.odometry.name, qos)

        def reported() -> bool:
            publisher.publish(odometry(1))
            return bool(why(bench, Source.ODOMETRY))

        bench.until(reported, "a mismatch")
        assert why(bench, Source.ODOMETRY) == (
            "odometry is not received: platform/odom/filtered:"
            " publisher is best effort, subscription reliable"
        )


def parameter_file(folder: Path, *states: str) -> Path:
    """Return a parameter file in which some topics state no reliability."""
    text = PARAMETERS.read_text()
    for each in states:
        text, count = re.subn(rf"( {each}: {{topic: [^,]*,) reliability: \w*,", r"\1", text)
        assert count == 1
    path = folder / "jackal.ros.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("reliability", ["BEST_EFFORT", "RELIABLE"])
def test_a_subscription_without_reliability_follows_its_publisher(
    ros_domain: int, tmp_path: Path, reliability: str
) -> None:
    assert ros_domain > 0
    file = parameter_file(tmp_path, "odometry", "imu")
    wanted = ReliabilityPolicy[reliability]
    qos = QoSProfile(depth=1, reliability=wanted)  # type: ignore[no-untyped-call]
    with started(tmp_path, 0.05, sensors=SENSORS, parameters=file) as bench:
        stamps = count(1)
        sent = bench.rover.create_publisher(OdometryMessage, bench.topics.odometry.name, qos)
        bench.rover.create_publisher(Imu, "sensors/imu_0/data", qos)

        def follows() -> bool:
            sent.publish(odometry(next(stamps)))
            own = [
                each.qos_profile.reliability
                for name in (sent.topic_name, "/jackal/sensors/imu_0/data")
                for each in bench.node.get_subscriptions_info_by_topic(name)
            ]
            return own == [wanted, wanted]

        bench.until(follows, "subscriptions that match")
        before = bench.executive.status.odometry
        bench.until(lambda: follows() and bench.executive.status.odometry != before, "odometry")
        assert not why(bench, Source.ODOMETRY)


def test_a_topic_that_is_no_sensor_reports_its_mismatch_once(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain > 0
    stated = ("topic:=stop", "reliability:=reliable", "depth:=1")
    text = [word for each in stated for word in ("-p", f"emergency_stop.{each}")]
    best_effort = QoSProfile(  # type: ignore[no-untyped-call]
        depth=1, reliability=ReliabilityPolicy.BEST_EFFORT
    )
    with started(tmp_path, 0.05, *text) as bench:
        bench.rover.create_publisher(Bool, "stop", best_effort)

        def events() -> list[str]:
            found = [each.text for each in bench.executive.reports()]
            return [each for each in found if "nothing is received" in each]

        bench.until(lambda: bool(events()), "a mismatch")
        seen = len(bench.health)
        bench.until(lambda: len(bench.health) > seen + 2, "two more seconds")
        assert events() == [
            "nothing is received on stop: publisher is best effort, subscription reliable"
        ]


def test_a_base_that_subscribes_to_another_type_is_reported(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain > 0
    with started(tmp_path, 0.05) as bench:
        topic = bench.topics.cmd_vel
        (own,) = (
            each
            for each in bench.rover.subscriptions
            if each.topic_name == bench.rover.resolve_topic_name(topic.name)
        )
        assert not why(bench, Source.VELOCITY)
        bench.rover.destroy_subscription(own)
        bench.rover.create_subscription(Twist, topic.name, lambda _: None, topic.qos)
        bench.until(lambda: bool(why(bench, Source.VELOCITY)), "a mismatch")
        assert why(bench, Source.VELOCITY) == (
            f"velocity command is not received: no subscriber to {topic.name} as TwistStamped,"
            " the base subscribes as Twist"
        )


def test_sound_messages_are_no_rejections(bench: Bench) -> None:
    """Odometry that is sent twice, and joint states of an arm between those of the wheels."""
    reported = declare_sensor_topics(bench.rover, SENSORS)
    publisher = bench.publisher(OdometryMessage, bench.topics.odometry)
    joints = bench.publisher(JointState, reported.topics[Sensor.JOINTS])
    wheels = JointState(name=[*reported.joints.left, *reported.joints.right], velocity=[0.0] * 4)
    arm = JointState(name=["joint1"], velocity=[0.0])
    ticks, stamps = len(bench.health), count(1)

    def passed() -> bool:
        wheels.header.stamp.sec = stamp = next(stamps)
        for message in (wheels, arm, arm):
            joints.publish(message)
        for _ in range(2):
            publisher.publish(odometry(stamp))
        return len(bench.health) >= ticks + 4

    bench.until(passed, "four seconds")
    assert bench.executive.status.odometry is not None
    assert not any(why(bench, source) for source in Source)
    assert not [each for each in bench.executive.safety.active if "rejected" in each.name]
