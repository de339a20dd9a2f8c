"""The node's interface to a rover, and the rover that receives velocities on `cmd_vel`.

The latter includes the lock and the other inputs of its mux. docs/add-a-rover.md shows others.
"""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from math import inf
from typing import Any, Final, Protocol

from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Bool, Float64

from adapters.ros.parameters import ParameterError, Topic, Topics
from executive.record import Ledger
from executive.settings import MuxSettings, Settings
from executive.values.clock import Clock
from executive.values.facts import VELOCITY_TOPIC, Fact, OtherInput
from executive.values.geometry import STANDING, Velocity
from executive.values.ports import CameraIntent, DelegatedMotionRover, Downlink, VelocityRover

GUARD_NAME: Final = "executive_guard"
"""Node name of the process that stops the rover when the executive has ended."""
LOCK_QOS: Final = 10
"""Queue depth of the lock; reliable, as twist_mux subscribes."""
SENT: Final = 100
"""Number of own velocities recognised when they are received again: five seconds."""
NAME_UNKNOWN: Final = "_NODE_NAME_UNKNOWN_"
"""Node name that ROS gives for a publisher before its discovery is complete."""
GRAPH_REFRESH_S: Final = 1.0
"""Silence of a topic after which its publishers are queried again."""
Subscribe = Callable[[type, Topic, Callable[[Any], None]], None]
"""Subscribes a callback: message type, topic, callback for the messages."""


