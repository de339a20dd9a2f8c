"""During a sync of the orbiter's disk a stop is uplinked; answers and reports wait for the disk."""

import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from adapters.bundle import BundleId, ContactOverride, DeliveryStatus, Ipn, node_of
from adapters.mal import MalError
from adapters.mops import UNNUMBERED
from adapters.mrs.spec import AreaError
from adapters.relay.orbiter.record import RoverRecord
from executive.commands import MoveForward, Stop
from executive.record import LedgerError
from executive.values.reports import Report, ReportKind, Severity, Stage
from tests.relay.orbiter.sky import Sky, meeting, until
from tests.support.timed_system import TimedSystem
from tests.support.unsynced import UNSYNCED, Unsynced


async def test_a_stop_passes_while_the_disk_syncs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = threading.Event()
    free.set()
    monkeypatch.setattr(TimedSystem, "sync", lambda *_: free.wait(60))
    async with meeting(Sky(tmp_path, "jackal")) as (relay, rover, client):
        (record,) = (each.record for each in relay.rovers.values())
        free.clear()
        sent = [
            asyncio.create_task(client.submit(client.command(request)))
            for request in (MoveForward(1.0), Stop())
        ]
        await until(lambda: [each.command for each in rover.commands] == ["STOP"])
        assert not any(each.done() for each in sent)
        free.set()
        await asyncio.gather(*sent)
        await until(lambda: record.ledger.published == 8)
        assert [each.command for each in rover.commands] == ["STOP", "MOVE_FORWARD"]
        assert [each.report.sequence for each in record.ledger.recorded(1, None, 9)] == [
            *range(1, 9)
        ]


async def test_a_report_is_published_once_it_is_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free, begun = threading.Event(), threading.Event()
    free.set()
    async with meeting(Sky(tmp_path, "jackal")) as (relay, rover, client):
        (relayed,) = relay.rovers.values()

        def sync() -> None:
            begun.set()
            assert free.wait(60)

        monkeypatch.setattr(relayed.record, "_sync", sync)
        free.clear()
        await rover.event("seen")
        await until(begun.is_set)
        assert len(relayed.record.ledger.unpublished()) == 1
        assert not await client.get_notifications()
        free.set()
        await until(lambda: relayed.record.ledger.published == 1)
        assert [each.report.text for each in await client.get_notifications()] == ["seen"]


async def test_reports_of_lost_bundles_are_published_before_the_record_closes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = threading.Event()
    async with meeting(Sky(tmp_path, "jackal")) as (relay, _, client):
        (relayed,) = relay.rovers.values()
        relay.override_contact(node_of(relayed.settings.endpoint), ContactOverride.DOWN)
        sent: list[BundleId] = []
        send = relay.agent.send

        async def recorded_send(*arguments: Any, **options: Any) -> BundleId:
            sent.append(await send(*arguments, **options))
            return sent[-1]

        monkeypatch.setattr(relay.agent, "send", recorded_send)
        for _ in range(2):
            await client.submit(client.command(MoveForward(1.0)))
        monkeypatch.setattr(relayed.record, "_sync", lambda: free.wait(60))
        for bundle in sent:
            relayed.on_status(bundle, DeliveryStatus.EXPIRED)
        close = relay.agent.close

        async def close_before_the_disk() -> None:
            await close()
            asyncio.get_running_loop().call_later(0.05, free.set)

        monkeypatch.setattr(relay.agent, "close", close_before_the_disk)
    assert relayed.record.ledger.published == len(sent)


async def test_a_stop_clears_an_override_while_the_disk_syncs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = threading.Event()
    free.set()
    monkeypatch.setattr(TimedSystem, "sync", lambda *_: free.wait(60))
    async with meeting(Sky(tmp_path, "jackal")) as (relay, rover, client):
        (relayed,) = relay.rovers.values()
        relay.override_contact(node_of(relayed.settings.endpoint), ContactOverride.DOWN)
        free.clear()
        sent = asyncio.create_task(client.submit(client.command(Stop())))
        await until(lambda: [each.command for each in rover.commands] == ["STOP"])
        assert not sent.done()
        free.set()
        await sent


async def test_a_report_that_is_not_committed_is_synced_after_its_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = RoverRecord(tmp_path / "record", system=UNSYNCED)
    syncs: list[Path] = []
    monkeypatch.setattr(Unsynced, "sync", lambda _, database: syncs.append(database))
    event = Report(1, 1.0, ReportKind.EVENT, Severity.WARNING, "seen")
    record.ledger.rows("PRAGMA query_only = ON")
    with pytest.raises(LedgerError):
        record.add_report(event, "unit")
    await record.durable()
    record.ledger.rows("PRAGMA query_only = OFF")
    record.add_report(event, "unit")
    syncs.clear()
    await record.durable()
    assert len(record.ledger.unpublished()) == len(syncs) == 1
    record.close()


async def test_a_repeat_sends_published_reports_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with meeting(Sky(tmp_path, "jackal")) as (relay, rover, client):
        (relayed,) = relay.rovers.values()
        rover.lifecycle = (Stage.RECEIVED,)
        command = client.command(MoveForward(1.0))
        await client.submit(command)
        await until(lambda: relayed.record.ledger.published == 1)
        cursors: list[int | None] = []
        monkeypatch.setattr(relayed.listener, "on_report", lambda _, cursor: cursors.append(cursor))
        output = UNNUMBERED, 1.0, ReportKind.LINK, Severity.WARNING, "lost", command.identity
        relayed.record.add_report(Report(*output), "unit")
        with pytest.raises(MalError) as raised:
            await client.submit(command)
        assert raised.value.number == AreaError.DUPLICATE.value
        assert cursors == [1]
        await relayed.settle()
        assert cursors == [1, 2]


async def test_no_command_is_retransmitted_after_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with meeting(Sky(tmp_path, "jackal")) as (relay, rover, client):
        (relayed,) = relay.rovers.values()
        rover.mute = True
        for _ in range(2):
            await client.submit(client.command(MoveForward(1.0)))
        await until(lambda: relayed.record.outstanding.earliest_utc_s() is None)
        sent: list[bytes] = []
        send = relay.agent.send

        async def send_after_stop(endpoint: Ipn, octets: bytes, **options: Any) -> BundleId:
            sent.append(octets)
            if len(sent) == 1:
                await client.submit(client.command(Stop()))
            return await send(endpoint, octets, **options)

        monkeypatch.setattr(relay.agent, "send", send_after_stop)
        await relayed.retransmit_unanswered(-1.0)
        assert [b"STOP" in each for each in sent] == [False, True]
