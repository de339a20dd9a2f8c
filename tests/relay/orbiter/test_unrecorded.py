"""A kill between the bundle of a command and its record: the repeat does not go up as well."""

import asyncio
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from adapters.bundle import Queued
from adapters.mal import MalError
from adapters.mops import decode
from adapters.mrs.spec import AreaError
from adapters.relay.orbiter.record import Outstanding
from adapters.relay.orbiter.relay import recover_outbox
from executive.commands.catalogue import Command, MoveForward, Stop
from executive.record import LedgerError
from tests.relay.orbiter.sky import (
    DICTIONARY,
    Clock,
    Sky,
    ground,
    landed,
    orbiting,
    until,
)
from tests.relay.orbiter.test_given_up import eclipse


async def sent_and_killed(
    sky: Sky, clock: Clock, monkeypatch: pytest.MonkeyPatch, *requests: MoveForward | Stop
) -> list[Command]:
    """Send commands in the dark with an orbiter that never comes to write them down."""

    def killed(*_: object) -> None:
        raise LedgerError("killed")

    async with (
        orbiting(sky, clock, eclipse(clock)) as (relay, (station,)),
        await ground(station) as client,
    ):
        commands = [client.command(request) for request in requests]
        with monkeypatch.context() as kill:
            kill.setattr(Outstanding, "add", killed)
            for command in commands:
                with pytest.raises(MalError):
                    await client.submit(command)
        assert relay.agent.health().queued == len(commands)
    return commands


def test_a_repeat_of_what_went_up_before_it_was_written_down_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        first, second = await sent_and_killed(sky, clock, monkeypatch, MoveForward(1.25), Stop())
        async with (
            orbiting(sky, clock) as (relay, (station,)),
            landed(sky, "jackal") as far,
            await ground(station) as client,
        ):
            (rover,) = relay.rovers.values()
            assert rover.record.outstanding.queued() == 2
            for command in (first, second):
                with pytest.raises(MalError) as refusal:
                    await client.submit(command)
                assert refusal.value.number == AreaError.DUPLICATE.value
            await until(lambda: rover.record.outstanding.queued() == 0)
            await until(lambda: relay.agent.health().queued == 0)
            assert [message.command for message in far.commands] == ["MOVE_FORWARD", "STOP"]
            assert far.received == 2

    asyncio.run(run())


def test_what_was_written_down_is_not_looked_through(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        async with (
            orbiting(sky, clock, eclipse(clock)) as (relay, (station,)),
            await ground(station) as client,
        ):
            commands = [client.command(Stop()) for _ in range(40)]
            for command in commands:
                await client.submit(command)
            (rover,) = relay.rovers.values()
            queued = list(relay.agent.queued(rover.settings.endpoint))
            numbers = [decode(each.payload).moe_inputs_id for each in queued]
            assert numbers == [command.identity.command_id for command in reversed(commands)]
            recover_outbox(first(queued), rover.record, DICTIONARY, clock.utc_s())

    asyncio.run(run())


def first(queued: Sequence[Queued]) -> Iterator[Queued]:
    yield queued[0]
    raise AssertionError("more was read than is new")
