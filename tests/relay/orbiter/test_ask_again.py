"""Commands of which the rover should have said more are sent once more."""

import asyncio
from pathlib import Path

from adapters.bundle import ContactPlan
from adapters.bundle.links.contact import Contact
from adapters.mrs.ground import MrsClient
from adapters.relay.orbiter.relay import OrbiterRelay
from executive.commands.catalogue import Command, MoveForward, Request, Stop
from executive.reports import Stage
from tests.relay.orbiter.sky import (
    LIFE,
    Clock,
    FarRover,
    Sky,
    catch_up,
    ground,
    landed,
    meeting,
    orbiting,
    until,
)

AGAIN_S = 60.0


class Waiting:
    """A command that is up, and of which what the rover said was lost."""

    def __init__(
        self, relay: OrbiterRelay, clock: Clock, client: MrsClient, rover: FarRover
    ) -> None:
        self.relay, self.clock, self.client, self.rover = relay, clock, client, rover

    async def lose(self, request: Request, lifetime_s: float | None = None) -> Command:
        before = self.rover.received
        self.rover.mute = True
        command = self.client.command(request, lifetime_s=lifetime_s)
        await self.client.submit(command)
        await until(lambda: self.rover.received == before + 1)
        await until(lambda: not self.relay.agent.health().queued)
        self.rover.mute = False
        return command

    async def wait(self, time_s: float) -> None:
        self.clock.shift_s += time_s
        await self.relay.ask_again()


async def stages(client: MrsClient, count: int) -> list[Stage]:
    return [Stage(n.stage.value) for n in await catch_up(client, count) if n.stage is not None]


def test_a_brick_is_asked_again_answers_and_does_nothing_twice(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "mocup", numbered=False), Clock()
        async with (
            orbiting(sky, clock, ask_again_s=AGAIN_S) as (relay, (station,)),
            landed(sky, "mocup") as rover,
            await ground(station) as client,
        ):
            rover.ledger = ""
            waiting = Waiting(relay, clock, client, rover)
            lost = await waiting.lose(MoveForward(1.0))
            await waiting.wait(AGAIN_S / 2)
            assert rover.received == 1
            await waiting.wait(AGAIN_S)
            assert await stages(client, 4) == [*LIFE]
            assert [m.moe_inputs_id for m in rover.commands] == [lost.identity.command_id]
            assert rover.received == 2
            await waiting.wait(2 * AGAIN_S)
            assert rover.received == 2
            rover.life = (Stage.RECEIVED, Stage.STARTED)
            await client.submit(client.command(MoveForward(2.0)))
            told = [*LIFE, Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED]
            assert await stages(client, 7) == told
            await until(lambda: not relay.agent.health().queued)
            await waiting.wait(AGAIN_S)
            await until(lambda: rover.received == 4)
            await rover.telemetry(POS_X=9.0)
            (relayed,) = relay.rovers.values()
            await until(lambda: relayed.parameters()[0].value == 9.0)
            assert await stages(client, 7) == told
            assert len(rover.commands) == 2

    asyncio.run(run())


def test_of_who_numbers_only_what_nothing_was_heard_of(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        async with meeting(sky, clock, ask_again_s=AGAIN_S) as (relay, rover, client):
            waiting = Waiting(relay, clock, client, rover)
            rover.life = LIFE[:3]
            await client.submit(client.command(MoveForward(1.0)))
            await catch_up(client, 3)
            await until(lambda: not relay.agent.health().queued)
            await waiting.wait(2 * AGAIN_S)
            assert rover.received == 1
            rover.life = LIFE
            await waiting.lose(MoveForward(2.0))
            await waiting.wait(2 * AGAIN_S)
            past = await stages(client, 4)
            assert past[-1] is Stage.EXECUTED
            assert (rover.received, len(rover.commands)) == (3, 2)

    asyncio.run(run())


def test_neither_a_stop_nor_what_is_too_old_nor_without_contact(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        contacts = [(clock.utc_s() + begin_s, 1, 2, 100_000) for begin_s in (0.0, 4 * AGAIN_S)]
        plan = ContactPlan(tuple(Contact(at_s, at_s + AGAIN_S, *way) for at_s, *way in contacts))
        async with meeting(sky, clock, plan, ask_again_s=AGAIN_S) as (relay, rover, client):
            waiting = Waiting(relay, clock, client, rover)
            await waiting.lose(Stop())
            await waiting.lose(MoveForward(1.0), lifetime_s=2 * AGAIN_S)
            await waiting.lose(MoveForward(2.0))
            await waiting.wait(3 * AGAIN_S)
            assert not relay.agent.health().queued
            await waiting.wait(1.5 * AGAIN_S)
            await until(lambda: rover.received == 4)
            await waiting.wait(0.0)
            assert [m.inputs for m in rover.commands] == [(), ("1.0",), ("2.0",)]
            assert rover.received == 4

    asyncio.run(run())
