"""A command of which nothing came down in its lifetime is given up, once all else came down."""

import asyncio
from pathlib import Path

import pytest

from adapters.mops import LinkHealth
from adapters.relay.orbiter.relay import GRACE_S
from executive.commands.catalogue import MoveForward
from tests.relay.orbiter.sky import (
    LIFE,
    Clock,
    Sky,
    catch_up,
    meeting,
    until,
)

LIFETIME_S = 60.0
AGAIN_S = 90.0


def link(utc_s: float, *, queued: int = 0, oldest_s: float = 0.0, unread: int = 0) -> LinkHealth:
    return LinkHealth(utc_s, queued, oldest_s, None, 0.0, unread, 0)


@pytest.mark.parametrize(("again_s", "grace_s"), [(AGAIN_S, AGAIN_S), (None, GRACE_S)])
def test_only_a_link_made_late_enough_gives_it_up(
    tmp_path: Path, again_s: float | None, grace_s: float
) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        async with meeting(sky, clock, ask_again_s=again_s) as (relay, rover, client):
            (far,) = relay.rovers.values()

            async def hear(health: LinkHealth) -> None:
                await rover.link(health)
                await until(lambda: far.aboard == health)

            await client.submit(client.command(MoveForward(0.5), lifetime_s=LIFETIME_S))
            await catch_up(client, len(LIFE))
            rover.life = ()
            command = client.command(MoveForward(1.0), lifetime_s=LIFETIME_S)
            end = asyncio.create_task(client.run(command))
            await until(lambda: rover.received == 2)
            await until(lambda: not relay.agent.health().queued)
            sent_s, late_s = clock.utc_s(), LIFETIME_S + grace_s
            await hear(link(sent_s + 3600.0))  # its clock is ahead
            clock.shift_s = late_s + 20.0
            relay.look()
            await relay.ask_again()
            await hear(link(sent_s + late_s - 5.0))
            await hear(link(sent_s + late_s + 20.0, queued=4, oldest_s=25.0))
            await hear(link(sent_s + late_s + 20.0, unread=1))
            assert not far.given_up(command.identity.command_id)
            await hear(link(sent_s + late_s + 20.0, queued=2, oldest_s=3.0))
            given_up = (await end).given_up
            assert given_up is not None
            assert "nothing came down on it within its lifetime" in (given_up.text or "")
            (told,) = far.given_up(command.identity.command_id)
            assert told.identity == command.identity

    asyncio.run(run())
