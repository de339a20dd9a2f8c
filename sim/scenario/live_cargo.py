"""Cargo in a live run: the simulation is told by its topic."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from std_msgs.msg import Float64

from adapters.ros.context import ros_node
from sim.ros_cargo import declare_cargo

DISCOVERY_S: Final = 20.0
_GLANCE_S: Final = 0.02


@contextmanager
def loading(asset: str, domain: int, parameters: Path) -> Iterator[Callable[[float], None]]:
    """Yield what gives a simulated rover a cargo, in kg, once that listens.

    Args:
        asset: the rover's name, which is its ROS namespace.
        domain: ROS domain id.
        parameters: the ROS parameter file that names the topics.

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
