"""`RosRover`, which receives velocities on `cmd_vel`; `RosAsset`, the interface of other rovers.

The latter includes the lock and other inputs of its mux (twist_mux). docs/add-a-rover.md: others.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any, Final, Protocol, runtime_checkable

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Bool, Float64
from trajectory_msgs.msg import JointTrajectory

from adapters.ros.conversions import joint_command, twist_of, velocity_message
from adapters.ros.parameters import ParameterError, Topic, Topics
from adapters.ros.subscription import matching_qos
from executive.record import Ledger
from executive.settings import MuxSettings, Settings
from executive.values.clock import Clock
from executive.values.facts import VELOCITY_TOPIC, Fact, ForeignMuxInput
from executive.values.geometry import STANDING, Pose, Velocity
from executive.values.ports import (
    CameraIntent,
    DelegatedMotionRover,
    Downlink,
    NavigationRover,
    VelocityRover,
)

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
Subscribe = Callable[[Topic, Callable[[Any], None]], None]
"""Subscribes a callback for the messages of a topic."""


class RosAsset(Protocol):
    """A rover on ROS. Used on the executor's thread, except `emergency_stop`.

    Attributes:
        on_frame: called with each image while a frame is requested; set before the first request.
    """

    on_frame: Callable[[CompressedImage | Image], None]

    def subscribe(self, add_subscription: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Subscribe to the topics that only this kind of rover has."""

    def downlinks(self, ledger: Ledger) -> Sequence[Downlink]:
        """Return the downlinks of this kind of rover that receive reports."""

    def on_frame_taken(self) -> None:
        """Unsubscribe from the camera."""

    def stop(self) -> None:
        """Stop the rover, if the executive moves it."""

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last command has been received; return whether it was."""


@runtime_checkable
class PolledRover(Protocol):
    """A rover with data that wait for each tick."""

    def poll(self, map_to_odom: Pose | None) -> None:
        """Observe them; the pose of the odometry frame in the map is the newest, or None."""


class RosVelocityRover(RosAsset, VelocityRover, Protocol):
    """A rover on ROS that receives velocities."""


class RosNavigationRover(RosAsset, NavigationRover, Protocol):
    """A rover on ROS that receives velocities, and has a navigation."""


class RosMotionRover(RosAsset, DelegatedMotionRover, Protocol):
    """A rover on ROS that executes whole motions by itself."""


class RosFrames:
    """A camera that uses no bandwidth while no frame is requested.

    The subscription starts with a request and ends with the frame that answers it.

    Attributes:
        on_frame: called with each image while a frame is requested; set before the first request.
    """

    on_frame: Callable[[CompressedImage | Image], None]

    def __init__(self, node: Node, image: Topic | None) -> None:
        self._node = node
        self._image = image
        self._frames: Subscription | None = None

    def downlinks(self, ledger: Ledger) -> Sequence[Downlink]:
        """Return none: no part of this rover needs reports."""
        return ()

    def request_frame(self) -> None:
        """Subscribe to the camera, if there is one, until `on_frame_taken`."""
        if self._frames is None and self._image is not None:
            self._frames = self._node.create_subscription(
                self._image.type,
                self._image.name,
                self.on_frame,
                matching_qos(self._node, self._image),
            )

    def lock(self, held: bool) -> None:
        """Ignore the lock: this rover has no mux."""

    def on_frame_taken(self) -> None:
        """Unsubscribe from the camera."""
        if self._frames is not None:
            self._node.destroy_subscription(self._frames)
            self._frames = None


class RosCamera(RosFrames):
    """Publishes the camera's set point, and receives frames on request."""

    def __init__(self, node: Node, topics: Topics) -> None:
        super().__init__(node, topics.camera)
        self._pan, self._tilt = (
            None if topic is None else _JointPublisher(node, topic)
            for topic in (topics.camera_pan, topics.camera_tilt)
        )
        speed = topics.camera_speed
        self._speed = (
            None if speed is None else node.create_publisher(speed.type, speed.name, speed.qos)
        )

    def point_camera(self, wanted: CameraIntent) -> None:
        """Publish the camera's maximum speed and its angles, each if it has a topic."""
        if self._speed is not None:
            self._speed.publish(Float64(data=wanted.speed_radps))
        for joint, angle_rad in ((self._pan, wanted.pan_rad), (self._tilt, wanted.tilt_rad)):
            if joint is not None:
                joint.publish(angle_rad, wanted.speed_radps)


