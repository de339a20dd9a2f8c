"""`TreeSubscriber` receives an executive's tree from its ROS topic; `show_live` displays it."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Final

from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy
from std_msgs.msg import String

from adapters.ros.context import ros_node, single_threaded
from adapters.ros.tree_topic import from_json, tree_qos
from trees import TreeSnapshot
from trees.screen import Screen, show_once

SNAPSHOT_TIMEOUT_S: Final = 5.0
POLL_S: Final = 0.2
"""Maximum delay of a Ctrl-C."""


class TreeSubscriber:
    """Subscribes to the tree of one executive.

    Args:
        executor: serves the node; spun here.
        prefix: name of the executive for display.
        start: advice to the operator if no snapshot is received.
    """

    def __init__(self, executor: SingleThreadedExecutor, prefix: str, start: str) -> None:
        self._executor = executor
        self._sender = prefix
        self._start = start
        self._newest: TreeSnapshot | None = None

    def on_snapshot(self, message: String) -> None:
        """Process a message."""
        self._newest = from_json(message.data)

    def next(self) -> TreeSnapshot:
        """Wait for the next snapshot.

        Raises:
            ConnectionError: none was received in time.
        """
        deadline_s = monotonic() + SNAPSHOT_TIMEOUT_S
        while self._newest is None:
            left_s = deadline_s - monotonic()
            if left_s <= 0:
                raise ConnectionError(f"no message from {self._sender}. {self._start}")
            self._executor.spin_once(timeout_sec=min(left_s, POLL_S))
        snapshot, self._newest = self._newest, None
        return snapshot


def show_one(asset: str, domain_id: int) -> None:
    """Print one snapshot.

    Raises:
        ConnectionError: no snapshot is received.
    """
    with _listening(asset, domain_id) as listener:
        show_once(asset, listener.next())


def show_live(asset: str, domain_id: int) -> None:
    """Draw each snapshot over the last, until KeyboardInterrupt; in a pipe, one after the other.

    Raises:
        ConnectionError: no snapshot is received, or no further one.
    """
    with _listening(asset, domain_id) as listener:
        first = listener.next()
        with Screen(asset) as screen:
            screen.show(first)
            while True:
                screen.show(listener.next())


@contextmanager
def _listening(asset: str, domain_id: int) -> Iterator[TreeSubscriber]:
    with ros_node("watch", asset, domain_id=domain_id) as node, single_threaded(node) as executor:
        listener = TreeSubscriber(
            executor,
            f"an executive of {asset} on ROS domain {domain_id}",
            f"Start one with `rover-executive --asset {asset}`, or `rover demo --stay`",
        )
        node.create_subscription(
            String,
            f"/{asset}/executive/tree",
            listener.on_snapshot,
            tree_qos(DurabilityPolicy.VOLATILE),
        )
        yield listener
