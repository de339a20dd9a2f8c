"""ROS topics for the items that a simulation adds to the recording of an executive.

The last items are latched: the recording of an executive that is restarted has them, too.
"""

import json
import logging
from dataclasses import replace
from typing import Any, Final

from rclpy.node import Node
from std_msgs.msg import String

from adapters.recording import TOPICS, decode, plain_of, topic_of
from adapters.ros.robot_model import latched_qos
from executive.core.recording import Item, RecordingSink, SimulationItem, SimulationState
from executive.values.clock import Clock

_LOG: Final = logging.getLogger(__name__)
_LATCHED, _STATE = "simulation/items", "simulation/state"
_DEPTH: Final = 200
"""Latched items; more changes of faults and cargo lose the first one, the world; chosen."""


class SimulationItemPublisher:
    """Publishes the items of a simulation."""

    def __init__(self, node: Node) -> None:
        self._latched = node.create_publisher(String, _LATCHED, latched_qos(_DEPTH))
        self._state = node.create_publisher(String, _STATE, 1)

    @property
    def records_state(self) -> bool:
        """Whether an executive records checkpoints."""
        return self._state.get_subscription_count() > 0

    def put(self, item: Item) -> None:
        """Publish an item; a checkpoint is not latched."""
        publisher = self._state if isinstance(item, SimulationState) else self._latched
        publisher.publish(String(data=json.dumps([topic_of(item).name, plain_of(item)])))


def record_simulation(node: Node, tape: RecordingSink, clock: Clock) -> None:
    """Add the items of a simulation to a recording, with the time of their reception.

    An invalid one is logged and ignored.
    """

    def on_item(message: Any) -> None:
        try:
            name, plain = json.loads(message.data)
            item = decode(TOPICS[name], json.dumps(plain).encode())
            if not isinstance(item, SimulationItem):
                raise TypeError(f"{name} is no item of a simulation")
        except Exception as error:  # cattrs raises groups of many kinds
            _LOG.warning("an item of the simulation is not recorded: %r", error)
        else:
            tape.put(replace(item, time_s=clock.now_s()))

    node.create_subscription(String, _LATCHED, on_item, latched_qos(_DEPTH))
    node.create_subscription(String, _STATE, on_item, 1)
