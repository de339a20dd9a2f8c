"""`rover-sim --asset mocup` at the end of its cable: pyusb, rover-nxt and an executive."""

import asyncio
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from adapters.mocup.brick.usb import PACKET, Brick, BrickError, UsbAddress
from adapters.mops.codec import Message, MopsStream, encode
from adapters.mrs.ground.client import MrsClient
from adapters.mrs.ground.outcome import Outcome
from executive.commands.catalogue import MoveForward, Request, SetCameraAngles, Stop
from sim.brick.nxt import IN, OUT, PRODUCT, VENDOR, SocketBackend
from tests.brick.rig import SPELLING, command, is_end
from tests.support.processes import Running, executive, simulation

pytestmark = pytest.mark.ros

LIMIT_S = 90.0
ADDRESS = UsbAddress(VENDOR, PRODUCT, 0, OUT, IN)
MOCUP = ("--asset", "mocup")
LOOK = SetCameraAngles(0.2, 0.1)
"""Asked for again until it is done: afterwards ROS has found who hears whom."""


@pytest.fixture
def cable(ros_domain: int, tmp_path: Path) -> Path:
    """Give where the brick is plugged in, in a ROS domain of this test's own."""
    assert ros_domain
    return tmp_path / "usb"


@contextmanager
def rover(cable: Path) -> Iterator[Running]:
    arguments = (*MOCUP, "--usb-socket", str(cable), "--camera", "rays")
    with simulation(cable.parent, *arguments) as process:
        yield process


@contextmanager
def rover_nxt(cable: Path, name: str = "nxt") -> Iterator[Running]:
    log = cable.parent / f"{name}.log"
    command = (sys.executable, "-m", "sim.brick.nxt", "--usb-socket", str(cable))
    process = Running(log, *command, "--data", str(cable.parent / "nxt"))
    try:
        process.said("the brick is there")
        yield process
    finally:
        process.clean_up()


def heard(brick: Brick, stream: MopsStream) -> Iterator[Message]:
    """Yield what the brick says, until the limit."""
    deadline_s = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline_s:
        packet = brick.read()
        assert len(packet) <= PACKET
        yield from stream.feed(packet)
    pytest.fail("it said no more")


def listen(brick: Brick) -> None:
    deadline_s = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline_s:
        brick.read()


def test_pyusb_finds_commands_and_hears_the_brick(cable: Path) -> None:
    stream = MopsStream(lambda line: pytest.fail(line))
    with rover(cable) as process, Brick(ADDRESS, SocketBackend(cable)) as brick:
        brick.write(encode(command("moveForward", 1, "0.05")))
        telemetry, received = 0, False
        for message in heard(brick, stream):
            telemetry += message.code == SPELLING.telemetry.code
            if message.moe_inputs_id == 1:
                received |= message.received
                if is_end(message):
                    break
        assert message.executed
        assert received
        assert telemetry > 1
        assert process.end() == 0
        with pytest.raises(BrickError):
            listen(brick)
    assert not cable.exists()


def carry_out(uri: str, *requests: Request) -> list[Outcome]:
    """Send requests one after the other, once odometry comes."""

    async def session() -> list[Outcome]:
        async with await MrsClient.connect(uri) as client:
            async for value in await client.telemetry():
                if value.name == "POS_X" and value.value is not None:
                    break
            return [await client.run(client.command(request)) for request in requests]

    return asyncio.run(asyncio.wait_for(session(), LIMIT_S))


def test_a_rover_whose_nxt_process_is_killed_stands_and_is_commanded_again(cable: Path) -> None:
    with rover(cable) as process, executive(cable.parent, *MOCUP) as (_, uri):
        with rover_nxt(cable, "first") as first:
            outcomes = carry_out(uri, LOOK, MoveForward(0.05))
            assert all(outcome.executed for outcome in outcomes), outcomes
            first.send(signal.SIGKILL)
            process.said("the brick is let go")
        with rover_nxt(cable, "second"):
            (stopped,) = carry_out(uri, Stop())
            assert stopped.executed, stopped
