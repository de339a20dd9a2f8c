"""docs/above-nav2.md and docs/command-from-ros.md, followed with substitutes of Nav2 and `ros2`.

Base and mux are those of the simulated Jackal. `ros2` and RViz need an apt ROS: rclpy sends the
same messages.
"""

import json
import re
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from itertools import dropwhile
from pathlib import Path
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any

import pytest
import yaml
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from rclpy.action.client import ActionClient
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from adapters.ros import latched_qos, ros_node, single_threaded
from adapters.ros.navigation import ACTIONS
from executive.settings import (
    NavigationSettings,
    config_folder,
    load_settings,
    load_yaml,
    parse_yaml,
    structure,
)
from tests.docs.pages import CHECKOUT, blocks, lines
from tests.docs.test_commands import Desk
from tests.support.ground import until_located
from tests.support.navigation import Navigation
from tests.support.navigation_server import NavigationServer
from tests.support.patience import shipped_config
from tests.support.processes import executive, simulation
from tests.support.ros_client import call

ABOVE_NAV2 = CHECKOUT / "docs" / "above-nav2.md"
FROM_ROS = CHECKOUT / "docs" / "command-from-ros.md"
LIMIT_S = 120.0
ENDS = {
    "rejects": "772 NAVIGATION_REJECTED",
    "aborts": "773 NAVIGATION_FAILED",
}
"""Reasons of the page, by behaviours of the navigation."""
UNCOMMANDED = "NAVIGATION_UNCOMMANDED_MOTION"
ODOMETRY = "platform/odom/filtered"


def sections(page: Path, key: str) -> dict[str, Any]:
    """Return the YAML block of a page whose first key is this."""
    found = [parse_yaml(block, page.name) for block in blocks(page, "yaml")]
    (only,) = (each for each in found if isinstance(each, dict) and next(iter(each)) == key)
    return only


def asset_of_the_pages(folder: Path) -> Path:
    """Replace and add the sections that the pages show; return the configuration."""
    config = shipped_config(folder, config_folder())
    path = config / "jackal.yaml"
    raw: Any = load_yaml(path)
    raw |= sections(ABOVE_NAV2, "controller") | sections(FROM_ROS, "ros")
    path.write_text(yaml.safe_dump(raw, sort_keys=False))
    return config


def test_the_mux_of_the_page_is_that_of_the_asset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    twist_mux = sections(ABOVE_NAV2, "twist_mux")["twist_mux"]["ros__parameters"]
    mux = sections(ABOVE_NAV2, "controller")["mux"]
    assert (twist_mux["topics"], twist_mux["locks"]) == (mux["topics"], mux["locks"])
    nav2 = sections(ABOVE_NAV2, "collision_monitor")["collision_monitor"]["ros__parameters"]
    assert nav2["cmd_vel_out_topic"] == mux["topics"]["navigation"]["topic"]
    monkeypatch.setenv("ROVER_CONFIG", str(asset_of_the_pages(tmp_path)))
    assert load_settings("jackal").offers_navigation


def test_the_other_sections_of_the_page_are_valid() -> None:
    relay, names = (
        each
        for each in (parse_yaml(block, ABOVE_NAV2.name) for block in blocks(ABOVE_NAV2, "yaml"))
        if isinstance(each, dict) and next(iter(each)) == "navigation"
    )
    settings = structure(relay["navigation"], NavigationSettings, ABOVE_NAV2.name)
    settings.check_gate(None)
    assert names["navigation"].keys() <= ACTIONS.keys()
    assert names["navigation"]["to_pose"]["type"] == ACTIONS["to_pose"][1]


def test_the_tool_of_rviz_is_on_the_topic_of_the_page() -> None:
    shown = yaml.safe_load((config_folder() / "rover.rviz").read_text())
    (goal,) = (each["Topic"] for each in shown["Visualization Manager"]["Tools"] if "Topic" in each)
    assert f"set *Topic* to `{goal['Value']}`" in " ".join(FROM_ROS.read_text().split())


def interface(name: str) -> Any:
    package, kind, name = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), name)


def fill(message: Any, values: dict[str, Any]) -> Any:
    """Set the fields of a message as `ros2` does."""
    for name, value in values.items():
        now = getattr(message, name)
        if isinstance(value, dict):
            fill(now, value)
        elif isinstance(value, list):
            kind = re.fullmatch(r"sequence<(.+)>", message.get_fields_and_field_types()[name])
            assert kind is not None
            element = interface(kind[1].replace("/", "/msg/"))
            setattr(message, name, [fill(element(), each) for each in value])
        else:
            setattr(message, name, type(now)(value))
    return message


def until(done: Callable[[], object], purpose: str) -> None:
    deadline_s = monotonic() + LIMIT_S
    while not done():
        assert monotonic() < deadline_s, f"waited in vain: {purpose}"
        sleep(0.05)


def typed(command: str) -> list[list[str]]:
    """Return the arguments of each line of a command, without options, from the topic on."""
    text = "\n".join(blocks(FROM_ROS, "console"))
    found = [line for line in text.splitlines() if line.startswith(command)]
    split = [shlex.split(line.removeprefix(command)) for line in found]
    return [[*dropwhile(lambda each: not each.startswith("/"), line)] for line in split]


