"""`python -m tests.benchmarks.stop_load KIND PORT FOLDER`: what else an executive has to do.

It says when the load is on, and now and then how much it has been.
"""

import asyncio
import os
import resource
import sys
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from adapters.mal import InteractionStage, MalError, Subscription
from adapters.mrs.ground import MrsClient
from executive.commands.catalogue import SetTravelSpeed
from tests.benchmarks.octets import Octets

LOADS: Final = "loads"
RATE: Final = "so many: "
FILE: Final = "50mb.bin"
COMMANDS_PER_S: Final = 1200
AT_ONCE: Final = 16
CONNECTIONS: Final = 1500
ELEMENTS: Final = 250_000
LARGE_AT_ONCE: Final = 4
DEAF: Final = 40
OTHER_HZ: Final = 50
OTHER_MPS: Final = 0.5
REGISTRATIONS_EACH: Final = 255
REPORT_S: Final = 1.0
YIELDS: Final = 10
"""Niceness: the load stands for other computers, and is to take no time of the rover's."""
PAUSE_S: Final = 0.5


class Count:
    """Counts, and says how many a second there were."""

    def __init__(self) -> None:
        self._count, self._since_s = 0, time.monotonic()

    def one(self) -> None:
        self._count += 1
        now_s = time.monotonic()
        if now_s - self._since_s >= REPORT_S:
            print(f"{RATE}{self._count / (now_s - self._since_s):.0f}", flush=True)
            self._count, self._since_s = 0, now_s


def _loads() -> None:
    print(LOADS, flush=True)


async def fetch(port: int, folder: Path) -> None:
    """Fetch a file of 50 MB over and over."""
    count = Count()
    async with await MrsClient.connect(f"127.0.0.1:{port}", "fetcher") as client:
        _loads()
        while True:
            with suppress(MalError):
                await client.retrieve_file(FILE, folder / "fetched")
                count.one()
                (folder / "fetched").unlink()


async def command(port: int, _: Path) -> None:
    """Send commands at a steady rate, each when its time has come."""
    count, began_s = Count(), time.monotonic()
    numbers = iter(range(1 << 30))
    async with await MrsClient.connect(f"127.0.0.1:{port}", "busy") as client:
        _loads()

        async def some() -> None:
            for number in numbers:
                early_s = began_s + number / COMMANDS_PER_S - time.monotonic()
                if early_s > 0:
                    await asyncio.sleep(early_s)
                with suppress(MalError):
                    await client.submit(client.command(SetTravelSpeed(0.5)))
                count.one()

        await asyncio.gather(*(some() for _ in range(AT_ONCE)))


async def connect(port: int, _: Path) -> None:
    """Hold connections, each of which has asked for something once."""
    resource.setrlimit(
        resource.RLIMIT_NOFILE, (4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1])
    )
    with Octets(port) as octets:
        requests = octets.message("Status", "getStatus", InteractionStage.REQUEST)
    held = []
    for _each in range(CONNECTIONS):
        with suppress(OSError):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(requests)
            held.append((reader, writer))
    _loads()
    print(f"{RATE}{len(held)}", flush=True)
    await asyncio.Event().wait()


async def send_large(port: int, _: Path) -> None:
    """Send messages of 1 MB, whose many elements have to be decoded one by one."""
    count = Count()

    def one_after_the_other() -> None:
        while True:
            with suppress(OSError), Octets(port, "large") as octets:
                large = octets.message(
                    "Monitoring", "getValue", InteractionStage.REQUEST, ("",) * ELEMENTS
                )
                while True:
                    octets.send(large)
                    octets.reply()
                    count.one()
            time.sleep(PAUSE_S)

    _loads()
    await asyncio.gather(*(asyncio.to_thread(one_after_the_other) for _ in range(LARGE_AT_ONCE)))


async def register(port: int, _: Path) -> None:
    """Register for all telemetry over and over, on connections that are never read."""
    held = []
    for _each in range(DEAF):
        octets = Octets(port, "deaf")
        held.append(octets)
        with suppress(OSError):
            for number in range(REGISTRATIONS_EACH):
                subscription = Subscription(subscriptionId=str(number))
                octets.send(
                    octets.message(
                        "Monitoring", "monitorValue", InteractionStage.REGISTER, subscription
                    )
                )
    _loads()
    await asyncio.Event().wait()


async def publish(topic: str) -> None:
    """Publish velocities on a topic of the rover, whatever anybody else does."""
    from geometry_msgs.msg import TwistStamped

    from adapters.ros import ros_node
    from executive.settings import config_folder

    count, velocity = Count(), TwistStamped()
    velocity.twist.linear.x = OTHER_MPS
    parameters = config_folder() / "jackal.ros.yaml"
    with ros_node("other", "jackal", parameters=parameters) as node:
        publisher = node.create_publisher(TwistStamped, topic, 1)
        _loads()
        next_s = time.monotonic()
        while True:
            publisher.publish(velocity)
            count.one()
            next_s += 1 / OTHER_HZ
            await asyncio.sleep(next_s - time.monotonic())


async def external(_: int, __: Path) -> None:
    """Publish on the input of the mux below the executive's."""
    await publish("cmd_vel")


async def joystick(_: int, __: Path) -> None:
    """Publish on the input of the mux above the executive's."""
    await publish("joy_teleop/cmd_vel")


KINDS: Final[dict[str, Callable[[int, Path], Awaitable[None]]]] = {
    each.__name__: each
    for each in (fetch, command, connect, send_large, register, external, joystick)
}


if __name__ == "__main__":
    os.nice(YIELDS)
    asyncio.run(KINDS[sys.argv[1]](int(sys.argv[2]), Path(sys.argv[3])))  # type: ignore[arg-type]
