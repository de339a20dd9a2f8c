"""ROS 2: rclpy lives here and in the simulation; the executive's node is beside this face."""

from adapters.ros.context import ros_node, single_threaded, steady_timer, subscribers_of
from adapters.ros.conversions import (
    MessageError,
    battery_message,
    odometry_fact,
    odometry_message,
    stamp_s,
    time_message,
)
from adapters.ros.diagnostics import diagnostic_array
from adapters.ros.heartbeat import HeartbeatMonitor, publish_heartbeat, watch
from adapters.ros.parameters import (
    ParameterError,
    Topic,
    Topics,
    declare_optional_topic,
    declare_rate,
    declare_topic,
    declare_topics,
    declare_value,
)
from adapters.ros.rover import (
    LOCK_QOS,
    MuxOnRos,
    RosAsset,
    RosCamera,
    RosFrames,
    RosMotionRover,
    RosRover,
    RosVelocityRover,
    Subscribe,
)

__all__ = [
    "LOCK_QOS",
    "HeartbeatMonitor",
    "MessageError",
    "MuxOnRos",
    "ParameterError",
    "RosAsset",
    "RosCamera",
    "RosFrames",
    "RosMotionRover",
    "RosRover",
    "RosVelocityRover",
    "Subscribe",
    "Topic",
    "Topics",
    "battery_message",
    "declare_optional_topic",
    "declare_rate",
    "declare_topic",
    "declare_topics",
    "declare_value",
    "diagnostic_array",
    "odometry_fact",
    "odometry_message",
    "publish_heartbeat",
    "ros_node",
    "single_threaded",
    "stamp_s",
    "steady_timer",
    "subscribers_of",
    "time_message",
    "watch",
]
