"""Where the brick is and what its strings are called, as ROS parameters of the node."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from rclpy.node import Node
from rclpy.parameter import Parameter

from adapters.nxt.brick import UsbAddress
from adapters.nxt.record import Link
from adapters.ros.parameters import ParameterError, Topic, declare_topic, declare_value

HIGHEST_PERIOD_S: Final = 3600.0
_USB: Final = {
    "vendor_id": ("the brick's vendor id", 0xFFFF),
    "product_id": ("the brick's product id", 0xFFFF),
    "interface": ("number of the interface that is claimed", 0xFF),
    "endpoint_out": ("address of the bulk endpoint to the brick", 0x7F),
    "endpoint_in": ("address of the bulk endpoint from the brick", 0xFF),
}


@dataclass(frozen=True, slots=True)
class NxtSettings:
    """What `config/mocup.nxt.yaml` says.

    Attributes:
        brick: its name in messages.
        address: where it is on USB.
        commands, notifications: topics of each link.
        relay_telemetry_s: how often telemetry goes to the relay at most.
    """

    brick: str
    address: UsbAddress
    commands: Mapping[Link, Topic]
    notifications: Mapping[Link, Topic]
    relay_telemetry_s: float


def declare_settings(node: Node) -> NxtSettings:
    """Declare and read the parameters.

    Raises:
        ParameterError: one is missing or wrong.
    """
    numbers = {key: _number(node, key) for key in _USB}
    return NxtSettings(
        declare_value(node, "brick", Parameter.Type.STRING, "the brick's name in messages"),
        UsbAddress(**numbers),
        {link: _strings(node, link, "command") for link in Link},
        {link: _strings(node, link, "notification") for link in Link},
        _period_s(node),
    )


def _number(node: Node, key: str) -> int:
    meaning, highest = _USB[key]
    name = f"usb.{key}"
    value = int(declare_value(node, name, Parameter.Type.INTEGER, meaning))
    if not 0 <= value <= highest:
        raise ParameterError(f"parameter {name} is {value:#x}: 0 to {highest:#x}")
    return value


def _period_s(node: Node) -> float:
    name = "relay_telemetry_s"
    meaning = "how often telemetry goes to the relay at most, s"
    value = float(declare_value(node, name, Parameter.Type.DOUBLE, meaning))
    if not 0.0 <= value <= HIGHEST_PERIOD_S:
        raise ParameterError(f"parameter {name} is {value}: 0 to {HIGHEST_PERIOD_S:g} s")
    return value


def _strings(node: Node, link: Link, what: str) -> Topic:
    meaning = f"std_msgs/String, MOPS {what}s of the {link.value} link"
    return declare_topic(node, f"{link.value}_{what}", meaning)
