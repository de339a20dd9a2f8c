"""`serve`, the body of `rover-sim`: a node that simulates the rover on ROS until a signal."""

import logging
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, Final, assert_never

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64
from trajectory_msgs.msg import JointTrajectory

from adapters.process import Termination
from adapters.ros import (
    LOCK_QOS,
    MessageError,
    RobotModelPublisher,
    SensorTopics,
    Topic,
    Topics,
    base_transform,
    battery_message,
    camera_transforms,
    declare_rate,
    declare_sensor_topics,
    declare_topics,
    joint_angle,
    joint_state,
    odometry_message,
    ros_node,
    sensor_message,
    single_threaded,
    time_message,
    twist_of,
)
from adapters.ros.simulation_items import SimulationItemPublisher
from executive.core.recording import SimulationState
from executive.settings import LocomotionKind, Settings, SettingsError
from executive.values.facts import (
    Battery,
    CameraAngles,
    Fact,
    Odometry,
    SensorFact,
)
from executive.values.geometry import Velocity
from executive.values.ports import CameraIntent
from sim.brick import BrickSettings, UsbPlug
from sim.ros.camera import CameraNode
from sim.ros.cargo import serve_cargo
from sim.ros.faults import serve_faults
from sim.ros.video_stream import VideoStream
from sim.rover import World
from sim.rover.body import PERIOD_S, SimulatedBody
from sim.rover.camera import Backend, PictureSettings, best_backend
from sim.rover.jackal import SimulatedJackal
from sim.rover.mocup import SimulatedMocup
from sim.rover.simulation import Simulation

NODE_NAME: Final = "simulation"
SECOND_FRAME: Final = "visual_odom"
"""Frame of the second odometry, with its origin at the rover's start."""
MAX_BURST_PERIODS: Final = 10
"""Maximum burst of periods to catch up: commands wait during it, and a base stops after 0.25 s."""
MAX_LAG_S: Final = 10.0
"""Maximum delay that is caught up gradually in real time: other nodes have their own clocks there,
and a dropped delay appears as latency of all sensors. At other speeds they use /clock."""
CAMERA_SPEED_RADPS: Final = 0.5
"""Speed of a camera before its first command."""
_LOG: Final = logging.getLogger(__name__)
MAX_LEAD_S: Final = 0.065
"""Maximum lead of simulated time over the executive's last tick, which is due after 0.05 s. With
0.1 s a starved executive received odometry 0.14 s old, more than the bound of `odometry_late`."""
EXECUTIVE_TIMEOUT_S: Final = 5.0
"""Real time without a tick after which time no longer waits: the executive has ended or hangs."""
STATE_PERIODS: Final = round(2 / PERIOD_S)
"""Periods between two checkpoints. Recordings then grow by 6 %, each second by 13 %; measured."""
WINDOW_S: Final = 5.0
"""Real time over which the speed is measured."""
SLOW_RATIO, REAL_RATIO = 0.9, 0.97
"""Speeds below which time is reported as slow, and above which as real again."""


class Pacer:
    """Decides whether simulated time waits; logs when it runs slower than real time, and why."""

    def __init__(self) -> None:
        self._tick_s: float | None = None
        self._tick_real_s = 0.0
        self._window = 0.0, 0.0
        self._slow = False

    def on_tick(self, simulated_s: float, real_s: float) -> None:
        """Note a tick of the executive."""
        if self._tick_s is None:
            self._window = simulated_s, real_s
        self._report(simulated_s, real_s)
        self._tick_s, self._tick_real_s = simulated_s, real_s

    def waits(self, simulated_s: float, real_s: float) -> bool:
        """Return whether simulated time waits for the executive's next tick."""
        if self._tick_s is None:
            return False
        late = simulated_s > self._tick_s + MAX_LEAD_S
        return late and real_s < self._tick_real_s + EXECUTIVE_TIMEOUT_S

    def _report(self, simulated_s: float, real_s: float) -> None:
        since_s, since_real_s = self._window
        if real_s < since_real_s + WINDOW_S:
            return
        self._window = simulated_s, real_s
        ratio = (simulated_s - since_s) / (real_s - since_real_s)
        if ratio < SLOW_RATIO and not self._slow:
            self._slow = True
            text = f"simulated time runs at {100 * ratio:.0f} % of real time"
            _LOG.warning("this computer is too busy, the executive's ticks are late: %s", text)
        elif ratio > REAL_RATIO and self._slow:
            self._slow = False
            _LOG.info("simulated time runs at real time again")


