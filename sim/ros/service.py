"""Assembles the simulation's process, serves it until a signal, and closes it."""

import logging
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite
from pathlib import Path
from time import monotonic
from typing import Final, assert_never

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Bool, Float64

from adapters.process import Termination
from adapters.ros import (
    LOCK_QOS,
    MESSAGES,
    RobotModelPublisher,
    SensorTopics,
    Topics,
    base_transform,
    battery_message,
    camera_transforms,
    declare_rate,
    declare_sensor_topics,
    declare_topics,
    imu_message,
    joints_message,
    laser_message,
    odometry_message,
    ros_node,
    second_odometry_message,
    single_threaded,
    time_message,
)
from executive.settings import LocomotionKind, Sensor, Settings, SettingsError
from executive.values.facts import (
    Battery,
    CameraAngles,
    Fact,
    Imu,
    Joints,
    LaserScan,
    Odometry,
    SecondOdometry,
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


class JackalOnRos:
    """Publishes the measurements of the rover, and receives its commands."""

    def __init__(
        self,
        node: Node,
        topics: Topics,
        sensors: SensorTopics,
        rover: SimulatedJackal,
        settings: Settings,
    ) -> None:
        self._rover = rover
        self._model = RobotModelPublisher(node, settings)
        mux = settings.mux
        self._joints = sensors.joints
        self._sensors = {
            sensor: node.create_publisher(MESSAGES[sensor], topic.name, topic.qos)
            for sensor, topic in sensors.topics.items()
        }
        self._camera = CameraIntent(0.0, 0.0, CAMERA_SPEED_RADPS)
        make = node.create_publisher
        self._odometry = make(OdometryMessage, topics.odometry.name, topics.odometry.qos)
        self._battery = make(BatteryState, topics.battery.name, topics.battery.qos)
        self._pan = make(Float64, topics.camera_pan_state.name, topics.camera_pan_state.qos)
        self._tilt = make(Float64, topics.camera_tilt_state.name, topics.camera_tilt_state.qos)
        listen = node.create_subscription
        if mux is None:
            listen(Twist, topics.cmd_vel.name, partial(self._on_velocity, None), topics.cmd_vel.qos)
        else:
            for name, entry in mux.topics.items():
                listen(Twist, entry.topic, partial(self._on_velocity, name), topics.cmd_vel.qos)
            for name, entry in mux.locks.items():
                listen(Bool, entry.topic, partial(self._on_lock, name), LOCK_QOS)
        for part, topic in (
            ("pan_rad", topics.camera_pan),
            ("tilt_rad", topics.camera_tilt),
            ("speed_radps", topics.camera_speed),
        ):
            listen(Float64, topic.name, partial(self._point, part), topic.qos)

    def exchange(self) -> None:
        """Publish the measurements since the last call."""
        for fact in self._rover.facts():
            self._publish(fact)

    def close(self) -> None:
        """Do no clean-up: the node destroys the publishers."""

    def _publish(self, fact: Fact) -> None:
        match fact:
            case Odometry():
                self._odometry.publish(odometry_message(fact))
                self._model.moved([base_transform(fact)])
            case Battery():
                self._battery.publish(battery_message(fact, self._rover.time_s))
            case CameraAngles(pan_rad, tilt_rad):
                self._model.moved(camera_transforms(fact, self._rover.time_s))
                self._pan.publish(Float64(data=pan_rad))
                self._tilt.publish(Float64(data=tilt_rad))
            case Imu():
                self._sensors[Sensor.IMU].publish(imu_message(fact))
            case Joints():
                self._sensors[Sensor.JOINTS].publish(joints_message(fact, self._joints))
            case SecondOdometry():
                message = second_odometry_message(fact, SECOND_FRAME)
                self._sensors[Sensor.SECOND_ODOMETRY].publish(message)
            case LaserScan():
                self._sensors[Sensor.LASER].publish(laser_message(fact))
            case _:
                raise TypeError(f"a simulated rover on ROS publishes no {type(fact).__name__}")

    def _on_velocity(self, name: str | None, message: Twist) -> None:
        velocity = Velocity(message.linear.x, message.angular.z)
        if velocity.finite:
            self._rover.mux_command(name, velocity)
        else:
            _LOG.warning("velocity refused: %s", velocity)

    def _on_lock(self, name: str, message: Bool) -> None:
        self._rover.mux_lock(name, message.data)

    def _point(self, part: str, message: Float64) -> None:
        if isfinite(message.data):
            self._camera = replace(self._camera, **{part: message.data})
            self._rover.point_camera(self._camera)


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
    """Advances the rover with time, exchanges its messages, and publishes the ground truth."""

    def __init__(
        self,
        node: Node,
        topics: Topics,
        rover: SimulatedBody,
        exchange: Exchange,
        camera: CameraNode | None,
        speed: float,
    ) -> None:
        self._rover = rover
        self._exchange = exchange
        self._camera = camera
        self._frame_every = max(
            1, round(1 / (declare_rate(node, "camera_hz", "pictures") * PERIOD_S))
        )
        self._period_s = PERIOD_S / speed
        burst_s = MAX_BURST_PERIODS * self._period_s
        self._max_lag_s = MAX_LAG_S if speed == 1.0 else burst_s
        self._started_s = monotonic()
        self._periods = 0
        self._clock = node.create_publisher(Clock, "/clock", 1)
        self._truth = node.create_publisher(
            OdometryMessage, topics.ground_truth.name, topics.ground_truth.qos
        )
        steady = NodeClock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(self._period_s, self._on_time, clock=steady)

    def _on_time(self) -> None:
        behind_s = monotonic() - self._started_s - self._periods * self._period_s
        if behind_s > self._max_lag_s:
            _LOG.warning("slower than the requested speed: %.2f s dropped", behind_s)
            self._started_s += behind_s
            behind_s = self._period_s
        for _ in range(min(round(behind_s / self._period_s), MAX_BURST_PERIODS)):
            self._advance()

    def _advance(self) -> None:
        self._rover.advance(PERIOD_S)
        self._periods += 1
        self._clock.publish(Clock(clock=time_message(self._rover.time_s)))
        self._exchange.exchange()
        if self._truth.get_subscription_count():
            rover = self._rover
            self._truth.publish(
                odometry_message(Odometry(rover.time_s, rover.true_pose, rover.true_velocity))
            )
        if self._camera is not None and self._periods % self._frame_every == 0:
            self._camera.offer()


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """Options of the command line.

    Attributes:
        parameters: ROS parameter file.
        ros_arguments: arguments passed to ROS unchanged.
        usb: socket of the brick of a rover that has one.
        speed: simulated seconds per second.
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
        serve_cargo(node, rover)
        serve_faults(node, rover)
        with closing(exchange), _camera(node, topics, rover, options) as camera:
            SimulationNode(node, topics, rover, exchange, camera, options.speed)
            print(
                f"{options.settings.asset} stands in world {options.world.name},"
                f" camera: {options.camera if camera is None else camera.backend.value}",
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
        case LocomotionKind.WHOLE_MOTION:
            brick = BrickSettings(name=settings.asset.upper(), host_rate=options.speed)
            mocup = SimulatedMocup(world, seed, brick=brick)
            return mocup, BrickOnUsb(mocup, options.usb)
        case _:
            assert_never(settings.locomotion)


@contextmanager
def _camera(
    node: Node, topics: Topics, rover: SimulatedBody, options: SimulationOptions
) -> Iterator[CameraNode | None]:
    if options.camera == "off":
        yield None
        return
    limits = options.settings.camera
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
