"""Messages into facts: exact where they are good, refused where they cannot be."""

from math import inf, nan, pi

import pytest
from geometry_msgs.msg import Quaternion
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import BatteryState, CompressedImage

from adapters.ros import MessageError, conversions, odometry_message
from adapters.ros.conversions import quaternion
from executive.geometry import Pose, Velocity
from executive.state.status import Odometry

UPRIGHT = pi / 2 - 0.01
turns = st.floats(-pi, pi)
tilts = st.floats(-UPRIGHT, UPRIGHT)
lengths = st.floats(-1e4, 1e4)
JPEG = b"\xff\xd8\xff\xe0 and so on"


@given(heading_rad=turns, roll_rad=tilts, pitch_rad=tilts)
def test_angles_come_back_from_the_rotation_made_of_them(
    heading_rad: float, roll_rad: float, pitch_rad: float
) -> None:
    pose = Pose(heading_rad=heading_rad, roll_rad=roll_rad, pitch_rad=pitch_rad)
    roll, pitch, heading = conversions.angles(quaternion(pose))
    assert (roll, pitch) == pytest.approx((roll_rad, pitch_rad), abs=1e-6)
    assert (heading - heading_rad + pi) % (2 * pi) - pi == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("x", "y", "z", "w", "expected"),
    [
        (0.0, 0.0, 0.0, 1.0, (0.0, 0.0, 0.0)),
        (0.0, 0.0, 1.0, 0.0, (0.0, 0.0, pi)),
        (0.0, 0.0, 0.5**0.5, 0.5**0.5, (0.0, 0.0, pi / 2)),
        (0.5**0.5, 0.0, 0.0, 0.5**0.5, (pi / 2, 0.0, 0.0)),
        (0.0, 0.5**0.5, 0.0, 0.5**0.5, (0.0, pi / 2, 0.0)),
        (0.0, 0.0, -(0.5**0.5) * 1.002, -(0.5**0.5) * 1.002, (0.0, 0.0, pi / 2)),
    ],
)
def test_angles_of_known_rotations(
    x: float, y: float, z: float, w: float, expected: tuple[float, float, float]
) -> None:
    assert conversions.angles(Quaternion(x=x, y=y, z=z, w=w)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    "rotation",
    [
        Quaternion(w=0.0),
        Quaternion(w=1.1),
        Quaternion(w=nan),
        Quaternion(x=nan),
        Quaternion(z=inf),
        Quaternion(w=1e200, x=1e200),
    ],
)
def test_what_is_no_rotation_is_refused(rotation: Quaternion) -> None:
    with pytest.raises(MessageError, match="no rotation"):
        conversions.angles(rotation)


@given(
    x_m=lengths,
    y_m=lengths,
    z_m=lengths,
    heading_rad=turns,
    travel_mps=st.floats(-5, 5),
    rotate_radps=st.floats(-5, 5),
    stamp_ns=st.integers(0, 2**31 * 10**9 - 1),
)
def test_odometry_comes_through(
    x_m: float,
    y_m: float,
    z_m: float,
    heading_rad: float,
    travel_mps: float,
    rotate_radps: float,
    stamp_ns: int,
) -> None:
    sent = Odometry(
        stamp_ns * 1e-9, Pose(x_m, y_m, z_m, heading_rad), Velocity(travel_mps, rotate_radps)
    )
    received = conversions.odometry_fact(odometry_message(sent))
    assert received.velocity == sent.velocity
    assert received.stamp_s == pytest.approx(sent.stamp_s, abs=1e-6)
    assert received.pose.point == sent.pose.point
    assert received.pose.z_m == z_m


@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize(
    "path",
    [
        "pose.pose.position.x",
        "pose.pose.position.y",
        "pose.pose.position.z",
        "pose.pose.orientation.x",
        "pose.pose.orientation.w",
        "twist.twist.linear.x",
        "twist.twist.angular.z",
    ],
)
def test_odometry_with_a_figure_that_is_none_is_refused(path: str, value: float) -> None:
    message = OdometryMessage()
    *way, last = path.split(".")
    part = message
    for name in way:
        part = getattr(part, name)
    setattr(part, last, value)
    with pytest.raises(MessageError):
        conversions.odometry_fact(message)


def test_a_battery_that_is_not_measured_is_refused() -> None:
    assert conversions.battery_fact(BatteryState(voltage=25.5)).voltage_v == 25.5
    with pytest.raises(MessageError, match="battery voltage is nan"):
        conversions.battery_fact(BatteryState(voltage=nan))


def test_a_frame_is_told_by_its_octets() -> None:
    message = CompressedImage(format="rgb8; jpeg compressed bgr8", data=list(JPEG))
    message.header.stamp.sec = 7
    frame = conversions.frame_fact(message)
    assert (frame.format, frame.data, frame.stamp_s) == ("JPG", JPEG, 7.0)
    png = conversions.frame_fact(CompressedImage(data=list(b"\x89PNG\r\n\x1a\n...")))
    assert png.format == "PNG"


@pytest.mark.parametrize("data", [b"", b"\xff\xd8", b"GIF89a"])
def test_octets_of_no_picture_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError, match="neither JPEG nor PNG"):
        conversions.frame_fact(CompressedImage(format="jpeg", data=list(data)))
