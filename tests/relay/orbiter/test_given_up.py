"""A command whose lifetime ends at the orbiter ends for who waits for it, too."""

import asyncio
from pathlib import Path

from adapters.bundle import ContactPlan
from adapters.bundle.links.contact import Contact
from adapters.mrs.spec.types import Severity
from executive.commands.catalogue import MoveForward, Stop
from tests.relay.orbiter.sky import (
    Clock,
    Sky,
    ground,
    landed,
    orbiting,
    until,
)
from tests.relay.orbiter.test_console import rover

WHY = "may not have reached the rover: its lifetime ended at the orbiter"


def eclipse(clock: Clock) -> ContactPlan:
    dawn_s = clock.utc_s() + 3600.0
    return ContactPlan((Contact(dawn_s, dawn_s + 600.0, 1, 2, 100_000),))


def test_who_waits_for_a_command_that_was_given_up_is_told(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        async with (
            orbiting(sky, clock, eclipse(clock)) as (relay, (station,)),
            landed(sky, "jackal") as far,
            await ground(station) as client,
        ):
            short = client.command(MoveForward(1.0), lifetime_s=30.0)
            waiting = [
                asyncio.create_task(client.run(each)) for each in (short, client.command(Stop()))
            ]
            await until(lambda: relay.agent.health().queued == 2)
            clock.shift_s = 60.0
            lost = await waiting[0]
            assert (lost.executed, lost.stage, lost.life, lost.refusal) == (False, None, (), None)
            assert lost.given_up is not None
            assert lost.given_up.severity is Severity.ALARM
            assert lost.given_up.text == f"{short.identity} {WHY}"
            assert (lost.given_up.commandId, lost.given_up.stage) == (None, None)
            assert not waiting[1].done(), "it is of one command only"
            clock.shift_s = 3601.0
            assert (await waiting[1]).executed
            assert [message.command for message in far.commands] == ["STOP"]

    asyncio.run(run())


def test_a_session_that_was_lost_meanwhile_learns_it_too(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        async with orbiting(sky, clock, eclipse(clock)) as (relay, (station,)):
            async with await ground(station) as client:
                command = client.command(MoveForward(1.0), lifetime_s=30.0)
                await client.submit(command)
            clock.shift_s = 60.0
            await until(lambda: relay.agent.health().queued == 0)
            async with await ground(station) as client:
                again = await client.run(command)
            assert again.given_up is not None
            said = "may not have reached the rover: it was given up at the orbiter"
            assert again.given_up.text == f"{command.identity} {said}"

    asyncio.run(run())


def test_rover_command_and_rover_mops_end_with_it(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        async with orbiting(sky, clock, eclipse(clock), lifetime_s=2.0) as (_, (station,)):
            to = ("--to", str(station.uri))
            status, said = await rover("command", *to, "--lifetime", "2", "moveForward", "0.4")
            assert status == 1
            assert "GIVEN UP" in said
            assert WHY in said
            status, said = await rover("mops", *to, "--no-telemetry", typed="moveForward 0.4\n")
            assert status == 1
            assert WHY in said

    asyncio.run(run())


def test_a_run_over_a_loss_of_the_session_ends_with_it(tmp_path: Path) -> None:
    async def run() -> None:
        sky, clock = Sky(tmp_path, "jackal"), Clock()
        async with orbiting(sky, clock, eclipse(clock)) as (relay, (station,)):
            rover_node = relay.rovers[next(iter(relay.rovers))]
            async with await ground(station) as client:
                command = client.command(MoveForward(1.0), lifetime_s=30.0)
                waiting = asyncio.create_task(client.run(command))
                await until(lambda: relay.agent.health().queued == 1)
                rover_node.listener = None  # what is told now, nobody hears
                clock.shift_s = 60.0
                await until(lambda: relay.agent.health().queued == 0)
                await client._session.drop(await client._session.consumer())
                assert (await waiting).given_up is not None

    asyncio.run(run())