class JackalOnRos:
    """Publishes the measurements of the rover, and receives its commands.

    Attributes:
        on_executive_tick: called at each tick of the executive that was received.
    """

    def __init__(
        self,
        node: Node,
        topics: Topics,
        sensors: SensorTopics,
        rover: SimulatedJackal,
        settings: Settings,
    ) -> None:
        self._rover = rover
        self.on_executive_tick: Callable[[], None] = lambda: None
        self._model = RobotModelPublisher(node, settings)
        mux = settings.mux
        self._joints, self._mounting = sensors.joints, sensors.mounting
        self._sensors = {
            sensor: node.create_publisher(topic.type, topic.name, topic.qos)
            for sensor, topic in sensors.topics.items()
        }
        self._camera = CameraIntent(0.0, 0.0, CAMERA_SPEED_RADPS)
        self._odometry = _publish(node, topics.odometry)
        self._battery = _publish(node, topics.battery)
        self._pan = _publish(node, topics.camera_pan_state)
        self._tilt = _publish(node, topics.camera_tilt_state)
        listen, velocity = node.create_subscription, topics.cmd_vel
        if mux is None:
            listen(velocity.type, velocity.name, partial(self._on_velocity, None), velocity.qos)
        else:
            for name, entry in mux.topics.items():
                on_velocity = partial(self._on_velocity, name)
                listen(velocity.type, entry.topic, on_velocity, velocity.qos)
            for name, entry in mux.locks.items():
                on_lock = partial(self._on_lock, name, name == mux.lock)
                listen(Bool, entry.topic, on_lock, LOCK_QOS)
        for part, topic in (
            ("pan_rad", topics.camera_pan),
            ("tilt_rad", topics.camera_tilt),
            ("speed_radps", topics.camera_speed),
        ):
            if topic is not None:
                on_angle = partial(self._point, part, topic.joint)
                listen(topic.type, topic.name, on_angle, topic.qos)

    def exchange(self) -> None:
        """Publish the measurements since the last call."""
        for fact in self._rover.facts():
            self._publish(fact)

    def close(self) -> None:
        """Do no clean-up: the node destroys the publishers."""

    def _publish(self, fact: Fact) -> None:
        time_s = self._rover.time_s
        match fact:
            case Odometry():
                self._odometry(lambda _: odometry_message(fact))
                self._model.publish_transforms([base_transform(fact)])
            case Battery():
                self._battery(lambda topic: battery_message(fact, time_s, topic.type))
            case CameraAngles(pan_rad, tilt_rad):
                self._model.publish_transforms(camera_transforms(fact, time_s))
                self._pan(lambda topic: joint_state(topic.type, topic.joint, pan_rad, time_s))
                self._tilt(lambda topic: joint_state(topic.type, topic.joint, tilt_rad, time_s))
            case _ if isinstance(fact, SensorFact):
                sensor, message = sensor_message(fact, self._joints, SECOND_FRAME, self._mounting)
                self._sensors[sensor].publish(message)
            case _:
                raise TypeError(f"a simulated rover on ROS publishes no {type(fact).__name__}")

    def _on_velocity(self, name: str | None, message: Twist | TwistStamped) -> None:
        twist = twist_of(message)
        velocity = Velocity(twist.linear.x, twist.angular.z)
        if velocity.finite:
            self._rover.mux_command(name, velocity)
        else:
            _LOG.warning("velocity refused: %s", velocity)

    def _on_lock(self, name: str, own: bool, message: Bool) -> None:
        self._rover.mux_lock(name, message.data)
        if own:  # the executive publishes it once a tick
            self.on_executive_tick()

    def _point(
        self, part: str, joint: str, message: Float64 | JointState | JointTrajectory
    ) -> None:
        try:
            value = joint_angle(message, joint)
        except MessageError as error:
            _LOG.warning("camera command refused: %s", error)
            return
        if value is not None:
            changed: dict[str, Any] = {part: value}
            self._camera = replace(self._camera, **changed)
            self._rover.point_camera(self._camera)


