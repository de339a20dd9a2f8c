"""A process that speaks on ROS 2 as a robot of another maker does, in simulated time.

    python -m tests.robots.standin turtlebot4 --speed 1.5

It publishes `/clock`. While velocities are sent, it waits for each, so that a busy machine slows
its time down, instead of making the executive late; at rest, where none are sent, its time can be
slower.
SIGTERM ends it; then it prints its odometry.
"""

import argparse
import signal
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, inf
from random import Random
from typing import Any, Final

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, Image, Imu, JointState, LaserScan
from std_msgs.msg import Bool, Float32
from std_srvs.srv import Trigger

from adapters.process import take_priority
from adapters.ros import ros_node, single_threaded, time_message
from tests.robots.interfaces import INTERFACES, EmergencyStopSource, Interface
from tests.robots.messages import (
    OdometryMessages,
    battery_message,
    image_message,
    imu_message,
    joints_message,
    odometry_transform,
    scan_message,
    transform,
)
from tests.robots.motion import STEP_S, Motion

CLOCK_HZ: Final = 100.0
CAMERA_HZ: Final = 10.0
EMERGENCY_STOP_HZ: Final = 2.0
POLL_S: Final = 0.002
UNANSWERED_S: Final = 0.06
"""Simulated time for which it moves on without a new velocity before it waits for one."""
PATIENCE_S: Final = 2.0
"""Real time for which it waits while it is to move."""
ENDED_S: Final = 0.2
"""Real time for which it waits after a zero, which may be the last one."""
BEHIND_S: Final = 0.015
"""Real time by which it may be late and catch up."""


