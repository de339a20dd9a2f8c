"""The gate of a navigation's velocity on ROS: a lock of the mux, or the executive's relay."""

import time
from collections.abc import Callable
from dataclasses import replace
from math import nan
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from geometry_msgs.msg import TwistStamped
from std_msgs.msg import Bool

from adapters.ros import (
    LOCK_QOS,
    NavigatedRosRover,
    ParameterError,
    Topic,
    declare_topics,
    ros_node,
)
from adapters.ros.rover import PolledRover
from executive.commands import Mode
from executive.settings import (
    MuxEntry,
    NavigationGate,
    NavigationSettings,
    Settings,
    config_folder,
    load_settings,
)
from executive.values.clock import SystemClock
from executive.values.facts import Fact, ForeignMuxInput, NavigationVelocity
from executive.values.geometry import Velocity
from tests.ros.test_navigation_client import LIMIT_S
from tests.ros.test_node import started

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("ros_domain", "nav2_msgs")]

PARAMETERS = config_folder() / "jackal.ros.yaml"
LOCKED = NavigationSettings(NavigationGate.LOCK, "navigation", "navigation")


def gated(navigation: NavigationSettings) -> Settings:
    """Return a Jackal with a navigation, and its input and lock in the mux."""
    jackal = load_settings("jackal")
    mux = jackal.mux
    assert mux is not None
    raised = {
        name: replace(each, priority=max(2, each.priority)) for name, each in mux.topics.items()
    }
    topics = {**raised, "navigation": MuxEntry("nav_vel", 0.5, 1)}
    locks = {**mux.locks, "navigation": MuxEntry("navigation_lock", 0.1, 2)}
    return replace(jackal, mux=replace(mux, topics=topics, locks=locks), navigation=navigation)


def until(done: Callable[[], bool], what: str) -> None:
    deadline_s = time.monotonic() + LIMIT_S
    while not done():
        assert time.monotonic() < deadline_s, f"waited in vain: {what}"
        time.sleep(0.005)


def taken(subscription: Any, kind: type) -> list[Any]:
    """Return the messages that wait."""
    found = []
    with subscription.handle:
        while (message := subscription.handle.take_message(kind, False)) is not None:
            found.append(message[0])
    return found


def test_the_lock_is_opened_by_the_executive_and_shut_by_a_stop_from_any_thread() -> None:
    with (
        ros_node("executive", "jackal", parameters=PARAMETERS) as node,
        ros_node("twist_mux", "jackal") as mux,
    ):
        lock = mux.create_subscription(Bool, "navigation_lock", lambda _: None, LOCK_QOS)
        rover = NavigatedRosRover(node, declare_topics(node), SystemClock(), gated(LOCKED))
        until(lambda: bool(lock.get_publisher_count()), "the lock is found")
        until(lambda: bool(node.count_subscribers(lock.topic_name)), "the mux is found")
        received: list[bool] = []

        def shut() -> bool:
            received.extend(each.data for each in taken(lock, Bool))
            return received[-1:] == [True]

        def is_open() -> bool:
            rover.open_gate(True)
            shut()
            return received[-1:] == [False]

        until(is_open, "it is open")
        stop = Thread(target=rover.emergency_stop)
        stop.start()
        stop.join()
        until(shut, "a stop shuts it")
        until(is_open, "it is open again")
        rover.stop()
        until(shut, "the end of the executive shuts it")
        assert rover.flush(1.0)


def test_the_navigation_is_no_foreign_input_of_the_mux() -> None:
    facts: list[Fact] = []
    subscribed: list[str] = []

    def subscribe(topic: Topic, _: object) -> None:
        subscribed.append(topic.name)

    with (
        ros_node("executive", "jackal", parameters=PARAMETERS) as node,
        ros_node("navigation", "jackal") as other,
    ):
        rover = NavigatedRosRover(node, declare_topics(node), SystemClock(), gated(LOCKED))
        rover.subscribe(subscribe, facts.append)
        assert isinstance(rover, PolledRover)
        assert subscribed == ["executive/cmd_vel", "joy_teleop/cmd_vel", "cmd_vel"]
        velocity = other.create_publisher(TwistStamped, "nav_vel", 1)

        def received() -> bool:
            message = TwistStamped()
            message.twist.linear.x = 0.25
            velocity.publish(message)
            rover.poll(None)
            return bool(facts)

        until(received, "its velocity")
        assert facts[0] == NavigationVelocity(Velocity(0.25, 0.0))
        assert not any(isinstance(each, ForeignMuxInput) for each in facts)


def test_a_relay_of_the_own_topic_is_refused() -> None:
    own = ("-p", "navigation.velocity.topic:=executive/cmd_vel")
    settings = gated(NavigationSettings(NavigationGate.RELAY))
    with ros_node("executive", "jackal", parameters=PARAMETERS, ros_arguments=own) as node:
        rover = NavigatedRosRover(node, declare_topics(node), SystemClock(), settings)
        with pytest.raises(ParameterError, match=r"executive's own topic \(cmd_vel.topic\)"):
            rover.subscribe(lambda *_: None, lambda _: None)


def test_a_velocity_that_is_not_finite_is_rejected_and_the_gate_stays_shut(tmp_path: Path) -> None:
    with started(tmp_path, 0.05, asset=gated(LOCKED)) as bench:
        locked: list[Bool] = []
        bench.rover.create_subscription(Bool, "navigation_lock", locked.append, LOCK_QOS)
        velocity = bench.rover.create_publisher(TwistStamped, "nav_vel", 10)
        message = TwistStamped()
        message.twist.linear.x = nan
        bench.until(lambda: bool(velocity.get_subscription_count()), "its subscription")
        bench.until(lambda: bool(locked), "the lock")

        def ticked() -> bool:
            velocity.publish(message)
            return len(locked) > ticks + 20

        ticks = len(locked)
        bench.until(ticked, "ticks")
        assert all(each.data for each in locked)
        assert bench.executive.mode is Mode.IDLE
