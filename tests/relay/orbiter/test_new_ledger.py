"""A rover that comes back with a new ledger, whose numbers begin at 1 again."""

import asyncio
from pathlib import Path

import pytest

from adapters.mops import MopsError
from adapters.mrs.spec import NotificationKind, forwarded_command, lost_command
from adapters.mrs.spec import Stage as StageSaid
from adapters.mrs.spec.types import Severity
from adapters.relay.orbiter.record import LEDGER_STRIDE, MAX_LEDGERS, RoverRecord
from executive.commands.catalogue import MoveForward
from executive.values.reports import Report, ReportKind, Stage
from executive.values.reports import Severity as ReportSeverity
from tests.relay.orbiter.sky import STAGES, Sky, catch_up, ground, landed, meeting, orbiting, until
from tests.relay.orbiter.test_outstanding import departed


def numbers(past: list[Report]) -> list[int]:
    return [report.sequence for report in past]


async def test_its_reports_are_published_and_numbers_only_rise(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with landed(sky, "jackal") as rover:
        async with orbiting(sky) as (_, (station,)), await ground(station) as client:
            message = client.notifications()
            assert (await client.run(client.command(MoveForward(1.0)))).executed
            rover.forget("second")
            assert (await client.run(client.command(MoveForward(2.0)))).executed
            reported = [(await anext(message)).report for _ in range(2 * len(STAGES) + 3)]
            (link,) = [
                n for n in reported if n.kind is NotificationKind.LINK and not forwarded_command(n)
            ]
            assert link.severity is Severity.WARNING
            assert f"numbered from {LEDGER_STRIDE + 1}" in link.text
        async with orbiting(sky) as (_, (station,)), await ground(station) as client:
            assert (await client.run(client.command(MoveForward(3.0)))).executed
            second = list(range(LEDGER_STRIDE + 1, LEDGER_STRIDE + 2 * len(STAGES) + 1))
            past = await catch_up(client, 3 * len(STAGES))
            assert numbers(past) == [1, 2, 3, 4, *second]
            late = Report(9, 1.0, ReportKind.EVENT, ReportSeverity.WARNING, "said before")
            await rover.send_event(late, "first")
            past = await catch_up(client, len(past) + 1)
            assert numbers(past) == [1, 2, 3, 4, *second, 9]
            cursors = [n.cursor for n in await client.get_notifications()]
            assert cursors == list(range(1, len(past) + 1))
        assert len(rover.commands) == 3


async def test_commands_of_the_old_ledger_are_not_awaited(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with meeting(sky) as (relay, rover, client):
        rover.lifecycle = (Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED)
        begun = client.command(MoveForward(1.0))
        await client.submit(begun)
        await catch_up(client, 3)
        assert (await client.get_status()).activeCommandId == begun.identity.command_id
        await until(departed(relay))
        rover.forget("second")
        message = client.notifications()
        await rover.event("here again")
        link, loss, event = [(await anext(message)).report for _ in range(3)]
        assert (link.kind, link.severity) == (NotificationKind.LINK, Severity.WARNING)
        assert lost_command(loss) == begun.identity
        assert event.text == "here again"
        assert (await client.get_status()).activeCommandId is None
        again = await client.run(begun)
        assert again.loss is not None
        assert again.stage is StageSaid.STARTED
        rover.lifecycle = STAGES
        other = client.command(MoveForward(2.0))
        assert (await client.run(other)).executed


async def test_clients_waiting_for_commands_of_the_old_ledger_are_notified(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with meeting(sky) as (relay, rover, client):
        rover.lifecycle = (Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED)
        waiting = [
            asyncio.create_task(client.run(client.command(MoveForward(1.0)))) for _ in range(2)
        ]
        await catch_up(client, 6)
        await until(departed(relay))
        rover.forget("second")
        rover.lifecycle = STAGES
        new = [client.run(client.command(MoveForward(2.0))) for _ in range(3)]
        assert all(outcome.executed for outcome in await asyncio.gather(*new))
        for outcome in await asyncio.gather(*waiting):
            assert outcome.loss is not None
            assert "new ledger" in outcome.loss.text


def test_names_without_end_are_no_ledgers(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    for number in range(MAX_LEDGERS):
        assert record.ledgers.new(f"{number}") is (number > 0)
        record.ledgers.number(f"{number}", 1)
    with pytest.raises(MopsError, match="is number 1001"):
        record.ledgers.new("more")
    assert not record.ledgers.new("7")
    assert not record.ledgers.new("")


async def test_a_restored_ledger_is_reported(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with meeting(sky) as (_, rover, client):
        await rover.event("a stone")
        await catch_up(client, 1)
        message = client.notifications()
        rover.forget(rover.ledger)
        await rover.event("another stone")
        warning = (await anext(message)).report
        assert (warning.sequence, warning.severity) == (0, Severity.WARNING)
        assert "used number 1 again for another report: another stone" in warning.text
        assert [n.report.text for n in await client.get_notifications()] == ["a stone"]
