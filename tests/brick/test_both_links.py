"""The same command by the direct link and by the relay's topics: MOCUP does it once."""

import asyncio
import signal
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from typing import TypeVar

import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String, UInt64

from adapters.mops.codec import Message, decode, fingerprint
from adapters.mops.dictionary import CommandConditions, load_dictionary
from adapters.mrs.ground.client import MrsClient
from adapters.mrs.spec import ReceivedReport
from adapters.mrs.spec.types import Stage
from adapters.ros import Topic, publish_heartbeat, ros_node, single_threaded
from executive.commands.catalogue import (
    Command,
    MoveForward,
    RotateBy,
    SetCameraAngles,
    SetTravelSpeed,
    Stop,
)
from executive.values.reports import Identity
from tests.support.processes import Running, executive, simulation

pytestmark = [pytest.mark.ros, pytest.mark.slow]

LIMIT_S = 60.0
MOCUP = ("--asset", "mocup")
DISTANCE_M = 0.2
DICTIONARY = load_dictionary()
T = TypeVar("T")


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
        process.output("brick connected")
        yield process
    finally:
        process.clean_up()


class RelayEnd:
    """What `rover-relay` is to `rover-nxt`: three topics, and a heartbeat."""

    def __init__(self, node: Node) -> None:
        self._commands = node.create_publisher(String, "mops/relay/command", 100)
        publish_heartbeat(node, Topic("mops/relay/command", String, QoSProfile(depth=1)))  # type: ignore[no-untyped-call]
        self.received: list[Message] = []
        self._stored = node.create_publisher(UInt64, "mops/relay/notification_ack", 100)
        node.create_subscription(String, "mops/relay/notification", self._receive, 100)

    def send(self, command: Command) -> None:
        conditions = CommandConditions(command.authority)
        message = DICTIONARY.command(command.request, command.identity, "MOCUP", conditions)
        self._commands.publish(String(data=str(message)))

    async def ended(self, command: Command) -> str:
        """Send a command until its end is heard, and return that."""
        return await self.until_received(command, "EXECUTED", "REJECTED")

    async def until_received(self, command: Command, *stages: str) -> str:
        """Send a command until one of these stages is its last one, and return that."""
        async with asyncio.timeout(LIMIT_S):
            while not (received := self.stages(command)) or received[-1] not in stages:
                self.send(command)
                await asyncio.sleep(0.2)
        return received[-1]

    def stages(self, command: Command) -> list[str]:
        number = command.identity.command_id
        return [m.outputs[0] for m in self.received if m.moe_inputs_id == number]

    async def until(self, done: Callable[[], bool]) -> None:
        async with asyncio.timeout(LIMIT_S):
            while not done():
                await asyncio.sleep(0.01)

    async def executed(self, command: Command) -> None:
        await self.until(lambda: self.stages(command)[-1:] == ["EXECUTED"])

    @property
    def ready(self) -> bool:
        return self._commands.get_subscription_count() > 0 and bool(self.received)

    def _receive(self, text: String) -> None:
        self.received.append(decode(text.data.encode()))
        self._stored.publish(UInt64(data=fingerprint(text.data)))


@contextmanager
def relay_end() -> Iterator[RelayEnd]:
    """Give an end of the relay that is served on a thread of its own."""
    with ros_node("relay_end", "mocup") as node, single_threaded(node) as executor:
        ended = Event()

        def serve() -> None:
            while not ended.is_set():
                executor.spin_once(0.05)

        relay, thread = RelayEnd(node), Thread(target=serve)
        thread.start()
        try:
            yield relay
        finally:
            ended.set()
            thread.join()


@asynccontextmanager
async def ground(uri: str, relay: RelayEnd) -> AsyncIterator[MrsClient]:
    async with await MrsClient.connect(uri) as client:
        async with asyncio.timeout(LIMIT_S):
            async for value in await client.telemetry():
                if value.name == "POS_X" and value.value is not None:
                    break
        await relay.until(lambda: relay.ready)
        await relay.until(lambda: any(m.command == "HOUSEKEEPING" for m in relay.received))
        yield client


