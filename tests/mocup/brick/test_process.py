"""rover-nxt as a process of its own, with a brick behind pyusb and both links on ROS topics."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from ctypes.util import find_library
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64, String, UInt64

from adapters.mocup.brick.node import declare_settings
from adapters.mocup.brick.record import BrickLink
from adapters.mops import (
    Message,
    MopsStream,
    decode,
    encode,
    fingerprint,
    housekeeping_of,
    load_dictionary,
)
from adapters.ros import (
    Topic,
    conversions,
    declare_topics,
    publish_heartbeat,
    ros_node,
    single_threaded,
)
from executive.settings import config_folder
from executive.values.facts import Battery, Odometry
from executive.values.geometry import Velocity
from sim.brick import UsbPlug
from tests.mocup.brick.routing import executed
from tests.support.processes import Running, running

pytestmark = pytest.mark.ros

LIMIT_S = 60.0
SOCKET = "usb"
HEALTH = Topic("/diagnostics", DiagnosticArray, QoSProfile(depth=1))  # type: ignore[no-untyped-call]
DICTIONARY = load_dictionary()
SPELLING = DICTIONARY.spelling
MEASURED = ("1.5", "-2.0", "0.25", "0.5", "", "", "0.1", "-0.2", "7.9", "0.3", "-0.4", "")


def rover_nxt(folder: Path, name: str, *arguments: str) -> Running:
    command = (sys.executable, "-m", "sim.brick.nxt", "--usb-socket", str(folder / SOCKET))
    return Running(folder / f"{name}.log", *command, "--data", str(folder / name), *arguments)


class Bench:
    """The process, its brick, and a node at both links."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._socket = folder / SOCKET
        self._received = MopsStream(lambda line: pytest.fail(line))
        self.plug: UsbPlug | None = None
        self.brick: list[Message] = []
        self.notified: list[tuple[BrickLink, str]] = []
        self.housekeeping: list[Message] = []
        self.odometry: list[Odometry] = []
        self.battery: list[Battery] = []
        self.camera: dict[str, float] = {}
        self.health: list[DiagnosticStatus] = []
        self.process = rover_nxt(folder, "nxt")
        stack.callback(self.process.clean_up)
        self.process.output("MOCUP is served")
        files = ("--params-file", str(config_folder() / "mocup.nxt.yaml"))
        self._node: Node = stack.enter_context(
            ros_node(
                "links", "mocup", parameters=config_folder() / "mocup.ros.yaml", ros_arguments=files
            )
        )
        self._executor: SingleThreadedExecutor = stack.enter_context(single_threaded(self._node))
        topics, settings = declare_topics(self._node), declare_settings(self._node)
        self._receive(OdometryMessage, topics.odometry, self._on_odometry)
        self._receive(BatteryState, topics.battery, self._on_battery)
        self._receive(Float64, topics.camera_pan_state, self._on_angle("pan"))
        self._receive(Float64, topics.camera_tilt_state, self._on_angle("tilt"))
        for link, topic in settings.notifications.items():
            self._receive(String, topic, self._on_notification(link))
        self._commands = {
            link: self._node.create_publisher(String, topic.name, topic.qos)
            for link, topic in settings.commands.items()
        }
        assert settings.confirmations is not None
        self._stored = self._node.create_publisher(
            UInt64, settings.confirmations.name, settings.confirmations.qos
        )
        for topic in settings.commands.values():
            publish_heartbeat(self._node, topic)
        self.until(lambda: all(map(_is_received, self._commands.values())), "both links are heard")
        # Heard last: who is told of this ear was told of those before it.
        self._receive(DiagnosticArray, HEALTH, lambda array: self.health.extend(array.status))
        self.until(lambda: bool(self.health), "diagnostics")

    def until(self, done: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + LIMIT_S
        while not done():
            assert time.monotonic() < deadline_s, f"waited in vain: {what}\n{self.process.text}"
            self._executor.spin_once(timeout_sec=0.01)
            if self.plug is not None:
                received = self._received.feed(self.plug.receive())
                self.brick += [m for m in received if m.code != SPELLING.keep_alive.code]

    def plug_in(self) -> UsbPlug:
        plug = self.plug = UsbPlug(self._socket)
        self.until(lambda: self.health[-1].level == DiagnosticStatus.OK, "the brick is there")
        return plug

    def unplug(self) -> None:
        assert self.plug is not None
        self.plug.close()
        self.plug = None

    def command(self, link: BrickLink, message: Message) -> None:
        self.sends(link, str(message))

    def sends(self, link: BrickLink, text: str) -> None:
        self._commands[link].publish(String(data=text))

    def _receive(self, kind: type, topic: Topic | None, callback: Callable[..., None]) -> None:
        assert topic is not None
        received = self._node.create_subscription(kind, topic.name, callback, topic.qos)
        self.until(lambda: received.get_publisher_count() > 0, f"{topic.name} is published")

    def _on_odometry(self, message: OdometryMessage) -> None:
        self.odometry.append(conversions.odometry_fact(message))

    def _on_battery(self, message: BatteryState) -> None:
        self.battery.append(conversions.BatteryReader(pytest.fail).fact(message))

    def _on_angle(self, name: str) -> Callable[[Float64], None]:
        return lambda angle: self.camera.update({name: angle.data})

    def _on_notification(self, link: BrickLink) -> Callable[[String], None]:
        def note(text: String) -> None:
            if link is BrickLink.RELAY:
                self._stored.publish(UInt64(data=fingerprint(text.data)))
            message = decode(text.data.encode())
            if message.code == SPELLING.housekeeping.code:
                self.housekeeping.append(message)
            else:
                self.notified.append((link, text.data))

        return note


def _is_received(publisher: Publisher) -> bool:
    return publisher.get_subscription_count() > 0


@pytest.fixture
def bench(ros_domain: int, tmp_path: Path) -> Iterator[Bench]:
    assert ros_domain > 0
    with ExitStack() as stack:
        bench = Bench(stack, tmp_path)
        yield bench
        if bench.plug is not None:
            bench.plug.close()


def command(name: str, number: int, *inputs: str) -> Message:
    entry = DICTIONARY.commands[name]
    return Message(entry.code, "MOE", "MOCUP", entry.command, inputs, moe_inputs_id=number)


def test_strings_reach_the_brick_and_replies_return_by_their_link(bench: Bench) -> None:
    plug = bench.plug_in()
    relayed, direct = command("moveForward", 1, "1.5"), command("stop", 2)
    bench.command(BrickLink.RELAY, relayed)
    bench.until(lambda: bench.brick == [relayed], "the brick hears it")
    bench.command(BrickLink.DIRECT, direct)
    bench.until(lambda: bench.brick == [relayed, direct], "the brick hears the other")
    plug.send(encode(executed(direct)))
    plug.send(encode(executed(relayed)))
    bench.until(lambda: len(bench.notified) == 2, "notifications")
    assert set(bench.notified) == {
        (BrickLink.DIRECT, str(executed(direct))),
        (BrickLink.RELAY, str(executed(relayed))),
    }


def test_telemetry_is_what_any_rover_publishes(bench: Bench) -> None:
    plug = bench.plug_in()
    entry = SPELLING.telemetry
    message = Message(entry.code, "MOCUP", "ALL", entry.command, outputs=MEASURED)
    plug.send(encode(message))
    plug.send(encode(message))
    bench.until(
        lambda: len(bench.odometry) == 2 and bool(bench.battery) and len(bench.camera) == 2,
        "measurements",
    )
    odometry = bench.odometry[0]
    assert (odometry.pose.x_m, odometry.pose.y_m, odometry.pose.z_m) == (1.5, -2.0, 0.25)
    assert odometry.pose.heading_rad == pytest.approx(0.5)
    assert odometry.velocity == Velocity(0.1, -0.2)
    assert bench.battery[0].voltage_v == pytest.approx(7.9)
    assert bench.camera == {"pan": 0.3, "tilt": -0.4}
    bench.until(lambda: bool(bench.notified), "telemetry for the relay")
    assert bench.notified == [(BrickLink.RELAY, str(message))]


def test_unplugged_in_the_middle_it_reports_it_and_continues_on_reconnection(bench: Bench) -> None:
    first, late, second = (command("moveForward", number, "1.5") for number in (1, 2, 3))
    bench.plug_in()
    bench.command(BrickLink.RELAY, first)
    bench.until(lambda: bench.brick == [first], "the brick hears it")
    bench.unplug()
    bench.until(lambda: len(bench.notified) == 1, "an answer")
    bench.command(BrickLink.DIRECT, late)
    bench.until(lambda: len(bench.notified) == 2, "another")
    assert [(link, "FAILED" in text, "REJECTED" in text) for link, text in bench.notified] == [
        (BrickLink.RELAY, True, False),
        (BrickLink.DIRECT, False, True),
    ]
    bench.until(lambda: bench.health[-1].level == DiagnosticStatus.ERROR, "a diagnosis")
    assert "no brick connected" in bench.health[-1].message
    bench.until(lambda: bool(bench.housekeeping), "the ground is told, too")
    figures = housekeeping_of(bench.housekeeping[0], SPELLING.housekeeping).figures
    assert {"NXT_CONNECTED", "NXT_QUEUED", "NXT_DEAD_MAN"} <= figures.keys()
    plug = bench.plug_in()
    bench.command(BrickLink.RELAY, second)
    bench.until(lambda: len(bench.brick) > 1, "the brick is stopped")
    plug.send(encode(executed(bench.brick[1])))
    bench.until(lambda: len(bench.brick) > 2, "the brick hears the next")
    assert bench.brick[::2] == [first, second], "it hears what is new only"


def test_an_invalid_message_shows_in_the_diagnostics(bench: Bench) -> None:
    bench.plug_in()
    bench.sends(BrickLink.RELAY, "MOVE 3")

    def warned() -> bool:
        values = {pair.key: pair.value for pair in bench.health[-1].values}
        counted = (values["refused"], values["dropped_octets"], values["dropped_pieces"])
        return bench.health[-1].level == DiagnosticStatus.WARN and counted == ("1", "6", "1")

    bench.until(warned, "a warning")
    assert "message refused: 6 octets are no MOPS message" in bench.process.text
    assert bench.health[-1].hardware_id == "MOCUP"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_releases_the_brick(bench: Bench, number: int) -> None:
    plug = bench.plug_in()
    assert plug.connected
    assert bench.process.end(number) == 0
    plug.receive()
    assert not plug.connected


def test_the_command_itself_searches_the_brick_on_this_machine(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain > 0
    if find_library("usb-1.0") is None:
        pytest.skip("needs libusb-1.0-0 from apt")
    with running(tmp_path / "nxt.log", "rover-nxt") as process:
        process.output("no brick 0694:0002 is plugged in")
        assert process.end() == 0
        assert process.text.count("no brick") == 1


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--ros-args", "-p", "usb.vendor_id:=65536"), "usb.vendor_id is 0x10000: 0 to 0xffff"),
        (("--ros-args", "-p", "relay_command.depth:=0"), "relay_command.depth is 0: at least 1"),
        (("--ros-args", "-p", "relay_telemetry_s:=-1.0"), "relay_telemetry_s is -1.0: 0 to 3600 s"),
        (("--asset", "nobody"), "nobody.ros.yaml: there is no such file; --ros-params names"),
        (("--ros-params", "nowhere.yaml"), "File 'nowhere.yaml' does not exist"),
    ],
)
def test_invalid_options_are_reported_at_once(
    ros_domain: int, tmp_path: Path, arguments: tuple[str, ...], text: str
) -> None:
    assert ros_domain > 0
    process = rover_nxt(tmp_path, "nxt", *arguments)
    try:
        assert process.ended() == 2
    finally:
        process.clean_up()
    assert text in process.text
    assert "Traceback" not in process.text
