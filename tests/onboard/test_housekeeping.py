"""How the executive's process is doing, as its parameters tell."""

import asyncio
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import EXECUTIVE_HOUSEKEEPING, Validity
from adapters.onboard.housekeeping import ExecutiveHousekeeping
from adapters.ros import TickStatistics
from tests.mrs.aboard import Aboard

SLOW = TickStatistics(20, 20, 1.0, longest_period_s=0.125, longest_tick_s=0.0625, overruns=3)
QUICK = TickStatistics(20, 20, 1.0, longest_period_s=0.0625, longest_tick_s=0.001, overruns=3)


@pytest.fixture
def rover(tmp_path: Path) -> Iterator[Aboard]:
    """Give a rover that tells of itself; of its ticks the worst of two seconds."""
    housekeeping = ExecutiveHousekeeping(tmp_path)
    for ticks in (SLOW, QUICK):
        housekeeping.note(ticks)
    with closing(Aboard(tmp_path, housekeeping=housekeeping)) as rover:
        rover.runs = True
        yield rover


def test_the_executive_tells_of_itself_as_of_the_rover(rover: Aboard) -> None:
    async def session(client: MrsClient) -> dict[str, float | None]:
        while True:
            values = await client.get_value()
            found = {each.name: each.value.value if each.value else None for each in values}
            if any(each.validity is Validity.VALID for each in values if each.name == "EXEC_TICK"):
                break
            await asyncio.sleep(0.02)
        defined = {each.name: each.unit for each in await client.list_definition()}
        assert list(found) == list(defined)
        assert defined["EXEC_LEDGER"] == "B"
        told = {each.name for each in (await client.get_status()).values}
        assert told == set(defined)
        return found

    found = rover.ground(session)
    assert {each.name for each in EXECUTIVE_HOUSEKEEPING} < found.keys()
    assert (found["EXEC_TICK"], found["EXEC_TICK_PERIOD"]) == (0.0625, 0.125)
    assert (found["EXEC_OVERRUNS"], found["EXEC_GOALS"]) == (3.0, 0.0)
    for name in ("EXEC_MEMORY", "EXEC_DISK_FREE", "EXEC_LEDGER"):
        assert (found[name] or 0.0) > 1000.0, name
