"""`Transforms` of tf2 (REP 105) as facts: odometry, and the odometry frame's pose in the map.

Only direct transforms are used: `odom` to `base_link`, and `map` to `odom`.
"""

from collections.abc import Callable
from functools import partial
from math import cos, inf, sin
from typing import Any, Final

from geometry_msgs.msg import Point, TransformStamped
from geometry_msgs.msg import Pose as PoseMessage
from rclpy.node import Node
from rclpy.qos import QoSProfile

from adapters.ros.conversions import (
    BASE_LINK,
    ODOM,
    IgnoredMessageError,
    MessageError,
    Precision,
    pose_of,
    round_measurement,
    stamp_s,
)
from adapters.ros.parameters import (
    NO_TF2_MSGS,
    TF_MESSAGE,
    ParameterError,
    Topic,
    declare_optional_text,
)
from adapters.ros.robot_model import TF, TF_STATIC, latched_qos
from adapters.ros.subscription import TopicSubscription
from executive.values.facts import MapToOdom, Odometry
from executive.values.geometry import Pose, TargetFrame, Velocity, wrap_rad

MAX_STEP_S: Final = 1.0
"""Maximum time between two transforms that give a velocity."""
DEPTH: Final = 100
Contain = Callable[[Callable[..., None]], Callable[..., None]]


class Transforms:
    """Makes odometry of transforms, and observes that of the map if the file names its frame.

    Args:
        node: declares the names of the frames, and subscribes.
        observe: called at a poll with the newest transform of the map; a static one each time.
        contained: returns a callback without exceptions.

    Attributes:
        map_to_odom: pose of the odometry frame in the map by the newest transform, or None.

    Raises:
        ParameterError: ROS has no tf2_msgs.
    """

    def __init__(
        self, node: Node, observe: Callable[[MapToOdom], None], contained: Contain
    ) -> None:
        self._map, self._odom, self._base_link = frame_names(node)
        self._observe = observe
        self._last_s, self._last = -inf, Pose()
        self.map_to_odom: Pose | None = None
        self._received = self._static = False
        self.subscriptions: list[TopicSubscription] = []
        if not self._map:
            return
        if TF_MESSAGE is None:
            raise ParameterError(f"parameter frames.map is {self._map!r}: {NO_TF2_MSGS}")
        qos = QoSProfile(depth=DEPTH)  # type: ignore[no-untyped-call]
        for topic, static in (
            (Topic(TF, TF_MESSAGE, qos, follows=True), False),
            (Topic(TF_STATIC, TF_MESSAGE, latched_qos(DEPTH)), True),
        ):
            callback = contained(partial(self._on_map, static))
            self.subscriptions.append(TopicSubscription(node, topic, callback, polled=True))

    @property
    def target_frames(self) -> dict[str, TargetFrame]:
        """The frames of targets by their names here; without a name there is no map."""
        named = {self._map: TargetFrame.MAP, self._odom: TargetFrame.ODOM}
        return {name: frame for name, frame in named.items() if name}

    def of_base(self, receive: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback for TFMessages that passes on each transform of base_link."""

        def on_message(message: Any) -> None:
            for each in _between(self._odom, self._base_link, message):
                receive(each)

        return on_message

    def odometry(self, transform: TransformStamped) -> Odometry:
        """Return the odometry of a transform; its velocity is that since the last one.

        Raises:
            MessageError: it is not finite, no rotation, or gives no velocity, as the first.
        """
        now_s, pose = stamp_s(transform.header.stamp), _pose(transform)
        (last_s, last), (self._last_s, self._last) = (self._last_s, self._last), (now_s, pose)
        step_s = now_s - last_s
        if not 0.0 < step_s <= MAX_STEP_S:
            raise IgnoredMessageError("its stamps do not advance by up to 1 s")
        turn_rad = wrap_rad(pose.heading_rad - last.heading_rad)
        along_rad = last.heading_rad + turn_rad / 2
        ahead_m = (pose.x_m - last.x_m) * cos(along_rad) + (pose.y_m - last.y_m) * sin(along_rad)
        travel_mps, rotate_radps = (
            round_measurement(each / step_s, Precision.SPEED) for each in (ahead_m, turn_rad)
        )
        return Odometry(now_s, pose, Velocity(travel_mps, rotate_radps))

    def poll(self) -> None:
        """Observe the newest transform of the map, if one was received."""
        for each in self.subscriptions:
            each.poll()
        if self.map_to_odom is not None and (self._received or self._static):
            self._received = False
            self._observe(MapToOdom(self.map_to_odom))

    def _on_map(self, static: bool, message: Any) -> None:
        for each in _between(self._map, self._odom, message):
            self.map_to_odom, self._received, self._static = _pose(each), True, static


def frame_names(node: Node) -> tuple[str, str, str]:
    """Declare and read the names of the frames: map, empty if the file has none, odom, base_link.

    Raises:
        ParameterError: one is not a text.
    """
    found = []
    for name, default in (("map", ""), ("odom", ODOM), ("base_link", BASE_LINK)):
        key = f"frames.{name}"
        if node.has_parameter(key):
            text = str(node.get_parameter_or(key).value or "")
        else:
            text = declare_optional_text(node, key, f"frame {name}")
        found.append(text or default)
    return found[0], found[1], found[2]


def _between(parent: str, child: str, message: Any) -> list[TransformStamped]:
    pairs = ((each, each.header.frame_id, each.child_frame_id) for each in message.transforms)
    return [each for each, *frames in pairs if frames == [parent, child]]


def _pose(transform: TransformStamped) -> Pose:
    moved = transform.transform
    at = Point(x=moved.translation.x, y=moved.translation.y, z=moved.translation.z)
    pose = pose_of(PoseMessage(position=at, orientation=moved.rotation))
    if not pose.finite:
        raise MessageError(f"transform of {transform.child_frame_id} is not finite")
    return pose
