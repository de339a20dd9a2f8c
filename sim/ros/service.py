"""Puts the simulation's process together, serves it until a signal, and takes it apart."""

import logging
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, assert_never

from rclpy.node import Node

from adapters.process import Termination
from adapters.ros import Topics, declare_topics, ros_node, single_threaded
from executive.settings import LocomotionKind, Settings, SettingsError
from sim.brick import BrickSettings, UsbPlug
from sim.ros.camera import CameraNode
from sim.ros.cargo import serve_cargo
from sim.ros.jackal import JackalOnRos
from sim.ros.node import Exchange, SimulationNode
from sim.ros.video_stream import VideoStream
from sim.rover import World
from sim.rover.body import SimulatedBody
from sim.rover.camera import Backend, PictureSettings, best_backend
from sim.rover.jackal import SimulatedJackal
from sim.rover.mocup import SimulatedMocup


class BrickOnUsb:
    """Carries octets between a brick and its host. One that is unplugged gives up what it does."""

    def __init__(self, rover: SimulatedMocup, path: Path) -> None:
        """Plug in.

        Raises:
            OSError: the socket cannot be made.
        """
        self._rover = rover
        self._plug = UsbPlug(path)
        self._connected = False

    def exchange(self) -> None:
        """Carry what waits, both ways. Never blocks; called once a period."""
        octets = self._plug.receive()
        if octets:
            self._rover.hear(octets)
        if self._connected and not self._plug.connected:
            self._rover.brick.unplug()
        if self._connected != self._plug.connected:
            self._connected = self._plug.connected
            _LOG.info("the brick is %s", "claimed" if self._connected else "let go")
        self._plug.send(self._rover.brick.give())

    def close(self) -> None:
        """Unplug."""
        self._plug.close()


NODE_NAME: Final = "simulation"
_LOG: Final = logging.getLogger(__name__)


class UsbError(SettingsError):
    """The brick cannot be plugged in; the text says why."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says.

    Attributes:
        speed: simulated seconds per second.
        camera: auto, egl, rays or off.
        parameters: the ROS parameter file.
        ros_arguments: what goes to ROS as it is.
        video_to: host and port that the camera streams to; None for no stream.
        usb: where the brick of a rover that has one is plugged in.
    """

    settings: Settings
    world: World
    seed: int
    speed: float
    camera: str
    parameters: Path
    ros_arguments: tuple[str, ...]
    video_to: tuple[str, int] | None = None
    usb: Path = Path("usb")


def serve(options: Options) -> None:
    """Simulate until SIGINT or SIGTERM.

    Raises:
        adapters.ros.parameters.ParameterError: a ROS parameter is missing or wrong.
        VideoError: the camera cannot be streamed as asked.
        UsbError: the brick cannot be plugged in there.
    """
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
        rover, exchange = _rover(node, topics, options)
        serve_cargo(node, rover)
        with closing(exchange), _camera(node, topics, rover, options) as camera:
            SimulationNode(node, topics, rover, exchange, camera, options.speed)
            print(
                f"{options.settings.asset} stands in world {options.world.name},"
                f" camera: {options.camera if camera is None else camera.backend}",
                flush=True,
            )
            while not asked.requested:
                executor.spin_once()


def _rover(node: Node, topics: Topics, options: Options) -> tuple[SimulatedBody, Exchange]:
    """Return the rover of an asset, and how it is spoken to: its settings choose both."""
    world, seed, settings = options.world, options.seed, options.settings
    match settings.locomotion:
        case LocomotionKind.VELOCITY:
            jackal = SimulatedJackal(world, seed)
            return jackal, JackalOnRos(node, topics, jackal)
        case LocomotionKind.WHOLE_MOTION:
            mocup = SimulatedMocup(world, seed, brick=BrickSettings(name=settings.asset.upper()))
            return mocup, _plugged_in(mocup, options.usb)
        case _:
            assert_never(settings.locomotion)


def _plugged_in(mocup: SimulatedMocup, usb: Path) -> BrickOnUsb:
    try:
        brick = BrickOnUsb(mocup, usb)
    except OSError as error:
        raise UsbError(f"--usb-socket {usb}: {error.strerror or error}") from error
    _LOG.info("the brick is plugged in at %s", usb)
    return brick


@contextmanager
def _camera(
    node: Node, topics: Topics, rover: SimulatedBody, options: Options
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
