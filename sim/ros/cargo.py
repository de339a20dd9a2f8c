"""The ROS topic that sets the cargo of a simulated rover, kg: its publisher and subscriber."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rclpy.node import Node
from std_msgs.msg import Float64

from adapters.ros import Topic, declare_optional_topic, ros_node
from executive.core.recording import CargoChanged, RecordingSink
from sim.rover.body import SimulatedBody

_LOG: Final = logging.getLogger(__name__)


def declare_cargo(node: Node) -> Topic | None:
    """Declare and read the parameters of the optional topic.

    Raises:
        adapters.ros.parameters.ParameterError: named, and a parameter is missing or invalid.
    """
    return declare_optional_topic(node, "cargo", "cargo of a simulated rover, kg", Float64)


def serve_cargo(node: Node, rover: SimulatedBody, tape: RecordingSink) -> None:
    """Load the rover with received masses; an invalid one is logged and ignored."""

    def on_mass(message: Float64) -> None:
        try:
            rover.set_cargo_mass(message.data)
        except ValueError as error:
            _LOG.warning("%s", error)
        else:
            _LOG.info("cargo aboard: %g kg", message.data)
            tape.put(CargoChanged(rover.time_s, message.data))

    topic = declare_cargo(node)
    if topic is not None:
        node.create_subscription(Float64, topic.name, on_mass, topic.qos)


DISCOVERY_S: Final = 20.0
_GLANCE_S: Final = 0.02


@contextmanager
def cargo_publisher(asset: str, domain: int, parameters: Path) -> Iterator[Callable[[float], None]]:
    """Yield a function that sets the cargo of a simulated rover, kg, once that is subscribed.

    Raises:
        TimeoutError: no simulation is subscribed, or the asset has no topic for cargo.
    """
    with ros_node("cargo", asset, parameters=parameters, domain_id=domain) as node:
        topic = declare_cargo(node)
        if topic is None:
            raise TimeoutError(f"{parameters} names no topic for cargo")
        publisher = node.create_publisher(Float64, topic.name, topic.qos)
        end_s = time.monotonic() + DISCOVERY_S
        while not publisher.get_subscription_count():
            if time.monotonic() > end_s:
                raise TimeoutError(f"no subscriber to cargo within {DISCOVERY_S:.0f} s")
            time.sleep(_GLANCE_S)
        yield lambda mass_kg: publisher.publish(Float64(data=mass_kg))