async def along(client: MrsClient) -> float:
    (x,) = await client.get_value("POS_X")
    assert isinstance(x.value, float)
    return x.value


async def active(client: MrsClient, start_m: float) -> None:
    """Wait until the rover has gone a little way."""
    async with asyncio.timeout(LIMIT_S):
        while abs(await along(client) - start_m) < 0.1:
            await asyncio.sleep(0.01)


def both(cable: Path, session: Callable[[MrsClient, RelayEnd], Awaitable[T]]) -> T:
    """Play a session with a client of the direct link and the end of the relay."""

    async def play(uri: str, relay: RelayEnd) -> T:
        async with ground(uri, relay) as client:
            return await session(client, relay)

    with (
        rover(cable),
        rover_nxt(cable),
        executive(cable.parent, *MOCUP) as (_, uri),
        relay_end() as relay,
    ):
        return asyncio.run(play(uri, relay))


async def directly_first(client: MrsClient, relay: RelayEnd) -> None:
    start_m = await along(client)
    command, waiting = client.command(MoveForward(DISTANCE_M)), client.command(MoveForward(0.1))
    reported: list[ReceivedReport] = []
    ends = [asyncio.create_task(client.run(each, reported.append)) for each in (command, waiting)]
    await relay.until(lambda: any(each.report.stage is Stage.STARTED for each in reported))
    relay.send(command)
    relay.send(waiting)
    await relay.until(lambda: all(end.done() for end in ends))
    for each in (command, waiting):
        await relay.executed(each)
    assert all(end.result().executed for end in ends)
    assert relay.stages(command)[-2:] == ["STARTED", "EXECUTED"]
    assert relay.stages(waiting)[-2:] == ["STARTED", "EXECUTED"]
    assert await along(client) - start_m == pytest.approx(DISTANCE_M + 0.1, abs=0.03)
    async with asyncio.timeout(LIMIT_S):
        async for value in await client.telemetry():
            if value.name == "NXT_COMMANDS" and value.value:
                break


async def by_the_relay_first(client: MrsClient, relay: RelayEnd) -> None:
    start_m = await along(client)
    move, poll = client.command(MoveForward(-0.5)), client.command(SetCameraAngles(0.3, 0.1))
    for command in (move, poll):
        relay.send(command)
        if command is move:
            await relay.until(lambda: "STARTED" in relay.stages(move))
            await active(client, start_m)
        else:
            await relay.executed(poll)
        end = asyncio.create_task(client.run(command))
        await relay.until(end.done)
        assert end.result().executed
        if command is move:
            assert "received over another link first" in end.result().reports[-1].text
        await relay.executed(command)
    assert await along(client) - start_m == pytest.approx(-0.5, abs=0.03)


async def at_once_by_the_relay(client: MrsClient, relay: RelayEnd) -> None:
    """What waited together in an eclipse: the brick takes one at a time."""
    start_m = await along(client)
    requests = (
        SetTravelSpeed(0.2),
        MoveForward(0.1),
        SetCameraAngles(0.0, 0.2),
        RotateBy(0.1),
        RotateBy(-0.1),
    )
    commands = [client.command(request) for request in requests]
    relay.received.clear()
    for command in commands:
        relay.send(command)
    await relay.executed(commands[-1])
    numbers = [command.identity.command_id for command in commands]
    assert [m.moe_inputs_id for m in relay.received if m.executed] == numbers
    for command in commands[1:]:
        assert relay.stages(command)[0] == "RECEIVED"
    assert await along(client) - start_m == pytest.approx(0.1, abs=0.03)


