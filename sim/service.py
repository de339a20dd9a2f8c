"""Puts the simulation's process together, serves it until a signal, and takes it apart."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rclpy.node import Node

from adapters.ros.context import ros_node, single_threaded
from adapters.ros.parameters import Topics, declare_topics
from adapters.ros.termination import Termination
from executive.settings import Settings
from sim.camera import Backend, PictureSettings, best_backend
from sim.ros_camera import CameraNode
from sim.ros_node import SimulationNode
from sim.rover import SimulatedRover
from sim.video import VideoStream
from sim.world import World

NODE_NAME: Final = "simulation"


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says.

    Attributes:
        rate: simulated seconds per second.
        camera: auto, egl, rays or off.
        parameters: the ROS parameter file.
        ros_arguments: what goes to ROS as it is.
        video_to: host and port that the camera streams to; None for no stream.
    """

    settings: Settings
    world: World
    seed: int
    rate: float
    camera: str
    parameters: Path
    ros_arguments: tuple[str, ...]
    video_to: tuple[str, int] | None = None


def serve(options: Options) -> None:
    """Simulate until SIGINT or SIGTERM.

    Raises:
        adapters.ros.parameters.ParameterError: a ROS parameter is missing or wrong.
        VideoError: the camera cannot be streamed as asked.
    """
    logging.basicConfig(level="INFO", format="%(levelname)-7s %(message)s")
    logging.getLogger("OpenGL").setLevel(logging.WARNING)
    asked = Termination()
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
        rover = SimulatedRover(options.world, options.seed)
        with _camera(node, topics, rover, options) as camera:
            SimulationNode(node, topics, rover, camera, options.rate)
            print(
                f"{options.settings.asset} stands in world {options.world.name},"
                f" camera: {options.camera if camera is None else camera.backend}",
                flush=True,
            )
            while not asked.requested:
                executor.spin_once()


@contextmanager
def _camera(
    node: Node, topics: Topics, rover: SimulatedRover, options: Options
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
