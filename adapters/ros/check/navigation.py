"""`check_navigation`: the action servers, velocity and lock of a navigation that runs."""

import time
from collections.abc import Iterator
from typing import Any, Final

from rclpy.action.graph import get_action_names_and_types
from rclpy.node import Node
from rclpy.type_support import check_for_type_support

from adapters.ros.check.check import asset_node
from adapters.ros.navigation import ACTIONS, FIELDS, RELATIVE
from adapters.ros.navigation_messages import action_type
from adapters.ros.parameters import declare_optional_text, declare_topics, type_name
from executive.settings import Settings, asset_file, load_yaml, ros_parameter_file

POLL_S: Final = 0.2


def check_navigation(
    asset: str, settings: Settings, namespace: str | None, seconds: float
) -> Iterator[tuple[bool, str, str]]:
    """Yield problems: whether it is certain to prevent drives, the text, and the remedy.

    Args:
        asset: its name or file.
        settings: of the asset, with a navigation.
        namespace: ROS namespace of the robot; None: the asset's name.
        seconds: time that the discovery has.
    """
    navigation, mux = settings.navigation, settings.mux
    assert navigation is not None
    actions = ACTIONS | RELATIVE[navigation.relative]
    file = ros_parameter_file(settings.asset, asset_file(asset).parent)
    raw: Any = load_yaml(file)
    known = {key: {"action", "type"} for key in actions} | {"velocity": {"topic"}}
    for each in raw.values():
        for key, values in each.get("ros__parameters", {}).get("navigation", {}).items():
            for name in sorted(set(values) - known.get(key, set())):
                keys = ", ".join(known.get(key, known))
                yield True, f"navigation.{key}.{name} of {file} is unknown: {keys}", ""
    with asset_node(asset, settings, namespace) as node:
        topics = declare_topics(node)
        velocity = declare_optional_text(node, "navigation.velocity.topic", "") or "nav_vel"
        lock = ""
        if mux is not None and navigation.input is not None and navigation.lock is not None:
            velocity = mux.topics[navigation.input].topic
            lock = node.resolve_topic_name(mux.locks[navigation.lock].topic)
        velocity = node.resolve_topic_name(velocity)
        servers: list[str] = []
        for key, (name, kind_name) in actions.items():
            given = declare_optional_text(node, f"navigation.{key}.action", "")
            servers.append(node.resolve_topic_name(given or name))
            parameter = f"navigation.{key}.type"
            kind_name = declare_optional_text(node, parameter, "") or kind_name
            kind = action_type(parameter, kind_name, FIELDS[key])
            if not isinstance(kind, str):
                # Raises if the package is of another ROS.
                check_for_type_support(kind)  # type: ignore[no-untyped-call]
        deadline_s = time.monotonic() + seconds
        while (
            problems := _absent(node, servers, velocity, lock)
        ) and time.monotonic() < deadline_s:
            time.sleep(POLL_S)
            problems = _absent(node, servers, velocity, lock)
        yield from problems
        wanted = type_name(topics.cmd_vel.type)
        for published in node.get_publishers_info_by_topic(velocity):
            if lock and published.topic_type != wanted:
                text = f"{published.node_name} publishes {published.topic_type} on {velocity}"
                yield True, f"{text}: the mux receives {wanted} (cmd_vel.type)", ""


def _absent(
    node: Node, servers: list[str], velocity: str, lock: str
) -> list[tuple[bool, str, str]]:
    served = {name for name, _ in get_action_names_and_types(node)}
    found = [
        (False, f"there is no action server {each}", "ros2 action list")
        for each in servers
        if each not in served
    ]
    if not node.count_publishers(velocity):
        found.append((False, f"no node publishes on {velocity}, the navigation's velocity", ""))
    if lock and not node.count_subscribers(lock):
        found.append((True, f"no mux subscribes to {lock}, the navigation's lock", ""))
    return found
