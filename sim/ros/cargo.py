"""The topic by which a simulated rover is loaded: a mass, in place of the one before. Both ends."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rclpy.node import Node
from std_msgs.msg import Float64

from adapters.ros import Topic, declare_optional_topic, ros_node
from sim.rover.body import SimulatedBody

_LOG: Final = logging.getLogger(__name__)


def declare_cargo(node: Node) -> Topic | None:
    """Declare and read the parameters of the topic, which an asset need not have.

    Raises:
        adapters.ros.parameters.ParameterError: it has one, and a parameter is missing or wrong.
    """
    meaning = "std_msgs/Float64, what a simulated rover carries, kg"
    return declare_optional_topic(node, "cargo", meaning)


def serve_cargo(node: Node, rover: SimulatedBody) -> None:
    """Load the rover as the topic says; a figure that is no mass is logged and ignored."""

    def on_mass(message: Float64) -> None:
        try:
            rover.load(message.data)
        except ValueError as error:
            _LOG.warning("%s", error)
        else:
            _LOG.info("cargo aboard: %g kg", message.data)

    topic = declare_cargo(node)
    if topic is not None:
        node.create_subscription(Float64, topic.name, on_mass, topic.qos)


DISCOVERY_S: Final = 20.0
_GLANCE_S: Final = 0.02


@contextmanager
def loading(asset: str, domain: int, parameters: Path) -> Iterator[Callable[[float], None]]:
    """Yield what gives a simulated rover a cargo, in kg, once that listens.

    Raises:
        TimeoutError: no simulation listens, or the asset has no topic for cargo.
    """
    with ros_node("cargo", asset, parameters=parameters, domain_id=domain) as node:
        topic = declare_cargo(node)
        if topic is None:
            raise TimeoutError(f"{parameters} names no topic for cargo")
        publisher = node.create_publisher(Float64, topic.name, topic.qos)
        end_s = time.monotonic() + DISCOVERY_S
        while not publisher.get_subscription_count():
            if time.monotonic() > end_s:
                raise TimeoutError(f"nobody heard of cargo within {DISCOVERY_S:.0f} s")
            time.sleep(_GLANCE_S)
        yield lambda mass_kg: publisher.publish(Float64(data=mass_kg))
