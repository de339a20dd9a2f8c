"""What a live run receives after an outage."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from adapters.mrs.ground import MrsClient
from adapters.system import OPERATING_SYSTEM
from executive.values.reports import Severity
from sim.scenario.live_session import DownlinkSubscriptions
from sim.scenario.record import Record
from tests.mrs.aboard import Aboard


@pytest.fixture
def aboard(tmp_path: Path) -> Iterator[Aboard]:
    rover = Aboard(tmp_path)
    yield rover
    rover.close()


def test_a_report_before_the_history_is_read_hides_nothing(aboard: Aboard, tmp_path: Path) -> None:
    def happens(text: str) -> None:
        aboard.do(lambda bench: bench.executive.report_event(Severity.WARNING, text))

    async def downlink(record: Record, arrived: asyncio.Event) -> DownlinkSubscriptions:
        client = await MrsClient.connect(aboard.uri)
        line = DownlinkSubscriptions(client, record, "direct", OPERATING_SYSTEM, arrived.set)
        await line.begin()
        return line

    async def received(record: Record, arrived: asyncio.Event, text: str) -> None:
        while text not in [each.text for each in record.reports]:
            await arrived.wait()
            arrived.clear()

    async def outage() -> list[str]:
        record, arrived = Record(0.0, tmp_path), asyncio.Event()
        before = await downlink(record, arrived)
        await asyncio.to_thread(happens, "before")
        await received(record, arrived, "before")
        await before.end()
        await asyncio.to_thread(happens, "meanwhile")
        after = await downlink(record, arrived)
        await asyncio.to_thread(happens, "after")
        await received(record, arrived, "after")
        await after.catch_up(before.last_cursor + 1)
        await after.end()
        return [each.text for each in record.reports]

    assert {"before", "meanwhile", "after"} <= set(asyncio.run(asyncio.wait_for(outage(), 60.0)))
