"""Video through the processes that users run: camera, executive, ground."""

import asyncio
import io
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from adapters.mrs.ground import CommandOutcome, MrsClient
from adapters.mrs.spec.types import Stage
from adapters.video import JpegStream
from executive.commands.catalogue import DriveFor, ExecuteAction, Request, Stop
from tests.conftest import port_of
from tests.support.ground import call_ground, carry_out, until_located
from tests.support.processes import Running, executive, simulation
from tests.video.test_forwarder import HOST, udp_socket

pytestmark = pytest.mark.ros

ON, OFF = ExecuteAction("VIDEO ON"), ExecuteAction("VIDEO OFF")


@dataclass(frozen=True, slots=True)
class Rover:
    """An executive that forwards.

    Attributes:
        uri: its link.
        listen: the port aboard to which sources send.
    """

    process: Running
    uri: str
    listen: int

    def carry_out(self, *requests: Request) -> list[CommandOutcome]:
        return carry_out(self.uri, *requests)

    @property
    def video_on(self) -> bool:
        return call_ground(self.uri, lambda client: client.get_camera_state()).videoOn


@pytest.fixture
def ground() -> Iterator[socket.socket]:
    with udp_socket() as receiver:
        yield receiver


@contextmanager
def rover(folder: Path, ground: socket.socket, listen: int) -> Iterator[Rover]:
    to = ground.getsockname()[1]
    options = ("--video-from", f"{HOST}:{listen}", "--video-to", f"{HOST}:{to}")
    with executive(folder, *options) as (process, uri):
        yield Rover(process, uri, listen)


@pytest.fixture
def aboard(ros_domain: int, tmp_path: Path, ground: socket.socket) -> Iterator[Rover]:
    with rover(tmp_path, ground, port_of(ros_domain)) as started:
        yield started


@contextmanager
def flood(port: int) -> Iterator[None]:
    """Send as fast as one thread can."""
    over = threading.Event()

    def send() -> None:
        with udp_socket() as source:
            while not over.is_set():
                source.sendto(b"\0" * 1400, (HOST, port))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def receive_picture(ground: socket.socket) -> Image.Image:
    stream = JpegStream()
    while (picture := stream.add(ground.recv(1 << 16))) is None:
        pass
    return Image.open(io.BytesIO(picture))


def test_the_ground_receives_the_camera_picture(aboard: Rover, ground: socket.socket) -> None:
    folder = aboard.process.log.parent
    stream = ("--camera", "rays", "--video-to", f"{HOST}:{aboard.listen}")
    with simulation(folder, *stream):
        states = [aboard.video_on]
        (on,) = aboard.carry_out(ON)
        assert on.executed
        states.append(aboard.video_on)
        pixels = np.asarray(receive_picture(ground).convert("RGB"), float)
        assert pixels.shape == (480, 640, 3)
        sky, soil = pixels[:160].mean((0, 1)), pixels[320:].mean((0, 1))
        assert np.abs(sky - soil).max() > 40.0
        (off,) = aboard.carry_out(OFF)
        assert off.executed
        assert [*states, aboard.video_on] == [False, True, False]
    assert "video off: " in aboard.process.text


def test_a_stop_gets_through_while_video_floods(aboard: Rover, ground: socket.socket) -> None:
    with simulation(aboard.process.log.parent, "--camera", "off"), flood(aboard.listen):
        until_located(aboard.uri)
        (on,) = aboard.carry_out(ON)
        assert on.executed
        ground.recv(1 << 16)

        async def drive_and_stop(client: MrsClient) -> tuple[CommandOutcome, CommandOutcome]:
            moves = asyncio.Event()
            drive = asyncio.create_task(
                client.run(
                    client.command(DriveFor(0.3, 0.0, 50.0)),
                    lambda reported: (
                        moves.set() if reported.report.stage is Stage.STARTED else None
                    ),
                )
            )
            await moves.wait()
            stop = await client.run(client.command(Stop()))
            return await drive, stop

        drive, stop = call_ground(aboard.uri, drive_and_stop)
        assert stop.executed
        assert drive.stage is Stage.CANCELLED
        assert aboard.video_on
        (off,) = aboard.carry_out(OFF)
        assert off.executed
    assert "video off: " in aboard.process.text


def test_video_is_off_after_a_restart(aboard: Rover, ground: socket.socket, tmp_path: Path) -> None:
    aboard.carry_out(ON)
    assert aboard.process.end(signal.SIGKILL) == -signal.SIGKILL
    with rover(tmp_path, ground, aboard.listen) as successor:
        assert not successor.video_on
        (on,) = successor.carry_out(ON)
        assert on.executed
        with udp_socket() as source:
            source.sendto(b"again", (HOST, aboard.listen))
        assert ground.recv(100) == b"again"
        assert successor.process.end() == 0
        assert "video off: 1 datagrams, 5 octets" in successor.process.text