def _publish(node: Node, topic: Topic | None) -> Callable[[Callable[[Topic], Any]], None]:
    """Return a function that publishes the message made for a topic; without one it does not."""
    if topic is None:
        return lambda _: None
    publisher = node.create_publisher(topic.type, topic.name, topic.qos)
    return lambda make: publisher.publish(make(topic))


class BrickOnUsb:
    """Transfers octets between a brick and its host; the brick detects a lost host by silence."""

    def __init__(self, rover: SimulatedMocup, path: Path) -> None:
        """Plug in.

        Raises:
            SettingsError: the socket cannot be created.
        """
        self._rover = rover
        try:
            self._plug = UsbPlug(path)
        except OSError as error:
            raise SettingsError(f"--usb-socket {path}: {error.strerror or error}") from error
        self._connected = False
        _LOG.info("the brick is plugged in at %s", path)

    def exchange(self) -> None:
        """Transfer the queued octets in both directions. Never blocks; called once a period."""
        octets = self._plug.receive()
        if octets:
            self._rover.receive(octets)
        if self._connected != self._plug.connected:
            self._connected = self._plug.connected
            _LOG.info("the brick is %s", "claimed" if self._connected else "released")
        self._plug.send(self._rover.brick.transmit())

    def close(self) -> None:
        """Unplug."""
        self._plug.close()


Exchange = JackalOnRos | BrickOnUsb
"""Exchange of commands and measurements of a rover: once a period, until it is closed."""


class SimulationNode:
    """Advances the rover with time, exchanges its messages, and publishes the ground truth.

    Args:
        speed: simulated seconds per second.
        paced: whether simulated time waits for late ticks of the executive.
        items: receives the state of a Jackal at intervals.
    """

    def __init__(
        self,
        node: Node,
        topics: Topics,
        rover: SimulatedBody,
        exchange: Exchange,
        camera: CameraNode | None,
        speed: float,
        paced: bool,
        items: SimulationItemPublisher,
    ) -> None:
        self._rover = rover
        self._items = items
        self._exchange = exchange
        self._camera = camera
        self._frame_every = 1
        if camera is not None:
            frame_s = 1 / declare_rate(node, "camera_hz", "pictures")
            self._frame_every = max(1, round(frame_s / PERIOD_S))
        self._period_s = PERIOD_S / speed
        burst_s = MAX_BURST_PERIODS * self._period_s
        self._max_lag_s = MAX_LAG_S if speed == 1.0 and not paced else burst_s
        self._pacer: Pacer | None = None
        if paced and isinstance(exchange, JackalOnRos):
            self._pacer = pacer = Pacer()
            exchange.on_executive_tick = lambda: pacer.on_tick(rover.time_s, monotonic())
        self._started_s = monotonic()
        self._periods = 0
        self._clock = node.create_publisher(Clock, "/clock", 1)
        truth = topics.ground_truth
        self._truth = truth and node.create_publisher(truth.type, truth.name, truth.qos)
        steady = NodeClock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(self._period_s, self._on_time, clock=steady)

    def _on_time(self) -> None:
        now_s = monotonic()
        behind_s = now_s - self._started_s - self._periods * self._period_s
        if behind_s > self._max_lag_s:
            if self._pacer is None:
                _LOG.warning("slower than the requested speed: %.2f s dropped", behind_s)
            self._started_s += behind_s
            behind_s = self._period_s
        for _ in range(min(round(behind_s / self._period_s), MAX_BURST_PERIODS)):
            if self._pacer is not None and self._pacer.waits(self._rover.time_s, now_s):
                self._started_s = now_s - self._periods * self._period_s
                break
            self._advance()

    def _advance(self) -> None:
        self._rover.advance(PERIOD_S)
        self._periods += 1
        self._clock.publish(Clock(clock=time_message(self._rover.time_s)))
        self._exchange.exchange()
        rover = self._rover
        if self._truth and self._truth.get_subscription_count():
            self._truth.publish(
                odometry_message(Odometry(rover.time_s, rover.true_pose, rover.true_velocity))
            )
        is_due = self._periods % STATE_PERIODS == 0 and self._items.records_state
        if is_due and isinstance(rover, SimulatedJackal):
            self._items.put(SimulationState(rover.time_s, rover.save()))
        if self._camera is not None and self._periods % self._frame_every == 0:
            self._camera.request_picture()


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """Options of the command line.

    Attributes:
        parameters: ROS parameter file.
        ros_arguments: arguments passed to ROS unchanged.
        usb: socket of the brick of a rover that has one.
        speed: simulated seconds per second.
        paced: whether simulated time waits for late ticks of the executive.
        camera: auto, egl, rays or off.
        video_to: host and port of the camera's stream; None for no stream.
    """

    settings: Settings
    world: World
    parameters: Path
    ros_arguments: tuple[str, ...]
    usb: Path
    seed: int
    speed: float
    paced: bool
    camera: str
    video_to: tuple[str, int] | None