async def stopped_by_the_relay(client: MrsClient, relay: RelayEnd) -> None:
    start_m = await along(client)
    reported: list[ReceivedReport] = []
    ends = [
        asyncio.create_task(client.run(client.command(MoveForward(2.0)), reported.append))
        for _ in range(2)
    ]
    await relay.until(lambda: any(each.report.stage is Stage.STARTED for each in reported))
    relay.send(client.command(Stop()))
    await relay.until(lambda: all(end.done() for end in ends))
    assert [end.result().stage for end in ends] == [Stage.CANCELLED, Stage.CANCELLED]
    again = client.command(MoveForward(0.1))
    relay.send(again)
    await relay.executed(again)
    assert abs(await along(client) - start_m) < 1.0


def test_a_command_by_both_links_is_executed_once_and_reported_on_both(cable: Path) -> None:
    async def session(client: MrsClient, relay: RelayEnd) -> None:
        await directly_first(client, relay)
        await by_the_relay_first(client, relay)
        await at_once_by_the_relay(client, relay)
        await stopped_by_the_relay(client, relay)

    both(cable, session)


def test_the_relay_receives_the_end_despite_failures_of_executive_and_rover_nxt(
    cable: Path,
) -> None:
    with (
        rover(cable),
        rover_nxt(cable) as nxt,
        executive(cable.parent, *MOCUP) as (killed, uri),
        relay_end() as relay,
    ):

        async def begin() -> Command:
            async with ground(uri, relay) as client:
                command = client.command(MoveForward(2.0))
                await client.submit(command)
                relay.send(command)
                await relay.until(lambda: "STARTED" in relay.stages(command))
                for process in (nxt, killed):
                    process.end(signal.SIGKILL)
                return command

        command = asyncio.run(begin())
        with rover_nxt(cable, "nxt again"):
            with executive(cable.parent, *MOCUP) as (_, uri):

                async def proceed() -> Command:
                    await relay.until(lambda: relay.stages(command)[-1] == "FAILED")
                    # The stop of the new executive may come to the brick after that report; a
                    # motion that was executed came after the stop.
                    async with ground(uri, relay) as client, asyncio.timeout(LIMIT_S):
                        while not (await client.run(client.command(MoveForward(-0.1)))).executed:
                            pass
                    continued = Command(Identity("MOE", 1 << 20), MoveForward(-0.8), "relay")
                    await relay.until_received(continued, "STARTED")
                    return continued

                continued = asyncio.run(proceed())
            with executive(cable.parent, *MOCUP):
                asyncio.run(relay.executed(continued))


def next_to(command: Command, steps: int) -> Command:
    number = command.identity.command_id + steps
    return replace(command, identity=Identity(command.identity.source, number))


def test_the_relay_commands_by_the_last_authority_from_the_executive(cable: Path) -> None:
    others = ("--host", "0.0.0.0", "--clear-text")

    async def session(uri: str, relay: RelayEnd) -> Command:
        async with ground(uri, relay) as client, asyncio.timeout(LIMIT_S):
            # Until rover-nxt has received who holds the authority, it executes by what it knew.
            while await relay.ended(client.command(SetTravelSpeed(0.2))) == "EXECUTED":
                pass
            await client.authority.request()
            given = await client.authority.hand_over("MOPS")
            by_it = replace(client.command(SetTravelSpeed(0.2)), authority=given.epoch)
            while await relay.ended(by_it) == "REJECTED":
                by_it = replace(client.command(SetTravelSpeed(0.2)), authority=given.epoch)
            assert await relay.ended(client.command(SetTravelSpeed(0.1))) == "REJECTED"
            return by_it

    with rover(cable), relay_end() as relay:
        with (
            rover_nxt(cable) as nxt,
            executive(cable.parent, *MOCUP, *others) as (killed, uri),
        ):
            by_it = asyncio.run(session(uri.replace("0.0.0.0", "127.0.0.1"), relay))
            for process in (nxt, killed):
                process.end(signal.SIGKILL)
        with rover_nxt(cable, "nxt again"):
            assert asyncio.run(relay.ended(next_to(by_it, 100))) == "EXECUTED"
            without = replace(next_to(by_it, 101), authority=None)
            assert asyncio.run(relay.ended(without)) == "REJECTED"
