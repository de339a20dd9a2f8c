"""Bags of a robot in each format, written from facts and velocity commands."""

from collections.abc import Iterable, Mapping
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from executive.values.facts import Odometry
from executive.values.geometry import Velocity

ODOMETRY, TWIST = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist"
BEGIN_S = 1_700_000_000.0
Arrivals = Iterable[tuple[float, Odometry | Velocity]]


def write_bag(folder: Path, kind: str, topics: Mapping[str, Arrivals]) -> Path:
    """Write a bag: mcap, db3 or (ROS 1) bag. The stamps of facts are on the clock of arrival."""
    ros1 = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    path = folder / f"drive.{kind}"
    plugin = StoragePlugin.SQLITE3 if kind == "db3" else StoragePlugin.MCAP
    writer: Any = Ros1Writer(path) if ros1 else Writer(path, version=9, storage_plugin=plugin)
    with writer as opened:
        for topic, arrivals in topics.items():
            connection = None
            for at_s, value in arrivals:
                of_odometry = isinstance(value, Odometry)
                name = ODOMETRY if of_odometry else TWIST
                make = _odometry if of_odometry else _twist
                message = make(store.types, value, (0,) if ros1 else ())
                connection = connection or opened.add_connection(topic, name, typestore=store)
                octets = (store.serialize_ros1 if ros1 else store.serialize_cdr)(message, name)
                opened.write(connection, round((BEGIN_S + at_s) * 1e9), octets)
    return path


def _twist(types: Any, velocity: Any, _: Any) -> Any:
    vector = types["geometry_msgs/msg/Vector3"]
    return types[TWIST](
        vector(velocity.travel_mps, 0.0, 0.0), vector(0.0, 0.0, velocity.rotate_radps)
    )


def _odometry(types: Any, fact: Any, extra: tuple[int, ...]) -> Any:
    stamp_s, pose, half_rad = BEGIN_S + fact.stamp_s, fact.pose, fact.pose.heading_rad / 2
    time = types["builtin_interfaces/msg/Time"](int(stamp_s), int(stamp_s % 1 * 1e9))
    return types[ODOMETRY](
        types["std_msgs/msg/Header"](*extra, time, "odom"),
        "base_link",
        types["geometry_msgs/msg/PoseWithCovariance"](
            types["geometry_msgs/msg/Pose"](
                types["geometry_msgs/msg/Point"](pose.x_m, pose.y_m, 0.0),
                types["geometry_msgs/msg/Quaternion"](0.0, 0.0, sin(half_rad), cos(half_rad)),
            ),
            np.zeros(36),
        ),
        types["geometry_msgs/msg/TwistWithCovariance"](
            _twist(types, fact.velocity, extra), np.zeros(36)
        ),
    )