def serve(options: SimulationOptions) -> None:
    """Simulate until SIGINT or SIGTERM.

    Raises:
        adapters.ros.parameters.ParameterError: a ROS parameter is missing or invalid.
        SettingsError: the camera cannot be streamed, or the brick plugged in, as requested.
    """
    logging.getLogger("OpenGL").setLevel(logging.WARNING)
    termination = Termination()
    with (
        ros_node(
            NODE_NAME,
            options.settings.asset,
            parameters=options.parameters,
            ros_arguments=options.ros_arguments,
        ) as node,
        single_threaded(node) as executor,
    ):
        topics = declare_topics(node)
        rover, exchange = _rover(node, topics, options)
        items = SimulationItemPublisher(node)
        items.put(Simulation(options.world, options.seed).started(rover.time_s))
        serve_cargo(node, rover, items)
        serve_faults(node, rover, items)
        with closing(exchange), _camera(node, topics, rover, options) as camera:
            pace = options.speed, options.paced
            SimulationNode(node, topics, rover, exchange, camera, *pace, items)
            print(
                f"{options.settings.asset} stands in world {options.world.name},"
                f" camera: {'off' if camera is None else camera.backend.value}",
                flush=True,
            )
            while not termination.requested:
                executor.spin_once()


def _rover(
    node: Node, topics: Topics, options: SimulationOptions
) -> tuple[SimulatedBody, Exchange]:
    """Return the rover of an asset and its exchange, both by its settings."""
    world, seed, settings = options.world, options.seed, options.settings
    match settings.locomotion:
        case LocomotionKind.VELOCITY:
            sensors = declare_sensor_topics(node, settings.sensors)
            there = sensors.without_topicless(settings.sensors)
            jackal = SimulatedJackal(world, seed, sensors=there, mux=settings.mux)
            return jackal, JackalOnRos(node, topics, sensors, jackal, settings)
        case LocomotionKind.DELEGATED:
            brick = BrickSettings(name=settings.asset.upper(), host_rate=options.speed)
            mocup = SimulatedMocup(world, seed, brick=brick)
            return mocup, BrickOnUsb(mocup, options.usb)
        case _:
            assert_never(settings.locomotion)


@contextmanager
def _camera(
    node: Node, topics: Topics, rover: SimulatedBody, options: SimulationOptions
) -> Iterator[CameraNode | None]:
    limits = options.settings.camera
    if options.camera == "off" or not (limits.formats or options.video_to):
        yield None
        return
    backend = best_backend() if options.camera == "auto" else Backend(options.camera)
    size = (limits.width_px, limits.height_px)
    settings = PictureSettings(*size, backend=backend)
    video = None if options.video_to is None else VideoStream(*options.video_to, *size)
    camera = CameraNode(node, topics, rover, settings, video)
    try:
        yield camera
    finally:
        camera.close()
        if video is not None:
            video.close()
