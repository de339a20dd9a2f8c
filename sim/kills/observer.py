"""`python -m sim.kills.observer`: prints where the rover truly is, a line a sighting."""

import sys
from pathlib import Path

from nav_msgs.msg import Odometry

from adapters.ros import conversions
from adapters.ros.context import ros_node, single_threaded
from adapters.ros.parameters import declare_topics
from executive.settings import config_folder
from sim.kills.sightings import line_of


def main(asset: str) -> None:
    """Print for ever."""
    parameters: Path = config_folder() / f"{asset}.ros.yaml"
    with (
        ros_node("observer", asset, parameters=parameters) as node,
        single_threaded(node) as executor,
    ):
        topic = declare_topics(node).ground_truth

        def see(message: Odometry) -> None:
            print(line_of(conversions.odometry(message).pose), flush=True)

        node.create_subscription(Odometry, topic.name, see, topic.qos)
        while True:
            executor.spin_once()


if __name__ == "__main__":
    main(*sys.argv[1:])