class _JointPublisher:
    """Publishes set points of a joint; a trajectory once per set point, as each one restarts it."""

    def __init__(self, node: Node, topic: Topic) -> None:
        self._publisher = node.create_publisher(topic.type, topic.name, topic.qos)
        self._topic = topic
        self._last_rad = 0.0
        self._published = False

    def publish(self, angle_rad: float, speed_radps: float) -> None:
        if self._published and angle_rad == self._last_rad and self._topic.type is JointTrajectory:
            return
        turn_rad, self._last_rad = angle_rad - self._last_rad, angle_rad
        self._published = True
        topic = self._topic
        command = joint_command(topic.type, topic.joint, angle_rad, speed_radps, turn_rad)
        self._publisher.publish(command)


class VelocityPublisher:
    """Publishes velocities of base_link in the message type of their topic.

    A stamp is the time of the node's clock at which the velocity is published.
    """

    def __init__(self, node: Node, topic: Topic) -> None:
        self._publisher = node.create_publisher(topic.type, topic.name, topic.qos)
        self._type = topic.type
        self._clock = node.get_clock()

    def publish(self, velocity: Velocity) -> None:
        """Publish a velocity, from any thread: publishers of rclpy may be shared."""
        stamp = self._clock.now().to_msg()
        self._publisher.publish(velocity_message(velocity, self._type, stamp))

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last velocity has been received; return whether it was."""
        return bool(self._publisher.wait_for_all_acked(Duration(seconds=timeout_s)))


class RosMux:
    """The executive's side of a mux in front of the base: holds its lock, monitors other inputs.

    While the lock is held, zero is published on the input for stops, if the mux has one: a base
    that receives nothing would move on until its own timeout.

    Args:
        node: creates the topics.
        velocity: the executive's velocity topic.
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
        self._velocity = velocity
        self._lock = node.create_publisher(Bool, settings.locks[settings.lock].topic, LOCK_QOS)
        self._stop = None
        if settings.stop is not None:
            stop = self._input(settings.topics[settings.stop].topic)
            self._stop = VelocityPublisher(node, stop)

    def _input(self, name: str) -> Topic:
        """Return an input; all have one type, by the parameter use_stamped of twist_mux."""
        return replace(self._velocity, name=name)

    def listen(
        self, subscribe: Subscribe, observe: Callable[[Fact], None], gated: str | None = None
    ) -> None:
        """Report velocities on other inputs to the core, except a navigation's behind its gate."""
        above = self._settings.topics[self._settings.input].priority
        for name, entry in self._settings.topics.items():
            if name not in (self._settings.input, self._settings.stop, gated):
                publishers = _Publishers(self._node, self._clock, entry.topic)
                on_velocity = partial(
                    _mux_input_observer, observe, name, entry.priority > above, publishers
                )
                subscribe(self._input(entry.topic), on_velocity)

    def hold(self, held: bool) -> None:
        """Publish the lock, held or not: the guard of an earlier executive may have locked it."""
        self._lock.publish(Bool(data=held))
        if held:
            self._publish_zero()

    def lock(self) -> None:
        """Lock the mux, from any thread; changes no state here."""
        self._publish_zero()
        self._lock.publish(Bool(data=True))

    def _publish_zero(self) -> None:
        if self._stop is not None:
            self._stop.publish(STANDING)

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
    observe: Callable[[Fact], None], name: str, above: bool, publishers: _Publishers, _: object
) -> None:
    observe(ForeignMuxInput(name, above, publishers.now()))


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
        self._gated = None if settings.navigation is None else settings.navigation.input
        self._velocity = VelocityPublisher(node, velocity)
        self._topic = velocity
        self._sent: deque[tuple[float, float]] = deque(maxlen=SENT)
        self._others = _Publishers(node, clock, velocity.name)

    def subscribe(self, add_subscription: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Detect other publishers of velocities, also on this topic; ignores zero."""

        def on_velocity(message: Twist | TwistStamped) -> None:
            twist = twist_of(message)
            received = (twist.linear.x, twist.angular.z)
            if any(received) and received not in self._sent:
                observe(
                    ForeignMuxInput(VELOCITY_TOPIC, overrides=True, publisher=self._others.now())
                )

        add_subscription(self._topic, on_velocity)
        if self._mux is not None:
            self._mux.listen(add_subscription, observe, self._gated)

    def drive(self, velocity: Velocity) -> None:
        """Publish a velocity."""
        self._sent.append((velocity.travel_mps, velocity.rotate_radps))
        self._velocity.publish(velocity)

    def stop(self) -> None:
        """Publish zero."""
        self.drive(STANDING)

    def emergency_stop(self) -> None:
        """Publish zero and lock the mux, from any thread."""
        self._velocity.publish(STANDING)
        if self._mux is not None:
            self._mux.lock()

    def lock(self, held: bool) -> None:
        """Hold or release the lock of the mux."""
        if self._mux is not None:
            self._mux.hold(held)

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last velocity and lock have been received; return whether they were."""
        acknowledged = self._velocity.flush(timeout_s)
        return acknowledged and (self._mux is None or self._mux.flush(timeout_s))
