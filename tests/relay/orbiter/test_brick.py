"""A brick behind the router of rover-nxt, whose reply is lost while nobody relays it."""

import asyncio
from pathlib import Path

from adapters.bundle import Address, BundleAgent, Listen, LtpLink, Neighbour, NodeSettings
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.database import Synchronous
from adapters.mocup.brick.record import Link
from adapters.mops import decode
from executive.commands.catalogue import MoveForward
from executive.reports import Stage
from tests.mocup.brick.routing import Bench, executed
from tests.relay.orbiter.sky import (
    HERE,
    ORBITER,
    Clock,
    Sky,
    catch_up,
    ground,
    orbiting,
    until,
)

AGAIN_S = 60.0


async def carry(agent: BundleAgent, bench: Bench) -> None:
    """Stand where rover-relay does: commands to the router, and what it says then to the ground."""
    while True:
        async with agent.receive() as delivery:
            said = len(bench.exits.notified)
            bench.router.command(Link.RELAY, delivery.payload.decode())
            for _, reply in bench.exits.notified[said:]:
                await agent.send(ORBITER, str(reply).encode())


def test_what_the_brick_said_to_nobody_is_asked_for_again(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock, bench = Sky(tmp_path, "mocup", numbered=False), Clock(), Bench()
        neighbour = Neighbour(Ipn(ORBITER.node, 0), LtpLink(sky.to_orbiter, answer_s=0.2))
        node = NodeSettings(sky.node("mocup"), (sky.node("mocup"),), (neighbour,))
        listen = Listen(ltp=Address(HERE, sky.rover_ports["mocup"]))
        agent = BundleAgent(node, tmp_path / "far.db", listen, synchronous=Synchronous.OFF)
        await agent.open(lambda _: None)
        carrying = asyncio.create_task(carry(agent, bench))
        async with (
            orbiting(sky, clock, ask_again_s=AGAIN_S) as (relay, (station,)),
            await ground(station) as client,
        ):
            command = client.command(MoveForward(1.5))
            running = asyncio.create_task(client.run(command))
            await until(lambda: len(bench.exits.brick) == 1)
            await until(lambda: not relay.agent.health().queued)
            bench.says(executed(decode(bench.exits.brick[0])))
            bench.start(bench.router.record)
            clock.shift_s += 2 * AGAIN_S
            await relay.ask_again()
            outcome = await running
            assert outcome.executed
            past = await catch_up(client, len(outcome.life))
            assert [n.sequence for n in past] == list(range(1, len(past) + 1))
            assert [n.stage for n in past if n.stage is not None][-1].value == Stage.EXECUTED.value
            clock.shift_s += 2 * AGAIN_S
            await relay.ask_again()
            assert not relay.agent.health().queued
            assert len(bench.exits.brick) == 1
        carrying.cancel()
        await asyncio.gather(carrying, return_exceptions=True)
        await agent.close()

    asyncio.run(run())
