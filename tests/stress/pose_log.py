"""`python -m tests.stress.pose_log`: prints where the rover truly is, a line for each pose."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from nav_msgs.msg import Odometry

from adapters.ros import conversions, declare_topics, ros_node, single_threaded
from executive.settings import config_folder


@dataclass(frozen=True, slots=True)
class TruePose:
    """Where base_link was at a time of this computer's clock, UTC."""

    utc_s: float
    x_m: float
    y_m: float
    heading_rad: float


def read_poses(path: Path) -> list[TruePose]:
    """Return what a log tells, but for a last line that is not whole."""
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    return [TruePose(*map(float, line.split())) for line in lines]


def main(asset: str) -> None:
    parameters: Path = config_folder() / f"{asset}.ros.yaml"
    with (
        ros_node("observer", asset, parameters=parameters) as node,
        single_threaded(node) as executor,
    ):
        topic = declare_topics(node).ground_truth
        assert topic is not None

        def see(message: Odometry) -> None:
            pose = conversions.odometry_fact(message).pose
            line = f"{time.time():.4f} {pose.x_m:.5f} {pose.y_m:.5f} {pose.heading_rad:.5f}"
            print(line, flush=True)

        node.create_subscription(Odometry, topic.name, see, topic.qos)
        while True:
            executor.spin_once()


if __name__ == "__main__":
    main(*sys.argv[1:])
