"""The camera of the ROS simulation: renders on a thread of its own, and only for subscribers.

Physics hands over a copy of its state and continues; a picture that is not ready in time is
skipped.
"""

import array
import threading
from dataclasses import replace
from typing import Final

import mujoco
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from adapters.ros import CAMERA_OPTICAL, Topics, time_message
from sim.ros.video_stream import VideoStream
from sim.rover import Image as Pixels
from sim.rover.body import CameraView, SimulatedBody
from sim.rover.camera import Camera, PictureSettings, encode_jpeg, focal_px


def compressed_message(jpeg: bytes, time_s: float) -> CompressedImage:
    """Return a JPEG picture."""
    return CompressedImage(header=_header(time_s), format="jpeg", data=array.array("B", jpeg))


def image_message(pixels: Pixels, time_s: float) -> Image:
    """Return a picture of shape (height, width, 3)."""
    height, width, channels = pixels.shape
    return Image(
        header=_header(time_s),
        height=height,
        width=width,
        encoding="rgb8",
        step=channels * width,
        data=array.array("B", pixels.tobytes()),
    )


def info_message(width: int, height: int, f_px: float, time_s: float) -> CameraInfo:
    """Return the projection of the camera: a pinhole of this focal length, without distortion."""
    x_px, y_px = (width - 1) / 2, (height - 1) / 2
    return CameraInfo(
        header=_header(time_s),
        width=width,
        height=height,
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=[f_px, 0.0, x_px, 0.0, f_px, y_px, 0.0, 0.0, 1.0],
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[f_px, 0.0, x_px, 0.0, 0.0, f_px, y_px, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def _header(time_s: float) -> Header:
    return Header(stamp=time_message(time_s), frame_id=CAMERA_OPTICAL)


CAMERA_INFO: Final = "camera/camera_info"


class CameraNode:
    """Publishes pictures, raw and compressed, if they have subscribers, and streams them.

    `request_picture` and `close` are for the thread that runs physics.

    Attributes:
        backend: renderer of the pictures.
    """

    def __init__(
        self,
        node: Node,
        topics: Topics,
        rover: SimulatedBody,
        settings: PictureSettings,
        video: VideoStream | None = None,
    ) -> None:
        self._pictures = [
            node.create_publisher(topic.type, topic.name, topic.qos)
            for topic in (topics.camera, topics.camera_raw)
            if topic is not None
        ]
        self._info = node.create_publisher(CameraInfo, CAMERA_INFO, 1)
        self._video = video
        self._rover = rover
        self._settings = settings
        self.backend = settings.backend
        self._state = mujoco.MjData(rover.model)
        mujoco.mj_copyData(self._state, rover.model, rover.data)
        self._seen = CameraView(self._state, 0.0)
        self._ready, self._offered = threading.Event(), threading.Event()
        self._closing = self._streaming = False
        self._thread = threading.Thread(target=self._render_loop, name="camera")
        self._thread.start()
        self._ready.wait()

    def request_picture(self) -> None:
        """Request a picture, if it has a receiver and the last one is done."""
        view = self._rover.view
        if view is None or self._offered.is_set() or not self._watched():
            return
        mujoco.mj_copyData(self._state, self._rover.model, view.data)
        self._seen = replace(view, data=self._state)
        self._offered.set()

    def close(self) -> None:
        """End the thread."""
        self._closing = True
        self._offered.set()
        self._thread.join()

    def _watched(self) -> bool:
        publishers = (*self._pictures, self._info)
        subscribed = any(publisher.get_subscription_count() for publisher in publishers)
        self._streaming = self._video is not None and self._video.watched
        return subscribed or self._streaming

    def _render_loop(self) -> None:
        camera = Camera(self._rover.model, self._settings)  # OpenGL is freed on its own thread
        camera.image(self._state)
        self.backend = camera.backend
        self._ready.set()
        while True:
            self._offered.wait()
            if self._closing:
                return
            self._publish(camera)
            self._offered.clear()

    def _publish(self, camera: Camera) -> None:
        seen = self._seen
        if self._info.get_subscription_count():
            width, height = self._settings.width, self._settings.height
            f_px = focal_px(self._rover.model, height)
            self._info.publish(info_message(width, height, f_px, seen.time_s))
        pixels = camera.image(seen.data)
        subscribed = [each for each in self._pictures if each.get_subscription_count()]
        jpeg = b""
        if self._streaming or any(each.msg_type is CompressedImage for each in subscribed):
            jpeg = encode_jpeg(pixels)[: seen.octets]
        if self._video is not None and self._streaming and seen.octets is None:
            self._video.send(jpeg, seen.time_s)
        for publisher in subscribed:
            if publisher.msg_type is Image:
                publisher.publish(image_message(pixels, seen.time_s))
            else:
                publisher.publish(compressed_message(jpeg, seen.time_s))