def quality(*, best_effort: bool = False, latched: bool = False) -> QoSProfile:
    return QoSProfile(  # type: ignore[no-untyped-call]
        depth=1 if latched else 10,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


@dataclass
class Periodic:
    """A topic that is published with a rate."""

    rate_hz: float
    publish: Callable[[], None]
    due_s: float = 0.0

    def poll(self, now_s: float) -> None:
        if now_s + 1e-9 >= self.due_s:
            self.due_s = max(self.due_s + 1 / self.rate_hz, now_s)
            self.publish()


class StandIn:
    """A robot on a node."""

    def __init__(self, node: Node, interface: Interface) -> None:
        self._node, self._interface, self._random = node, interface, Random(7)
        self.motion = Motion(interface)
        self._periodic: list[Periodic] = []
        self._late: deque[tuple[float, Odometry]] = deque()
        self._heard_s = self._heard_at_s = -inf
        velocities = interface.velocities
        kind = TwistStamped if velocities.stamped else Twist
        node.create_subscription(kind, velocities.topic, self._on_velocity, quality())
        source = interface.odometry
        self._odometry = OdometryMessages(source, self._random)
        self._tell_odometry = self._odometry_teller()
        self._add(source.rate_hz, self._measure)
        self._add_sensors()
        if interface.emergency_stop is not None:
            self._add_emergency_stop(interface.emergency_stop)
        # The last: what was measured is there before the time at which it was.
        clock = node.create_publisher(Clock, "/clock", quality())
        self._add(CLOCK_HZ, lambda: clock.publish(Clock(clock=time_message(self.motion.now_s))))

    def _odometry_teller(self) -> Callable[[Odometry], None]:
        """Return what publishes odometry: on its topic, or on /tf beside the map's transform."""
        source, found = self._interface.odometry, self._interface.localization
        if found is None:
            qos = quality(best_effort=source.best_effort)
            return self._node.create_publisher(Odometry, source.topic, qos).publish
        from tf2_msgs.msg import TFMessage  # only where it is built or installed

        tf = self._node.create_publisher(TFMessage, "/tf", quality())
        lost: list[bool] = []

        def map_transform() -> None:
            odom_in_map = found.then if abs(self.motion.x_m) > found.jump_m else found.first
            if not lost:
                tf.publish(
                    TFMessage(transforms=[transform(self.motion, "map", "odom", odom_in_map)])
                )

        def lose(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            lost.append(True)
            response.success = True
            return response

        self._add(found.rate_hz, map_transform)
        self._node.create_service(Trigger, found.lose, lose)
        return lambda message: tf.publish(TFMessage(transforms=[odometry_transform(message)]))

    def _add(self, rate_hz: float, publish: Callable[[], None]) -> None:
        self._periodic.append(Periodic(rate_hz, publish))

    def _add_topic(
        self, kind: type, topic: str, rate_hz: float, best_effort: bool, make: Callable[[], Any]
    ) -> None:
        publisher = self._node.create_publisher(kind, topic, quality(best_effort=best_effort))
        self._add(rate_hz, lambda: publisher.publish(make()))

    def _add_sensors(self) -> None:
        robot, motion, random = self._interface, self.motion, self._random
        if (imu := robot.imu) is not None:
            make: Callable[[], Any] = lambda: imu_message(imu, motion, random)  # noqa: E731
            self._add_topic(Imu, imu.topic, imu.rate_hz, imu.best_effort, make)
        if (joints := robot.joints) is not None:
            make = lambda: joints_message(joints, motion, random)  # noqa: E731
            self._add_topic(JointState, joints.topic, joints.rate_hz, False, make)
        if (battery := robot.battery) is not None:
            make = lambda: battery_message(battery, motion)  # noqa: E731
            kind = Float32 if battery.voltage_only else BatteryState
            self._add_topic(kind, battery.topic, battery.rate_hz, battery.best_effort, make)
        if robot.scan_hz:
            make = lambda: scan_message(motion, robot.scan_hz)  # noqa: E731
            self._add_topic(LaserScan, "scan", robot.scan_hz, True, make)
        if (camera := robot.camera) is not None:
            publisher = self._node.create_publisher(Image, camera.topic, quality(best_effort=True))

            def publish() -> None:
                if publisher.get_subscription_count():
                    publisher.publish(image_message(camera, motion))

            self._add(CAMERA_HZ, publish)

    def _add_emergency_stop(self, source: EmergencyStopSource) -> None:
        publisher = self._node.create_publisher(
            Bool, source.topic, quality(best_effort=not source.latched, latched=source.latched)
        )

        def publish() -> None:
            publisher.publish(Bool(data=self.motion.stopped))

        def trigger(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.motion.stopped = response.success = True
            publish()
            print("stopped by its service", flush=True)
            return response

        def reset(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success = not any(self.motion.commanded)
            if response.success:
                self.motion.stopped = False
                publish()
            else:
                response.message = "commands are not zero"
            return response

        if source.latched:
            publish()
        else:
            self._add(EMERGENCY_STOP_HZ, publish)
        if source.trigger:
            self._node.create_service(Trigger, source.trigger, trigger)
            self._node.create_service(Trigger, source.reset, reset)

    def _on_velocity(self, message: Twist | TwistStamped) -> None:
        velocities, now_s = self._interface.velocities, self.motion.now_s
        self._heard_s, self._heard_at_s = now_s, time.monotonic()
        twist = message
        if isinstance(message, TwistStamped):
            stamp, twist = message.header.stamp, message.twist
            age_s = now_s - stamp.sec - stamp.nanosec * 1e-9
            if velocities.age_checked and stamp != Clock().clock and age_s > velocities.timeout_s:
                log = self._node.get_logger()  # type: ignore[no-untyped-call]
                log.warning(f"velocity ignored: it is {age_s:.3f} s old")
                return
        travel_mps, rotate_radps = twist.linear.x, twist.angular.z
        if quantum := velocities.quantum:
            travel_mps, rotate_radps = (
                int(each / quantum) * quantum for each in (travel_mps, rotate_radps)
            )
        self.motion.command(travel_mps, rotate_radps)

    def _measure(self) -> None:
        source = self._interface.odometry
        late_s = source.age_s + abs(self._random.gauss(0, source.jitter_s))
        self._late.append((self.motion.now_s + late_s, self._odometry.message(self.motion)))

    @property
    def driven(self) -> bool:
        """Whether velocities are sent, zero or not."""
        return self.motion.now_s - self._heard_s < UNANSWERED_S

    @property
    def waits(self) -> bool:
        """Whether it expects a velocity."""
        patience_s = PATIENCE_S if any(self.motion.commanded) else ENDED_S
        return not self.driven and time.monotonic() - self._heard_at_s < patience_s

    def step(self) -> None:
        self.motion.step()
        now_s = self.motion.now_s
        for each in self._periodic:
            each.poll(now_s)
        while self._late and self._late[0][0] <= now_s:
            self._tell_odometry(self._late.popleft()[1])


def run(name: str, speed: float, rest_speed: float) -> None:
    interface = INTERFACES[name]
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ended.append(number))
    with ros_node(name, interface.namespace) as node, single_threaded(node) as executor:
        robot = StandIn(node, interface)
        print(f"{interface.about} is there", flush=True)
        due_s = time.monotonic()
        while not ended:
            executor.spin_once(timeout_sec=POLL_S)
            now_s = time.monotonic()
            due_s = max(due_s, now_s - BEHIND_S)
            while due_s <= now_s and not robot.waits:
                robot.step()
                due_s += STEP_S / (speed if robot.driven else rest_speed)
        motion = robot.motion
        print(
            f"odometry: {motion.x_m:.4f} m, {motion.y_m:.4f} m,"
            f" {degrees(motion.odometry_rad):.3f} deg",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("robot", choices=sorted(INTERFACES))
    parser.add_argument("--speed", type=float, default=1.0, help="of its time")
    parser.add_argument("--rest-speed", type=float, help="the same at rest")
    given = parser.parse_args()
    take_priority()
    run(given.robot, given.speed, given.rest_speed or given.speed)


if __name__ == "__main__":
    main()
