"""Facts as ROS messages, for what stands where a rover publishes them itself."""

from math import cos, sin
from typing import Final

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion
from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import BatteryState

from executive.facts import Battery, Odometry
from executive.geometry import Pose

ODOM: Final = "odom"
BASE_LINK: Final = "base_link"


def time_message(time_s: float) -> Time:
    """Return seconds as a stamp."""
    nanoseconds = round(time_s * 1e9)
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def quaternion(pose: Pose) -> Quaternion:
    """Return roll, pitch and heading as a rotation."""
    cr, sr = cos(pose.roll_rad / 2), sin(pose.roll_rad / 2)
    cp, sp = cos(pose.pitch_rad / 2), sin(pose.pitch_rad / 2)
    ch, sh = cos(pose.heading_rad / 2), sin(pose.heading_rad / 2)
    return Quaternion(
        x=sr * cp * ch - cr * sp * sh,
        y=cr * sp * ch + sr * cp * sh,
        z=cr * cp * sh - sr * sp * ch,
        w=cr * cp * ch + sr * sp * sh,
    )


def odometry_message(fact: Odometry) -> OdometryMessage:
    """Return pose and velocity of base_link in the odometry frame."""
    message = OdometryMessage()
    message.header.stamp = time_message(fact.stamp_s)
    message.header.frame_id = ODOM
    message.child_frame_id = BASE_LINK
    place = message.pose.pose.position
    place.x, place.y, place.z = fact.pose.x_m, fact.pose.y_m, fact.pose.z_m
    message.pose.pose.orientation = quaternion(fact.pose)
    message.twist.twist.linear.x = fact.velocity.travel_mps
    message.twist.twist.angular.z = fact.velocity.rotate_radps
    return message


def battery_message(fact: Battery, time_s: float) -> BatteryState:
    """Return the voltage; what is not measured is NaN, as the message type asks."""
    unknown = float("nan")
    message = BatteryState(
        voltage=fact.voltage_v,
        temperature=unknown,
        current=unknown,
        charge=unknown,
        capacity=unknown,
        design_capacity=unknown,
        percentage=unknown,
        power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_LION,
        present=True,
    )
    message.header.stamp = time_message(time_s)
    return message
