"""An executive on ROS, and a stand-in for the rover that says what a test wants it to say."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import count
from math import nan
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, CompressedImage, Imu, JointState
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import Trigger

from adapters.onboard.service import NODE_NAME, executive_on, watched
from adapters.ros import (
    ParameterError,
    Topic,
    Topics,
    battery_message,
    declare_sensor_topics,
    declare_topics,
    odometry_message,
    ros_node,
    single_threaded,
    time_message,
)
from adapters.ros.conversions import BatteryReader
from adapters.ros.robot_model import ROBOT_DESCRIPTION, latched_qos
from adapters.ros.sensors import (
    imu_message,
    joints_message,
    second_odometry_message,
)
from executive.commands import Mode
from executive.commands.catalogue import Command, Resume, Stop
from executive.commands.lifecycle import Accepted, SubmitResult
from executive.core.runner import Executive
from executive.record import Ledger, Synchronous
from executive.settings import (
    CameraLimits,
    LaserSettings,
    SecondOdometrySettings,
    Sensor,
    Sensors,
    Settings,
    config_folder,
    load_settings,
)
from executive.values.facts import (
    Battery,
    CameraAngles,
    Fact,
    ForeignMuxInput,
    Joints,
    Odometry,
    SecondOdometry,
)
from executive.values.facts import Imu as ImuFact
from executive.values.geometry import Pose, Velocity
from executive.values.reports import Identity
from trees.rover import RoverTree

pytestmark = pytest.mark.ros

LIMIT_S = 60.0
NEVER_S = 1000.0
JACKAL = config_folder() / "jackal.yaml"
PARAMETERS = config_folder() / "jackal.ros.yaml"
JPEG = b"\xff\xd8\xff\xe0 and so on"


@dataclass
class Bench:
    """The executive on its node, and the stand-in on another."""

    executive: Executive
    node: Node
    rover: Node
    topics: Topics
    executors: tuple[SingleThreadedExecutor, SingleThreadedExecutor]
    velocities: list[Any] = field(default_factory=list)
    locked: list[bool] = field(default_factory=list)
    health: list[DiagnosticArray] = field(default_factory=list)

    def until(self, done: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + LIMIT_S
        while not done():
            assert time.monotonic() < deadline_s, f"waited in vain: {what}"
            for executor in self.executors:
                executor.spin_once(timeout_sec=0.01)

    def publisher(self, kind: type, topic: Topic | None) -> Publisher:
        assert topic is not None
        publisher = self.rover.create_publisher(kind, topic.name, topic.qos)
        self.until(lambda: self.met(publisher.topic_name), f"{topic.name} is heard")
        return publisher

    def met(self, topic: str) -> bool:
        """Return whether all ends know each other: before, what is said once is lost."""
        nodes = (self.node, self.rover)
        received = [end for node in nodes for end in node.publishers if end.topic_name == topic]
        reported = [end for node in nodes for end in node.subscriptions if end.topic_name == topic]
        return all(end.get_subscription_count() == len(reported) for end in received) and all(
            end.get_publisher_count() == len(received) for end in reported
        )

    def submit(self, command: Command) -> SubmitResult:
        """Hand a command over from another thread, as a link does."""
        answers: list[SubmitResult] = []
        thread = threading.Thread(target=self.executive.submit, args=(command, answers.append))
        thread.start()
        thread.join()
        self.until(lambda: bool(answers), "an answer")
        return answers[0]


@contextmanager
def started(
    folder: Path,
    tick_s: float,
    *ros_arguments: str,
    sensors: Sensors | None = None,
    parameters: Path = PARAMETERS,
    asset: Settings | None = None,
) -> Iterator[Bench]:
    jackal = asset or load_settings(str(JACKAL))
    settings = replace(jackal, tick_s=tick_s, sensors=sensors or jackal.sensors)
    ledger = Ledger(folder / "ledger.sqlite", Synchronous.NORMAL)
    with (
        ros_node(NODE_NAME, "jackal", parameters=parameters, ros_arguments=ros_arguments) as node,
        single_threaded(node) as ours,
        executive_on(node, settings, ledger, folder / "files", []) as executive,
        ros_node("rover", "jackal", parameters=parameters, ros_arguments=ros_arguments) as rover,
        single_threaded(rover) as theirs,
    ):
        topics = declare_topics(rover)
        bench = Bench(executive, node, rover, topics, (ours, theirs))
        received = rover.create_subscription(
            topics.cmd_vel.type, topics.cmd_vel.name, bench.velocities.append, topics.cmd_vel.qos
        )

        def receive_lock(message: Bool) -> None:
            bench.locked.append(message.data)

        lock = rover.create_subscription(Bool, "e_stop", receive_lock, 10)
        rover.create_subscription(DiagnosticArray, "/diagnostics", bench.health.append, 1)
        for each in (received, lock):
            bench.until(lambda: bench.met(each.topic_name), f"it hears {each.topic_name}")  # noqa: B023
        yield bench


@pytest.fixture
def bench(ros_domain: int, tmp_path: Path) -> Iterator[Bench]:
    """Give an executive that ticks."""
    assert ros_domain > 0
    with started(tmp_path, 0.05) as bench:
        yield bench


@pytest.fixture
def untimed(ros_domain: int, tmp_path: Path) -> Iterator[Bench]:
    """Give an executive whose tick does not come: what happens, happens on arrival."""
    assert ros_domain > 0
    with started(tmp_path, NEVER_S) as bench:
        yield bench


STAMPS = count(1)


def odometry(x_m: float) -> OdometryMessage:
    pose, velocity = Pose(x_m=x_m, heading_rad=0.5), Velocity(0.1, 0.2)
    return odometry_message(Odometry(0.01 * next(STAMPS), pose, velocity))


def test_a_stop_does_not_wait_for_the_tick(untimed: Bench) -> None:
    assert isinstance(untimed.submit(Command(Identity("test", 1), Stop(), "direct")), Accepted)
    untimed.until(lambda: bool(untimed.velocities), "a velocity")
    assert untimed.velocities[-1].twist == Twist()
    assert untimed.executive.mode is Mode.STOPPED


def test_the_lock_of_the_mux_is_held_from_a_stop_to_the_resume(bench: Bench) -> None:
    bench.until(
        lambda: bench.locked[-5:] == [False] * 5, "that it is open, for others lock it, too"
    )
    submitted = bench.submit(Command(Identity("test", 1), Stop(), "direct"))
    assert isinstance(submitted, Accepted)
    bench.until(lambda: bench.locked[-5:] == [True] * 5, "the lock")
    bench.locked.clear()
    bench.until(lambda: len(bench.locked) > 5, "the lock, all the time")
    assert all(bench.locked)
    joystick = bench.rover.create_publisher(TwistStamped, "joy_teleop/cmd_vel", 1)
    history = bench.executive.safety.history

    def received() -> bool:
        joystick.publish(TwistStamped())
        return history.mux_inputs == (
            ForeignMuxInput("joystick", overrides=True, publisher="/jackal/rover"),
        )

    bench.until(received, "the joystick")
    bench.submit(Command(Identity("test", 2), Resume(), "direct"))
    bench.until(lambda: bench.locked[-1] is False, "the lock opens")
    assert bench.executive.mode is Mode.IDLE


def test_the_service_stops_while_the_core_hangs_and_names_the_sender(untimed: Bench) -> None:
    client = untimed.rover.create_client(Trigger, "executive/e_stop")
    untimed.until(client.service_is_ready, "the service is there")
    called: Any = client.call_async(Trigger.Request())
    while not called.done():  # only their node is served: the core's thread does nothing
        untimed.executors[1].spin_once(timeout_sec=0.01)
    answer = called.result()
    assert answer.success
    untimed.until(lambda: untimed.locked[-1:] == [True], "the lock")
    untimed.until(lambda: untimed.executive.mode is Mode.STOPPED, "it is stopped")
    assert "stopped by ROS:" in untimed.executive.why
    assert untimed.executive.why.partition(";")[0].split()[-1] in answer.message


def test_velocities_are_stamped_and_those_of_others_received(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain > 0
    with started(tmp_path, 0.05) as bench:
        bench.submit(Command(Identity("test", 1), Stop(), "direct"))
        bench.until(lambda: bool(bench.velocities), "the zero of the stop")
        header = bench.velocities[-1].header
        assert header.stamp.sec > 0
        assert header.frame_id == "base_link"
        joystick = bench.rover.create_publisher(TwistStamped, "joy_teleop/cmd_vel", 1)
        history = bench.executive.safety.history

        def received() -> bool:
            joystick.publish(TwistStamped())
            return history.mux_inputs == (
                ForeignMuxInput("joystick", overrides=True, publisher="/jackal/rover"),
            )

        bench.until(received, "the joystick, and by whom")  # a name may be discovered later


def test_a_robot_with_odometry_and_velocity_alone_is_served(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain > 0
    parameters = tmp_path / "bare.ros.yaml"
    parameters.write_text(
        """
