"""Who else publishes a topic, from the ROS graph."""

from rclpy.node import Node


def foreign_publishers(node: Node, topic: str) -> tuple[str, ...]:
    """Return the full names of the nodes that publish a topic beside this node, sorted.

    One publisher of this node's own name is ours; a second one is another process under our name,
    and counts. A process that was killed stays in the graph for up to 20 s.
    """
    own = (node.get_namespace(), node.get_name())
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    names = [(info.node_namespace, info.node_name) for info in infos]
    if own in names:
        names.remove(own)
    return tuple(sorted(f"{namespace.rstrip('/')}/{name}" for namespace, name in names))
