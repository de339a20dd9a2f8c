"""`ExecutiveNode`: messages become facts, timers ticks, on one thread; serves `~/e_stop`, too."""

import logging
import time
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from adapters.ros.context import SpunNode
from adapters.ros.conversions import (
    BatteryReader,
    IgnoredMessageError,
    MessageError,
    Precision,
    frame_fact,
    joint_angle,
    odometry_fact,
    round_measurement,
)
from adapters.ros.diagnostics import TickMonitor, TickStatistics, diagnose
from adapters.ros.emergency_stop import RobotEmergencyStop
from adapters.ros.parameters import TF_MESSAGE, Topic, Topics, declare_flag, declare_rate
from adapters.ros.robot_model import RobotModelPublisher, base_transform, camera_transforms
from adapters.ros.rover import PolledRover, RosAsset, foreign_publishers
from adapters.ros.sensors import PolledSensors, SensorTopics
from adapters.ros.subscription import ReceivedData, TopicSubscription
from adapters.ros.transforms import Transforms
from adapters.ros.tree_topic import TreePublisher
from executive.commands import ROS_LINK, ROS_SOURCE, Command, Mode, Stop
from executive.core.runner import Executive
from executive.values.clock import Clock, SystemClock, round_for_recording_s
from executive.values.facts import (
    CameraAngles,
    EmergencyStop,
    Fact,
    ForeignPublishers,
    Frame,
    Source,
)
from executive.values.facts import Odometry as OdometryFact
from executive.values.geometry import TargetFrame
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, Severity
from trees import snapshot_of

HEALTH_S: Final = 1.0
_LOG = logging.getLogger(__name__)


def uses_simulated_time(node: Node) -> bool:
    """Return whether the node's parameter `use_sim_time` is set."""
    return bool(node.get_parameter("use_sim_time").value)


def clock_of(node: Node) -> Clock:
    """Return the core's clock: this machine's, or the simulated time of `use_sim_time`."""
    return RosClock(node.get_clock()) if uses_simulated_time(node) else SystemClock()


