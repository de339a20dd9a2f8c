"""Whoever commands in the dark is told that the command is stored at the orbiter."""

import asyncio
from pathlib import Path

from executive.commands.catalogue import Stop
from tests.relay.orbiter.sky import (
    Clock,
    Sky,
    ground,
    landed,
    orbiting,
)
from tests.relay.orbiter.test_console import rover
from tests.relay.orbiter.test_given_up import eclipse

WHERE = "at the orbiter; next contact at 20"


def test_what_waits_at_the_orbiter_is_said_to_be_there(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        async with orbiting(sky, clock, eclipse(clock), lifetime_s=3.0) as (_, (station,)):
            to = ("--to", str(station.uri))
            _, said = await rover("command", *to, "stop")
            assert f"STORED     {WHERE}" in said.splitlines()[1]
            _, said = await rover("mops", *to, "--no-telemetry", typed="stop\n")
            (line,) = [line.split() for line in said.splitlines() if WHERE in line]
            assert line[1:4:2] == ["STORED", "at"]
            status, said = await rover("command", *to, "--no-wait", "stop")
            assert (status, said.splitlines()[1].startswith(f"stored {WHERE}")) == (0, True)

    asyncio.run(run())


def test_in_contact_nothing_is_said_to_be_stored(tmp_path: Path) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "jackal")
        async with (
            orbiting(sky) as (_, (station,)),
            landed(sky, "jackal"),
            await ground(station) as client,
        ):
            where: list[str] = []
            assert (await client.run(client.command(Stop()), on_stored=where.append)).executed
            assert where == []

    asyncio.run(run())


def test_a_repeat_in_the_dark_is_not_called_another_command(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        async with orbiting(sky, clock, eclipse(clock)) as (_, (station,)):
            typed = ("command", "--to", str(station.uri), "--id", "7", "--no-wait", "stop")
            assert (await rover(*typed))[0] == 0
            again = [word for word in typed if word != "--no-wait"]
            status, said = await rover(*again)
            assert status == 1
            assert f"MOE:7 was taken before, {WHERE}" in said
            assert "nothing was heard of it yet, or it was another command" in said

    asyncio.run(run())
