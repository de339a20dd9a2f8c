"""`python -m tests.benchmarks.stop_witness`: says when the rover is commanded to stand, and stands.

Each line is a change and its time by `time.perf_counter`, which all processes of a computer share.
With the argument `every` so is each velocity commanded, whether it changes anything or not.
"""

import sys
import time
from typing import Final

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry

from adapters.ros import declare_topics, ros_node, single_threaded
from executive.settings import config_folder

WATCHES: Final = "watches"
EVERY: Final = "every"
ZERO, DRIVEN, STATIONARY, MOVES, ROLLS = "zero", "driven", "stands", "moves", "rolls"
STILL_MPS: Final = 0.02
STILL_RADPS: Final = 0.02
ROLLS_MPS: Final = 0.4
"""From which on it rolls: a stop is to meet it at speed."""


class Changes:
    """Prints a word whenever it is another one than before, or each time."""

    def __init__(self, every: bool = False) -> None:
        self._last, self._every = "", every

    def are(self, word: str) -> None:
        if self._every or word != self._last:
            print(word, time.perf_counter(), flush=True)
            self._last = word


def main() -> None:
    parameters = config_folder() / "jackal.ros.yaml"
    with ros_node("witness", "jackal", parameters=parameters) as node:
        topics = declare_topics(node)
        commanded, true = Changes(EVERY in sys.argv), Changes()

        def receive(message: TwistStamped) -> None:
            twist = message.twist
            commanded.are(DRIVEN if twist.linear.x or twist.angular.z else ZERO)

        def see(odometry: Odometry) -> None:
            speed = odometry.twist.twist
            if abs(speed.linear.x) < STILL_MPS and abs(speed.angular.z) < STILL_RADPS:
                true.are(STATIONARY)
            elif speed.linear.x > ROLLS_MPS:
                true.are(ROLLS)
            else:
                true.are(MOVES)

        for kind, topic, take in (
            (TwistStamped, topics.cmd_vel, receive),
            (Odometry, topics.ground_truth, see),
        ):
            assert topic is not None
            node.create_subscription(kind, topic.name, take, topic.qos)
        print(WATCHES, flush=True)
        with single_threaded(node) as executor:
            while True:
                executor.spin_once()


if __name__ == "__main__":
    main()
