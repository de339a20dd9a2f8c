"""`TreePublisher`: the behaviour tree on a ROS topic as JSON, only while there are subscribers."""

import json
from dataclasses import replace
from typing import Final

from cattrs.preconf.json import make_converter
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from executive.core.runner import Executive
from trees import TreeSnapshot, snapshot_of

TREE_TOPIC: Final = "~/tree"
REPEAT_S: Final = 1.0
_CONVERTER = make_converter()


def tree_qos(durability: DurabilityPolicy) -> QoSProfile:
    """Return the quality of service of the tree.

    The executive retains the last snapshot (TRANSIENT_LOCAL), as old as its last subscriber.
    Subscribers that need the present one only, which is sent within a second, use VOLATILE.
    """
    return QoSProfile(  # type: ignore[no-untyped-call]
        depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=durability
    )


def to_json(snapshot: TreeSnapshot) -> str:
    """Return a snapshot as JSON text."""
    return json.dumps(_CONVERTER.unstructure(snapshot), separators=(",", ":"))


def from_json(text: str) -> TreeSnapshot:
    """Return the snapshot in a text.

    Raises:
        ValueError: the text is not a snapshot.
    """
    try:
        return _CONVERTER.structure(json.loads(text), TreeSnapshot)
    except Exception as error:
        raise ValueError(f"no snapshot of a tree: {error}") from error


class TreePublisher:
    """Publishes a snapshot when the tree, the mode or the reason changed, and once a second."""

    def __init__(self, node: Node, executive: Executive) -> None:
        self._executive = executive
        self._publisher = node.create_publisher(
            String, TREE_TOPIC, tree_qos(DurabilityPolicy.TRANSIENT_LOCAL)
        )
        self._sent: TreeSnapshot | None = None

    def update(self, utc_s: float) -> None:
        """Publish a snapshot if it is due."""
        if self._publisher.get_subscription_count() == 0:
            self._sent = None
            return
        sent, snapshot = self._sent, snapshot_of(self._executive, utc_s)
        if (
            sent is not None
            and utc_s - sent.utc_s < REPEAT_S
            and replace(snapshot, tick=sent.tick, utc_s=sent.utc_s) == sent
        ):
            return
        self._publisher.publish(String(data=to_json(snapshot)))
        self._sent = snapshot