class ExecutiveNode:
    """Serves one executive with ROS, on the thread that spins the node, which is the core's.

    An invalid message is rejected, counted, and reported to the core with the reason: its fact is
    then missing, and the core stops the rover if it needs it. A callback that raises is a fault:
    the rover stops, SAFE, and the process continues.

    Attributes:
        on_ticks: called each second with the tick statistics.
    """

    def __init__(
        self,
        node: Node,
        topics: Topics,
        sensors: SensorTopics,
        rover: RosAsset,
        executive: Executive,
    ) -> None:
        self._node = node
        self._topics = topics
        self._rover = rover
        self._executive = executive
        self.on_ticks: Callable[[TickStatistics], None] = lambda _: None
        self._diagnosed = self._mode_and_command
        self._pan_rad: float | None = None
        self._tilt_rad: float | None = None
        self._rejected = 0
        self._last_fault = ""
        self._apart: list[SpunNode] = []
        self._followed: list[TopicSubscription] = []
        self._mismatches: dict[TopicSubscription, str | None] = {}
        self._clock = clock_of(node)
        tick_s = executive.settings.tick_s
        self._ticks = TickMonitor(tick_s, self._clock.now_s)
        self._trees = TreePublisher(node, executive)
        self._tree_every = max(1, round(1 / (declare_rate(node, "tree_hz", "tree") * tick_s)))
        self._tree_in = 0
        self._model = None
        if declare_flag(node, "robot_model", "whether robot_description and frames are published"):
            self._model = RobotModelPublisher(node, executive.settings)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        used: dict[Source, Topic | None] = {
            Source.ODOMETRY: topics.odometry,
            Source.BATTERY: topics.battery,
            Source.CAMERA: topics.camera,
            Source.VELOCITY: topics.cmd_vel,
            **{Source[each.name]: topic for each, topic in sensors.topics.items()},
        }
        present = {source: topic for source, topic in used.items() if topic is not None}
        self._data = ReceivedData(node, present, executive.observe)
        self._transforms = transforms = Transforms(node, self._observe, self.contained)
        if topics.odometry.type is TF_MESSAGE:
            receive = self._receiving(Source.ODOMETRY, transforms.odometry, self._on_odometry)
            taken = transforms.of_base(receive)
        else:
            taken = self._receiving(Source.ODOMETRY, odometry_fact, self._on_odometry)
        self._odometry = self._subscription(topics.odometry, taken)
        self._sensors = PolledSensors(node, sensors, self._receiving)
        self._followed += [*self._sensors.subscriptions, *transforms.subscriptions]
        if topics.battery is not None:
            reader = BatteryReader(partial(executive.report_event, Severity.WARNING))
            self._subscription(topics.battery, self._receiving(Source.BATTERY, reader.fact))
        for topic, on_angle in (
            (topics.camera_pan_state, self._on_pan),
            (topics.camera_tilt_state, self._on_tilt),
        ):
            if topic is not None:
                self.subscribe(topic, partial(on_angle, topic.joint))
        self._emergency_stop = RobotEmergencyStop(
            *(node, topics.emergency_stop, self._clock),
            lambda active: self._observe(EmergencyStop(active)),
            partial(executive.report_event, Severity.ALARM),
        )
        if topics.emergency_stop is not None:
            self.subscribe(topics.emergency_stop, self._emergency_stop.on_state)
        if topics.camera is not None:
            rover.on_frame = self._receiving(Source.CAMERA, frame_fact, self._on_frame)
        rover.subscribe(self.subscribe, self._observe)
        self._poll_rover: Callable[..., None] = lambda _: None
        if isinstance(rover, PolledRover):
            self._poll_rover = self.contained(rover.poll)
        steady = NodeClock(clock_type=ClockType.STEADY_TIME)
        ticking = node.get_clock() if uses_simulated_time(node) else steady
        node.create_timer(tick_s, self.contained(self._tick), clock=ticking)
        node.create_timer(HEALTH_S, self.contained(self._publish_health), clock=steady)
        woken = node.create_guard_condition(self.contained(self._serve_inbox))
        executive.wake = woken.trigger
        self._serve_stop()

    def close(self) -> None:
        """Detach from the executive, which can then no longer wake the node."""
        for spun in self._apart:
            spun.close()
        self._executive.wake = lambda: None

    @property
    def target_frames(self) -> dict[str, TargetFrame]:
        """The frames of targets by their names on ROS."""
        return self._transforms.target_frames

    def subscribe(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Subscribe a callback to a topic; exceptions are contained."""
        self._mismatches[self._subscription(topic, self.contained(callback))] = None

    def _subscription(self, topic: Topic, callback: Callable[[Any], None]) -> TopicSubscription:
        added = TopicSubscription(self._node, topic, callback)
        self._followed.append(added)
        return added

    def _follow_publishers(self) -> None:
        """Match the publishers' quality of service; report topics without a matching publisher.

        Not while the rover moves: a new subscription may miss messages.
        """
        if self._executive.moving:
            return
        for each in self._followed:
            found = each.follow()
            if found != self._mismatches.get(each, found):
                self._mismatches[each] = found
                if found:
                    self._executive.report_event(
                        Severity.WARNING, f"nothing is received on {found}"
                    )

    def subscribe_apart(
        self, topic: Topic, callback: Callable[[Any], None], *, beside_stop: bool = False
    ) -> None:
        """Subscribe a callback on a thread of its own, independent of the core's load.

        Its exceptions are contained on the core's thread. `beside_stop` uses the thread of the
        service `~/e_stop`.
        """

        def call(message: Any) -> None:
            try:
                callback(message)
            except Exception as error:
                self._executive.query(partial(self._handle, error))

        name = self._node.resolve_topic_name(topic.name)
        node = self._stop_node if beside_stop else self._node_apart(name)
        node.create_subscription(topic.type, name, call, topic.qos)

    def _node_apart(self, served: str) -> Node:
        """Return a node spun by its own thread, independent of the core's load, for a topic."""
        spun = SpunNode(f"{self._node.get_name()}_{served.rsplit('/', 1)[-1]}", self._node)
        self._apart.append(spun)
        return spun.node

    def _serve_stop(self) -> None:
        """Serve `~/e_stop`: an ordinary stop, until resumed, independent of the core's load."""
        numbers = count(round(time.time() * 1e6))
        name = self._node.resolve_service_name("~/e_stop")

        def stop(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            identity = Identity(ROS_SOURCE, next(numbers))
            self._executive.submit(Command(identity, Stop(), ROS_LINK), lambda _: None)
            response.success = True
            response.message = f"stopped by {identity}: send resume to move the rover again"
            return response

        self._stop_node = self._node_apart(name)
        self._stop_node.create_service(Trigger, name, stop)

    def contained(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Return a callback without exceptions: they reject the message, or make SAFE."""

        def call(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except Exception as error:
                self._handle(error)

        return call

    def _receiving(
        self,
        source: Source,
        fact_of: Callable[[Any], Any],
        observe: Callable[[Any], None] | None = None,
    ) -> Callable[[Any], None]:
        """Return a contained callback that observes the facts of a source's messages."""
        return self.contained(self._data.receiving(source, fact_of, observe or self._observe))

    def _on_odometry(self, fact: OdometryFact) -> None:
        if self._model is not None:
            self._model.publish_transforms([base_transform(fact)])
        self._observe(fact)

    def _observe(self, fact: Fact) -> None:
        """Observe a fact if it can be dated: simulated time is 0 until /clock is received."""
        if self._clock.now_s() <= 0.0:
            raise IgnoredMessageError("simulated time is 0: no publisher of /clock")
        self._executive.observe(fact)

    def _on_pan(self, joint: str, message: Float64 | JointState) -> None:
        if (angle_rad := joint_angle(message, joint)) is not None:
            self._pan_rad = round_measurement(angle_rad, Precision.LEAN)
            self._observe_camera()

    def _on_tilt(self, joint: str, message: Float64 | JointState) -> None:
        if (angle_rad := joint_angle(message, joint)) is not None:
            self._tilt_rad = round_measurement(angle_rad, Precision.LEAN)
            self._observe_camera()

    def _observe_camera(self) -> None:
        if self._pan_rad is not None and self._tilt_rad is not None:
            angles = CameraAngles(self._pan_rad, self._tilt_rad)
            if self._model is not None:
                now_s = self._node.get_clock().now().nanoseconds * 1e-9
                self._model.publish_transforms(camera_transforms(angles, now_s))
            self._observe(angles)

    def _on_frame(self, frame: Frame) -> None:
        self._rover.on_frame_taken()
        self._observe(frame)

    def _serve_inbox(self) -> None:
        self._executive.serve_inbox()
        self._emergency_stop.update(self._executive.held_until_resume)

    def _catch_up(self) -> None:
        """Process queued odometry, since rclpy serves timers first; then poll the sensors."""
        self._odometry.poll()
        self._sensors.poll()
        self._transforms.poll()
        self._poll_rover(self._transforms.map_to_odom)

    def _tick(self) -> None:
        with self._ticks.tick():
            self._catch_up()
            self._executive.tick()
            self._emergency_stop.update(self._executive.held_until_resume)
            self._tree_in -= 1
            if self._tree_in <= 0:
                self._tree_in = self._tree_every
                self._trees.update(self._clock.utc_s())
                if self._diagnosed != self._mode_and_command:
                    self._diagnose(self._ticks.statistics)

    def _publish_health(self) -> None:
        names = foreign_publishers(self._node, self._topics.cmd_vel.name)
        if names != self._executive.status.foreign_publishers:
            self._executive.observe(ForeignPublishers(names))
        ticks = self._ticks.pop_statistics()
        self.on_ticks(ticks)
        self._diagnose(ticks)
        self._data.report()
        self._follow_publishers()
        self._rejected = 0

    @property
    def _mode_and_command(self) -> tuple[Mode, Identity | None]:
        return self._executive.mode, self._executive.active_command

    def _diagnose(self, ticks: TickStatistics) -> None:
        self._diagnosed = self._mode_and_command
        self._diagnostics.publish(
            diagnose(
                self._executive,
                snapshot_of(self._executive, self._clock.utc_s()),
                ticks,
                self._rejected + self._data.rejected,
                self._node.get_fully_qualified_name(),
                self._node.get_clock().now().to_msg(),
            )
        )

    def _handle(self, error: Exception) -> None:
        if not isinstance(error, MessageError):
            self._contain(error)
        elif not isinstance(error, IgnoredMessageError):
            self._reject(error)

    def _reject(self, error: MessageError) -> None:
        if self._rejected == 0:
            _LOG.warning("message rejected: %s", error)
        self._rejected += 1

    def _contain(self, error: Exception) -> None:
        self._rover.stop()
        fault = repr(error)
        if fault != self._last_fault:
            _LOG.error("a callback raised %s", fault, exc_info=error)
            self._last_fault = fault
        self._executive.enter_safe_mode(
            Refusal(Reason.ADAPTER_RAISED, f"the ROS adapter raised {fault}")
        )


class RosClock:
    """Simulated time for deadlines and ages; UTC of this machine for stamps and lifetimes.

    A command's lifetime is counted in the UTC of the ground, independent of simulated time, so
    `utc_s` is never simulated.

    Args:
        clock: the node's clock, with `use_sim_time` set. When it jumps back, because the
            simulation restarted, this clock pauses for that moment and then continues.
    """

    def __init__(self, clock: NodeClock) -> None:
        self._clock = clock
        self._last_ns = clock.now().nanoseconds
        self._offset_ns = 0

    def now_s(self) -> float:
        """Return seconds that never step back."""
        now_ns = self._clock.now().nanoseconds
        if now_ns < self._last_ns:
            self._offset_ns += self._last_ns - now_ns
        self._last_ns = now_ns
        return round_for_recording_s((now_ns + self._offset_ns) * 1e-9)

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC."""
        return round_for_recording_s(time.time())
