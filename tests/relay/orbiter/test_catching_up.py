"""A client that lost its connection learns by catching up alone what was recorded since."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from adapters.mops import Message
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import ReceivedReport, lost_command
from adapters.relay.orbiter.relay import OrbiterRelay
from adapters.relay.orbiter.rover import RelayedRover
from executive.commands import MoveForward
from executive.values.reports import Report, ReportKind, Severity, Stage
from tests.relay.orbiter.sky import (
    Clock,
    FarRover,
    Sky,
    eclipse,
    ground,
    landed,
    meeting,
    orbiting,
    until,
)


@asynccontextmanager
async def received(client: MrsClient) -> AsyncIterator[list[ReceivedReport]]:
    """Gather what a client receives for the time of a with."""
    notifications: list[ReceivedReport] = []

    async def gather() -> None:
        async for notification in client.notifications():
            notifications.append(notification)

    gathering = asyncio.create_task(gather())
    await asyncio.sleep(0)
    try:
        yield notifications
    finally:
        gathering.cancel()
        await asyncio.gather(gathering, return_exceptions=True)


def ends(notifications: list[ReceivedReport], stage: Stage) -> Callable[[], bool]:
    return lambda: any(each.report.stage is stage for each in notifications)


@asynccontextmanager
async def out_of_contact(relay: OrbiterRelay, client: MrsClient) -> AsyncIterator[RelayedRover]:
    """Have nobody receive what is published for the time of a with; then connect again."""
    (rover,) = relay.rovers.values()
    listener, rover.listener = rover.listener, None
    yield rover
    rover.listener = listener
    await client._session.drop(await client._session.consumer())


async def sent(rover: FarRover, client: MrsClient) -> Message:
    """Send a command to which the rover answers nothing yet."""
    rover.lifecycle = ()
    await client.submit(client.command(MoveForward(1.0)))
    await until(lambda: len(rover.commands) == 1)
    return rover.commands[0]


async def test_an_end_that_was_overtaken_by_another_report(tmp_path: Path) -> None:
    async with (
        meeting(Sky(tmp_path, "jackal")) as (relay, rover, client),
        received(client) as notifications,
    ):
        command = await sent(rover, client)
        await rover.send_report(command, 1, Stage.RECEIVED)
        other = Report(3, 1.0, ReportKind.EVENT, Severity.WARNING, "a stone")
        await rover.send_event(other, rover.ledger)
        await until(lambda: any(each.report.text == "a stone" for each in notifications))
        async with out_of_contact(relay, client) as relayed:
            await rover.send_report(command, 2, Stage.EXECUTED)
            await until(lambda: relayed.record.ledger.published == 3)
        await until(ends(notifications, Stage.EXECUTED))
        assert [n.report.sequence for n in notifications if n.report.sequence] == [1, 3, 2]


async def test_all_available_reports_if_none_was_received_before(tmp_path: Path) -> None:
    async with (
        meeting(Sky(tmp_path, "jackal")) as (relay, rover, client),
        received(client) as notifications,
    ):
        command = await sent(rover, client)
        async with out_of_contact(relay, client) as relayed:
            await rover.send_report(command, 1, Stage.RECEIVED)
            await rover.send_report(command, 2, Stage.EXECUTED)
            await until(lambda: relayed.record.ledger.published == 2)
        await until(ends(notifications, Stage.EXECUTED))
        assert [n.report.sequence for n in notifications if n.report.sequence] == [1, 2]


async def test_a_refusal_without_a_number(tmp_path: Path) -> None:
    async with (
        meeting(Sky(tmp_path, "jackal")) as (relay, rover, client),
        received(client) as notifications,
    ):
        command = await sent(rover, client)
        async with out_of_contact(relay, client) as relayed:
            await rover.send_report(command, 0, Stage.REJECTED)
            await until(lambda: bool(relayed.record.ledger.rows("SELECT 1 FROM reports")))
        await until(ends(notifications, Stage.REJECTED))
        (refusal,) = await client.get_notifications(command_id=command.moe_inputs_id)
        assert (refusal.report.sequence, refusal.report.stage) == (0, Stage.REJECTED)


async def test_that_a_command_was_lost(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with (
        meeting(sky, clock, eclipse(clock)) as (relay, _, client),
        received(client) as notifications,
    ):
        command = client.command(MoveForward(1.0), lifetime_s=30.0)
        await client.submit(command)
        async with out_of_contact(relay, client):
            clock.shift_s = 60.0
            await until(lambda: relay.agent.health().queued == 0)
        lost = command.identity
        await until(lambda: any(lost_command(each.report) == lost for each in notifications))


async def test_the_end_rather_than_the_loss_before_it(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with meeting(sky) as (relay, rover, client):
        rover.lifecycle = ()
        running = asyncio.create_task(client.run(client.command(MoveForward(1.0))))
        await until(lambda: len(rover.commands) == 1)
        async with out_of_contact(relay, client) as relayed:
            relayed.record.outstanding.end_unreported(float("inf"), 1.0)
            await rover.send_report(rover.commands[0], 1, Stage.EXECUTED)
            await until(lambda: len(relayed.record.ledger.reports()) == 1)
            await relayed.settle()
        assert (await running).executed


async def test_reports_recorded_and_not_published_before_a_kill(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with landed(sky, "jackal") as rover:
        async with orbiting(sky) as (relay, (station,)), await ground(station) as client:
            command = await sent(rover, client)
            async with received(client) as notifications:
                other = Report(2, 1.0, ReportKind.EVENT, Severity.WARNING, "a stone")
                await rover.send_event(other, rover.ledger)
                await until(lambda: any(each.report.text == "a stone" for each in notifications))
            (relayed,) = relay.rovers.values()
            relayed.listener = None
            await rover.send_report(command, 1, Stage.EXECUTED)
            await until(lambda: relayed.record.ledger.published == 2)
            cursor = next(each.cursor for each in notifications if each.report.text == "a stone")
        async with orbiting(sky) as (_, (station,)), await ground(station) as client:
            (missed,) = await client.get_all_notifications(cursor + 1)
            assert missed.report.sequence == 1


async def test_reports_delayed_by_a_failed_commit_are_published_before_later_ones(
    tmp_path: Path,
) -> None:
    async with meeting(Sky(tmp_path, "jackal")) as (relay, _, client):
        (relayed,) = relay.rovers.values()
        ledger = relayed.record.ledger
        async with received(client) as notifications:
            held = Report(1, 1.0, ReportKind.EVENT, Severity.WARNING, "held up")
            ledger.append_report(held)  # as a commit left it that failed
            ledger.commit()  # of something else
            relayed._add_report(
                Report(2, 1.0, ReportKind.EVENT, Severity.WARNING, "later"), "unit", "first"
            )
            await relayed.settle()
            await until(lambda: len(notifications) == 2)
            assert [each.report.text for each in notifications] == ["held up", "later"]
            assert [each.cursor for each in notifications] == [1, 2]