class RosAsset(Protocol):
    """A rover on ROS. Used on the executor's thread, except `emergency_stop`.

    Attributes:
        on_frame: called with each image while a frame is requested; set before the first request.
    """

    on_frame: Callable[[CompressedImage], None]

    def subscribe(self, subscribe: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Subscribe to the topics that only this kind of rover has."""

    def downlinks(self, ledger: Ledger) -> Sequence[Downlink]:
        """Return the downlinks of this kind of rover that receive reports."""

    def frame_taken(self) -> None:
        """Unsubscribe from the camera."""

    def stop(self) -> None:
        """Stop the rover, if the executive moves it."""

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last command has been received; return whether it was."""


class RosVelocityRover(RosAsset, VelocityRover, Protocol):
    """A rover on ROS that receives velocities."""


class RosMotionRover(RosAsset, DelegatedMotionRover, Protocol):
    """A rover on ROS that executes whole motions by itself."""


class RosFrames:
    """A camera that uses no bandwidth while no frame is requested.

    The subscription starts with a request and ends with the frame that answers it.

    Attributes:
        on_frame: called with each image while a frame is requested; set before the first request.
    """

    on_frame: Callable[[CompressedImage], None]

    def __init__(self, node: Node, image: Topic) -> None:
        self._node = node
        self._image = image
        self._frames: Subscription | None = None

    def downlinks(self, ledger: Ledger) -> Sequence[Downlink]:
        """Return none: no part of this rover needs reports."""
        return ()

    def request_frame(self) -> None:
        """Subscribe to the camera until `frame_taken`."""
        if self._frames is None:
            self._frames = self._node.create_subscription(
                CompressedImage, self._image.name, self.on_frame, self._image.qos
            )

    def lock(self, held: bool) -> None:
        """Ignore the lock: this rover has no mux."""

    def frame_taken(self) -> None:
        """Unsubscribe from the camera."""
        if self._frames is not None:
            self._node.destroy_subscription(self._frames)
            self._frames = None


class RosCamera(RosFrames):
    """Publishes the camera's set point, and receives frames on request."""

    def __init__(self, node: Node, topics: Topics) -> None:
        super().__init__(node, topics.camera_compressed)
        pan, tilt, speed = topics.camera_pan, topics.camera_tilt, topics.camera_speed
        self._pan = node.create_publisher(Float64, pan.name, pan.qos)
        self._tilt = node.create_publisher(Float64, tilt.name, tilt.qos)
        self._speed = node.create_publisher(Float64, speed.name, speed.qos)

    def point_camera(self, wanted: CameraIntent) -> None:
        """Publish the camera's maximum speed and its angles."""
        self._speed.publish(Float64(data=wanted.speed_radps))
        self._pan.publish(Float64(data=wanted.pan_rad))
        self._tilt.publish(Float64(data=wanted.tilt_rad))


class RosMux:
    """The executive's side of a mux in front of the base: holds its lock, monitors other inputs.

    While the lock is held, zero is published on the input for stops, if the mux has one: a base
    that receives nothing would move on until its own timeout.

    Args:
        node: creates the topics.
        velocity: the executive's velocity topic.
        settings: settings of the mux.
        clock: the core's clock.

    Raises:
        ParameterError: the executive's velocity topic differs from its input of the mux.
    """

    def __init__(self, node: Node, velocity: Topic, settings: MuxSettings, clock: Clock) -> None:
        own = settings.topics[settings.input]
        if node.resolve_topic_name(own.topic) != node.resolve_topic_name(velocity.name):
            raise ParameterError(
                f"parameter cmd_vel.topic is {velocity.name}, but the executive's input of the mux,"
                f" {settings.input}, has the topic {own.topic}: make them the same, or leave the"
                " section mux out of the asset's settings if there is no mux"
            )
        self._node, self._settings, self._clock = node, settings, clock
        self._qos = velocity.qos
        self._lock = node.create_publisher(Bool, settings.locks[settings.lock].topic, LOCK_QOS)
        stop = None if settings.stop is None else settings.topics[settings.stop].topic
        self._stop = None if stop is None else node.create_publisher(Twist, stop, velocity.qos)

    def listen(self, subscribe: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Report velocities on other inputs to the core."""
        above = self._settings.topics[self._settings.input].priority
        for name, entry in self._settings.topics.items():
            if name not in (self._settings.input, self._settings.stop):
                publishers = _Publishers(self._node, self._clock, entry.topic)
                on_velocity = partial(
                    _mux_input_observer, observe, name, entry.priority > above, publishers
                )
                subscribe(Twist, Topic(entry.topic, self._qos), on_velocity)

    def hold(self, held: bool) -> None:
        """Publish the lock, held or not: the guard of an earlier executive may have locked it."""
        self._lock.publish(Bool(data=held))
        if held:
            self._zero()

    def lock(self) -> None:
        """Lock the mux, from any thread; changes no state here."""
        self._zero()
        self._lock.publish(Bool(data=True))

    def _zero(self) -> None:
        if self._stop is not None:
            self._stop.publish(Twist())

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last lock has been received; return whether it was."""
        return self._lock.wait_for_all_acked(Duration(seconds=timeout_s))


class _Publishers:
    """Publishers of a topic, queried from the graph at its first message after a silence."""

    def __init__(self, node: Node, clock: Clock, topic: str) -> None:
        self._node, self._clock, self._topic = node, clock, topic
        self._last_message_s, self._names = -inf, ""

    def now(self) -> str:
        """Return the names, at a message."""
        now_s = self._clock.now_s()
        if now_s - self._last_message_s > GRAPH_REFRESH_S or not self._names:
            self._names = ", ".join(foreign_publishers(self._node, self._topic))
        self._last_message_s = now_s
        return self._names


def _mux_input_observer(
    observe: Callable[[Fact], None], name: str, above: bool, publishers: _Publishers, _: Twist
) -> None:
    observe(OtherInput(name, above, publishers.now()))


def foreign_publishers(node: Node, topic: str) -> tuple[str, ...]:
    """Return the full names of the nodes that publish a topic besides this node, sorted.

    One publisher with this node's own name is its own. A second one is another process under the
    same name, and counts. All publishers of the guard are its own: a killed process stays in the
    graph for up to 20 s, next to its successor. A new publisher without a name is left out until
    its name is known.
    """
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    names = sorted(
        f"{each.node_namespace.rstrip('/')}/{each.node_name}"
        for each in infos
        if each.node_name != NAME_UNKNOWN
    )
    namespace = node.get_namespace().rstrip("/")
    if (own := f"{namespace}/{node.get_name()}") in names:
        names.remove(own)
    return tuple(each for each in names if each != f"{namespace}/{GUARD_NAME}")


class RosRover(RosCamera):
    """Publishes the arbiter's output. Used on the executor's thread, except `emergency_stop`."""

    def __init__(self, node: Node, topics: Topics, clock: Clock, settings: Settings) -> None:
        """Create the publishers.

        Raises:
            ParameterError: the velocity topic is not the executive's input of the mux.
        """
        super().__init__(node, topics)
        velocity = topics.cmd_vel
        mux = settings.mux
        self._mux = None if mux is None else RosMux(node, velocity, mux, clock)
        self._velocity = node.create_publisher(Twist, velocity.name, velocity.qos)
        self._topic = velocity
        self._twist = Twist()
        self._sent: deque[tuple[float, float]] = deque(maxlen=SENT)
        self._others = _Publishers(node, clock, velocity.name)

    def subscribe(self, subscribe: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Detect other publishers of velocities, also on this topic; ignores zero."""

        def hear(twist: Twist) -> None:
            received = (twist.linear.x, twist.angular.z)
            if any(received) and received not in self._sent:
                observe(OtherInput(VELOCITY_TOPIC, above=True, by=self._others.now()))

        subscribe(Twist, self._topic, hear)
        if self._mux is not None:
            self._mux.listen(subscribe, observe)

    def drive(self, velocity: Velocity) -> None:
        """Publish a velocity."""
        self._twist.linear.x = velocity.travel_mps
        self._twist.angular.z = velocity.rotate_radps
        self._sent.append((velocity.travel_mps, velocity.rotate_radps))
        self._velocity.publish(self._twist)

    def stop(self) -> None:
        """Publish zero."""
        self.drive(STANDING)

    def emergency_stop(self) -> None:
        """Publish zero and lock the mux, from any thread: publishers of rclpy may be shared."""
        self._velocity.publish(Twist())
        if self._mux is not None:
            self._mux.lock()

    def lock(self, held: bool) -> None:
        """Hold or release the lock of the mux."""
        if self._mux is not None:
            self._mux.hold(held)

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last velocity and lock have been received; return whether they were."""
        acknowledged = self._velocity.wait_for_all_acked(Duration(seconds=timeout_s))
        return acknowledged and (self._mux is None or self._mux.flush(timeout_s))
