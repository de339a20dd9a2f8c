"""The topic by which a simulated rover is laden: a mass, in place of the one before."""

import logging
from typing import Final

from rclpy.node import Node
from std_msgs.msg import Float64

from adapters.ros.parameters import Topic, declare_optional_topic
from sim.body import SimulatedBody

_LOG: Final = logging.getLogger(__name__)


def declare_cargo(node: Node) -> Topic | None:
    """Declare and read the parameters of the topic, which an asset need not have.

    Raises:
        adapters.ros.parameters.ParameterError: it has one, and a parameter is missing or wrong.
    """
    meaning = "std_msgs/Float64, what a simulated rover carries, kg"
    return declare_optional_topic(node, "cargo", meaning)


def serve_cargo(node: Node, rover: SimulatedBody) -> None:
    """Lade a rover as the topic says; what is no mass is told in one line and left."""

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