/**:
  ros__parameters:
    odometry: {topic: platform/odom/filtered, reliability: best_effort, depth: 50}
    cmd_vel: {topic: cmd_vel, reliability: reliable, depth: 1}
    tree_hz: 5.0
"""
    )
    settings = replace(
        load_settings(str(JACKAL)), sensors=Sensors(), mux=None, camera=CameraLimits(), battery=None
    )
    ledger = Ledger(tmp_path / "ledger.sqlite", Synchronous.NORMAL)
    with (
        ros_node(NODE_NAME, "bare", parameters=parameters) as node,
        single_threaded(node) as executor,
        executive_on(node, settings, ledger, tmp_path / "files", []) as executive,
        ros_node("rover", "bare", parameters=parameters) as rover,
    ):
        publisher = rover.create_publisher(OdometryMessage, "platform/odom/filtered", 50)
        deadline_s = time.monotonic() + LIMIT_S
        while executive.status.odometry is None:
            assert time.monotonic() < deadline_s
            publisher.publish(odometry(3.0))
            executor.spin_once(timeout_sec=0.05)
        assert executive.status.pose.x_m == 3.0
        assert executive.status.battery is None


def test_a_type_that_is_none_of_the_topic_is_refused(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain > 0
    wrong = ("-p", "cmd_vel.type:=geometry_msgs/msg/Wrench")
    known = "geometry_msgs/msg/Twist or geometry_msgs/msg/TwistStamped"
    with (
        pytest.raises(ParameterError, match=f"cmd_vel.type is 'geometry_msgs/msg/Wrench': {known}"),
        started(tmp_path, 0.05, *wrong),
    ):
        pass


def test_velocities_that_the_mux_does_not_receive_are_refused(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain > 0
    other = ("-p", "cmd_vel.topic:=cmd_vel")
    with (
        pytest.raises(ParameterError, match=r"executive, has the topic executive/cmd_vel"),
        started(tmp_path, 0.05, *other),
    ):
        pass


def test_measurements_of_the_rover_become_its_status(untimed: Bench) -> None:
    topics, status = untimed.topics, untimed.executive.status
    untimed.publisher(OdometryMessage, topics.odometry).publish(odometry(3.0))
    untimed.publisher(BatteryState, topics.battery).publish(BatteryState(voltage=25.5))
    untimed.until(lambda: status.odometry is not None and status.battery is not None, "facts")
    assert status.pose.x_m == 3.0
    assert status.pose.heading_rad == pytest.approx(0.5)
    assert status.odometry is not None
    assert status.odometry.velocity == Velocity(0.1, 0.2)
    assert status.battery == Battery(25.5)


def test_a_battery_message_is_converted() -> None:
    for sent in (Battery(25.5, 0.5), Battery(25.5, 0.0), Battery(25.5)):
        assert BatteryReader(pytest.fail).fact(battery_message(sent, 0.0)) == sent


def test_the_camera_angles_are_known_once_both_are(untimed: Bench) -> None:
    topics, status = untimed.topics, untimed.executive.status
    tilt = untimed.publisher(Float64, topics.camera_tilt_state)
    pan = untimed.publisher(Float64, topics.camera_pan_state)
    battery = untimed.publisher(BatteryState, topics.battery)
    tilt.publish(Float64(data=nan))
    tilt.publish(Float64(data=-0.25))
    battery.publish(BatteryState(voltage=25.5))
    untimed.until(lambda: status.battery is not None, "what came later")
    assert status.camera is None
    pan.publish(Float64(data=0.5))
    untimed.until(lambda: status.camera is not None, "the angles")
    assert status.camera == CameraAngles(0.5, -0.25)


def test_odometry_that_cannot_be_is_refused_and_shows_in_the_diagnostics(bench: Bench) -> None:
    publisher = bench.publisher(OdometryMessage, bench.topics.odometry)
    publisher.publish(odometry(nan))
    bench.until(lambda: any(refused(array) for array in bench.health), "a diagnosis of it")
    assert bench.executive.status.odometry is None
    status, _, _ = bench.health[-1].status
    values = {pair.key: pair.value for pair in status.values}
    assert status.name == "/jackal/executive: executive"
    assert status.hardware_id == "jackal"
    assert status.level == DiagnosticStatus.WARN
    assert values["mode"] == "IDLE"
    assert values["why"].startswith("standing: no odometry; odometry arrives")
    assert values["goals"] == "0"
    assert values["odometry age [s]"] == "inf"
    assert int(values["ledger sequence"]) == bench.executive.last_sequence
    assert float(values["tick period [s]"]) > 0.0
    assert set(values) == {
        "mode", "why", "tick period [s]", "longest tick period [s]", "longest tick [s]",
        "overruns", "odometry age [s]", "goals", "ledger sequence", "ledger commits waiting",
        "messages refused", "faults", "not monitored",
    }  # fmt: skip


def test_the_diagnostics_have_the_tree_and_faults_at_once_when_the_mode_changes(
    bench: Bench,
) -> None:
    def stopped(array: DiagnosticArray) -> bool:
        return any(pair.value == "STOPPED" for pair in array.status[0].values)

    bench.until(lambda: bool(bench.health), "a diagnosis")
    bench.submit(Command(Identity("MOE", 1), Stop(), "direct"))
    bench.until(lambda: any(map(stopped, bench.health)), "a diagnosis of the stop")
    _, tree, faults = next(filter(stopped, bench.health)).status
    assert tree.name == "/jackal/executive: tree"
    assert tree.message.startswith("rover / ")
    ticked = {pair.key: pair.value for pair in tree.values}
    assert ticked["rover"].startswith("RUNNING")
    active = bench.executive.safety.active
    assert faults.name == "/jackal/executive: faults"
    assert faults.level == (DiagnosticStatus.WARN if active else DiagnosticStatus.OK)
    assert {pair.key for pair in faults.values} == {fault.name for fault in active}


def test_a_rover_is_described_where_its_parameters_want_that(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain > 0
    with started(tmp_path, NEVER_S, "-p", "robot_model:=true") as bench:
        message: list[String] = []
        bench.rover.create_subscription(String, ROBOT_DESCRIPTION, message.append, latched_qos())
        bench.until(lambda: bool(message), "a description")
        assert '<robot name="jackal">' in message[0].data
        bench.publisher(OdometryMessage, bench.topics.odometry).publish(odometry(3.0))
        bench.until(lambda: bench.executive.status.odometry is not None, "odometry")


def test_odometry_that_waited_is_not_old(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    publisher = bench.publisher(OdometryMessage, bench.topics.odometry)
    executive, fresh = bench.executive, list[bool]()
    monkeypatch.setattr(executive, "tick", lambda: fresh.append(executive.status.odometry_fresh))
    busy_until_s = time.monotonic() + 2 * executive.settings.faults.odometry_stale.bound
    while time.monotonic() < busy_until_s:
        publisher.publish(odometry(3.0))
        bench.executors[1].spin_once(timeout_sec=0.01)
    bench.until(lambda: bool(fresh), "a tick")
    assert fresh[0]


def test_sensors_are_received_in_the_tick_if_they_have_a_topic(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ros_domain > 0
    sensors = replace(
        load_settings("jackal").sensors,
        second_odometry=SecondOdometrySettings(2),
        laser=LaserSettings(10),
    )
    with started(tmp_path, 0.05, "-p", "laser.topic:=''", sensors=sensors) as bench:
        present = {Sensor.IMU, Sensor.JOINTS, Sensor.SECOND_ODOMETRY}
        assert bench.executive.settings.sensors.present == present
        reported = declare_sensor_topics(bench.rover, bench.executive.settings.sensors)
        received: list[Fact] = []
        monkeypatch.setattr(bench.executive, "observe", received.append)
        imu = bench.publisher(Imu, reported.topics[Sensor.IMU])
        joints = bench.publisher(JointState, reported.topics[Sensor.JOINTS])
        second = bench.publisher(OdometryMessage, reported.topics[Sensor.SECOND_ODOMETRY])
        for stamp_s, sign in enumerate((1.0, -1.0, 2.0), 1):
            imu.publish(imu_message(replace(LEVEL, stamp_s=stamp_s, gyro_z_radps=sign)))
        wheels = Joints(1.0, (1.0, 2.0), (3.0, 4.0))
        joints.publish(JointState(name=["front_left_wheel_joint"], velocity=[1.0]))
        joints.publish(joints_message(wheels, reported.joints))
        where = SecondOdometry(2.0, Pose(x_m=1.0), 0.25, 0.5)
        second.publish(second_odometry_message(where, "visual_odom"))
        bench.until(lambda: {wheels, where} <= set(received), "what wheels and camera tell")
        bench.until(lambda: len([f for f in received if isinstance(f, ImuFact)]) == 3, "the IMU")
        rates = [fact.gyro_z_radps for fact in received if isinstance(fact, ImuFact)]
        assert rates == [1.0, -1.0, 2.0]
        bench.until(lambda: any(refused(array) for array in bench.health), "the bad message")
        assert bench.executive.mode is Mode.IDLE


LEVEL = ImuFact(1.0, 0.1, -0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 9.81)


@pytest.mark.parametrize("names", ["['']", "['a', 'a']"])
@pytest.mark.usefixtures("ros_domain")
def test_joints_need_a_name_each(names: str) -> None:
    arguments = ("-p", f"joints.left:={names}")
    with (
        ros_node("node", "jackal", parameters=PARAMETERS, ros_arguments=arguments) as node,
        pytest.raises(ParameterError, match=r"joints\.left is .* of the left wheels"),
    ):
        declare_sensor_topics(node, load_settings("jackal").sensors)


def refused(array: DiagnosticArray) -> bool:
    values = {pair.key: pair.value for pair in array.status[0].values}
    return int(values["messages refused"]) > 0


def test_a_callback_that_raises_leaves_the_rover_safe_and_the_process_alive(
    untimed: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    topics, executive = untimed.topics, untimed.executive
    observe = executive.observe

    def fail(fact: Fact) -> None:
        if isinstance(fact, Battery):
            raise RuntimeError("no such thing")
        observe(fact)

    monkeypatch.setattr(executive, "observe", fail)
    untimed.publisher(BatteryState, topics.battery).publish(BatteryState(voltage=25.5))
    untimed.until(lambda: executive.mode is Mode.SAFE, "the rover is SAFE")
    untimed.until(lambda: bool(untimed.velocities), "zero velocity")
    assert untimed.velocities[-1].twist == Twist()
    assert "no such thing" in executive.why
    untimed.publisher(OdometryMessage, topics.odometry).publish(odometry(3.0))
    untimed.until(lambda: executive.status.odometry is not None, "odometry goes on")
    untimed.publisher(OdometryMessage, topics.odometry).publish(odometry(3.0))
    assert isinstance(untimed.submit(Command(Identity("test", 1), Resume(), "direct")), Accepted)
    assert executive.mode is Mode.IDLE


def test_the_camera_is_received_only_until_a_requested_frame_arrived(
    untimed: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    topic = untimed.topics.camera
    assert topic is not None
    frames = untimed.rover.create_publisher(CompressedImage, topic.name, topic.qos)
    status, tree = untimed.executive.status, untimed.executive.tree
    assert isinstance(tree, RoverTree)
    assert frames.get_subscription_count() == 0

    def want_frame() -> None:
        tree.context.intents.frame = True

    monkeypatch.setattr(tree, "tick", want_frame)
    untimed.submit(Command(Identity("test", 1), Stop(), "direct"))
    untimed.until(lambda: frames.get_subscription_count() == 1, "the camera is heard")

    def refused_by_now() -> bool:
        frames.publish(CompressedImage(format="jpeg", data=list(b"no picture")))
        return any(refused(array) for array in untimed.health)

    untimed.until(refused_by_now, "it is refused")  # what comes before both ends match is lost
    frames.publish(CompressedImage(format="jpeg", data=list(JPEG)))
    untimed.until(lambda: status.frame is not None, "a frame")
    assert status.frame is not None
    assert status.frame.data == JPEG
    untimed.until(lambda: frames.get_subscription_count() == 0, "the camera is left alone")


def test_a_thread_that_hangs_shows_in_the_diagnostics(untimed: Bench) -> None:
    with watched(untimed.node, untimed.executive):
        untimed.until(lambda: bool(untimed.health), "both ends of /diagnostics have met")
        untimed.executive.query(lambda: time.sleep(1.0))
        shown = "/jackal/executive: watchdog"
        untimed.until(lambda: shown in {a.status[0].name for a in untimed.health}, "its alarm")
        reports = untimed.executive.reports
        untimed.until(
            lambda: any("did not tick" in reported.text for reported in reports()), "its event"
        )


def test_simulated_time_drives_the_tick(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain > 0
    with started(tmp_path, 0.05, "-p", "use_sim_time:=true") as bench:
        tree = bench.executive.tree
        assert isinstance(tree, RoverTree)
        clock = bench.rover.create_publisher(Clock, "/clock", 1)
        bench.until(lambda: bench.met("/clock"), "the clock is heard")
        bench.until(lambda: bool(bench.health), "health is told in real time")
        assert tree.ticks == 0
        for second in range(1, 4):
            ticks = tree.ticks
            clock.publish(Clock(clock=time_message(float(second))))
            bench.until(lambda: tree.ticks > ticks, "a tick")  # noqa: B023


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (("-p", "battery.reliability:=often"), "reliable or best_effort"),
        (("-p", "battery.depth:=0"), "at least 1"),
        (("-p", "battery.topic:=3"), "STRING"),
        (("--unheard-of",), "ROS does not start"),
    ],
)
@pytest.mark.usefixtures("ros_domain")
def test_a_wrong_parameter_is_refused(arguments: tuple[str, ...], match: str) -> None:
    with (
        pytest.raises(ParameterError, match=match),
        ros_node("node", "jackal", parameters=PARAMETERS, ros_arguments=arguments) as node,
    ):
        declare_topics(node)


@pytest.mark.usefixtures("ros_domain")
def test_a_missing_parameter_is_named() -> None:
    with (
        ros_node("node", "jackal") as node,
        pytest.raises(ParameterError, match=r"odometry\.topic .* not in the parameter file"),
    ):
        declare_topics(node)
