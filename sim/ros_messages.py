"""What only a simulation says, as ROS messages: its time, and pictures."""

import array

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CompressedImage, Image

from adapters.ros.conversions import time_message
from sim.scenery import Image as Pixels

CAMERA = "camera_optical"


def clock_message(time_s: float) -> Clock:
    """Return simulated time for /clock."""
    return Clock(clock=time_message(time_s))


def compressed_message(jpeg: bytes, time_s: float) -> CompressedImage:
    """Return a JPEG picture."""
    message = CompressedImage(format="jpeg", data=array.array("B", jpeg))
    message.header.stamp = time_message(time_s)
    message.header.frame_id = CAMERA
    return message


def image_message(pixels: Pixels, time_s: float) -> Image:
    """Return a picture of shape (height, width, 3)."""
    height, width, channels = pixels.shape
    message = Image(
        height=height,
        width=width,
        encoding="rgb8",
        step=channels * width,
        data=array.array("B", pixels.tobytes()),
    )
    message.header.stamp = time_message(time_s)
    message.header.frame_id = CAMERA
    return message
