"""During a sync of the orbiter's disk a stop is uplinked; answers and reports wait for the disk."""

import asyncio
import threading
from pathlib import Path

import pytest

from executive.commands import MoveForward, Stop
from tests.relay.orbiter.sky import Sky, meeting, until
from tests.support.timed_system import TimedSystem


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