class Terminal:
    """Sends what the lines of `ros2` on a page send, and receives the reports.

    Attributes:
        reports: those of the executive, in order.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.reports: list[dict[str, Any]] = []
        self._clients: list[Any] = []
        ((echoed, *_),) = typed("ros2 topic echo")
        node.create_subscription(String, echoed, self._on_report, latched_qos(100))

    def _on_report(self, message: String) -> None:
        self.reports.append(json.loads(message.data))

    def goal(self, name: str, kind: str, values: str) -> Any:
        """Send a goal, and return its status and result."""
        action = interface(kind)
        client: Any = ActionClient(self._node, action, name)  # type: ignore[no-untyped-call]
        self._clients.append(client)
        until(client.server_is_ready, f"{name} is served")
        goal = fill(action.Goal(), yaml.safe_load(values))
        sent = call(self._node, lambda: client.send_goal_async(goal))
        until(sent.done, f"{name} answers")
        assert sent.result().accepted, self.reports[-1]
        ended = call(self._node, sent.result().get_result_async)
        until(ended.done, f"the goal of {name} ends")
        return ended.result()

    def call(self, name: str) -> Any:
        """Call a service without arguments, and return its response."""
        client = self._node.create_client(Trigger, name)
        until(client.service_is_ready, f"{name} is served")
        answered: Any = client.call_async(Trigger.Request())
        until(answered.done, f"{name} answers")
        return answered.result()

    def publish(self, name: str, message: Any) -> None:
        """Publish a message once the subscription is matched."""
        publisher = self._node.create_publisher(type(message), name, 10)
        until(publisher.get_subscription_count, f"{name} is subscribed")
        publisher.publish(message)

    def executed(self, number: int, text: str) -> dict[str, Any]:
        """Wait until this number of commands with a text were executed; return the last report."""
        found: list[dict[str, Any]] = []

        def arrived() -> bool:
            own = [each for each in tuple(self.reports) if each["source"] == "ROS"]
            stages = (each for each in own if each["stage"] == "EXECUTED")
            found[:] = [each for each in stages if text in each["text"]]
            return len(found) >= number

        until(arrived, f"{number} times {text}: {self.reports[-2:]}")
        return found[-1]


@contextmanager
def navigation_served(navigation: Navigation) -> Iterator[Node]:
    """Serve a navigation on a thread."""
    ended = Event()
    arguments = ("-r", f"odom:={ODOMETRY}")
    with (
        ros_node("bt_navigator", "jackal", ros_arguments=arguments) as node,
        single_threaded(node) as executor,
    ):
        NavigationServer(node, executor, navigation, stamped=True)

        def serve() -> None:
            while not ended.is_set():
                executor.spin_once(timeout_sec=0.05)

        thread = Thread(target=serve)
        thread.start()
        try:
            yield node
        finally:
            ended.set()
            thread.join()


def above_nav2(desk: Desk, navigation: Navigation) -> None:
    """Follow the first page; then the navigation fails as its table has it."""
    for line in lines(ABOVE_NAV2):
        desk.run(line)
    for behaviour, reason in ENDS.items():
        navigation.behaviour = behaviour
        status, output = desk.run_here("./rover moveTo 0.3 0")
        assert status == 1, output
        assert re.search(f"FAILED +{reason}: ", output), output
    navigation.behaviour = "succeeds_then_moves"  # after the end of the command, or before
    desk.run_here("./rover moveTo 0.3 0")
    until(lambda: "SAFE: the navigation commands" in desk.run_here("./rover status")[1], "SAFE")
    until(lambda: desk.run_here("./rover resume")[0] == 0, "it is resumed")
    assert UNCOMMANDED in desk.run_here("./rover log")[1]
    navigation.behaviour = "honest"
    page = ABOVE_NAV2.read_text()
    assert all(f"| {reason} |" in page for reason in ENDS.values())
    assert f"| 776 {UNCOMMANDED} |" in page


def from_ros(terminal: Terminal) -> None:
    """Follow the second page."""
    goals = typed("ros2 action send_goal")
    for name, kind, values in goals:
        ended = terminal.goal(name, kind, values)
        assert ended.status == GoalStatus.STATUS_SUCCEEDED, (name, ended)
    terminal.executed(len(goals), "done in")

    clicked = PoseStamped()
    clicked.header.frame_id = "odom"
    clicked.pose.position.x, clicked.pose.orientation.w = 0.3, 1.0
    (topic,) = re.findall(r"set \*Topic\* to `(\S+)`", " ".join(FROM_ROS.read_text().split()))
    terminal.publish(topic, clicked)
    terminal.executed(len(goals) + 1, "done in")

    for number, (name, kind, values) in enumerate(typed("ros2 topic pub"), 2):
        terminal.publish(name, fill(interface(kind)(), yaml.safe_load(values)))
        last = terminal.executed(len(goals) + number, "done in")
    assert last["id"] == 4242

    ((service, _),) = typed("ros2 service call")
    assert terminal.call(service).success
    terminal.executed(1, "stationary after")


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.busy
@pytest.mark.usefixtures("nav2_msgs", "ros_domain")
def test_both_pages_are_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROVER_CONFIG", str(asset_of_the_pages(tmp_path)))
    start, trial = blocks(ABOVE_NAV2, "console")
    program, *options = start.split()
    assert program == ".venv/bin/rover-executive"
    _, simulated, substitute, executed = trial.strip().splitlines()
    assert executed == start.strip()
    assert simulated == " ".join((".venv/bin/rover-sim", *options, "--world flat"))
    server = f".venv/bin/python -m {NavigationServer.__module__} --stamped --odometry {ODOMETRY}"
    assert substitute == server  # here it serves on a thread
    navigation = Navigation()
    with (
        simulation(tmp_path, *options, "--camera", "off"),
        navigation_served(navigation) as node,
        executive(tmp_path, *options) as (_, uri),
    ):
        until_located(uri)
        monkeypatch.setenv("ROVER_URI", uri)
        above_nav2(Desk(tmp_path, {}), navigation)
        from_ros(Terminal(node))
