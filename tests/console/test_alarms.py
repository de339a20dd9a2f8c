"""Alarms: raised, cleared and acknowledged, by several consoles and over restarts."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from sqlalchemy import Engine

from adapters.console.archive import (
    AlarmCleared,
    AlarmRaised,
    Archive,
    Change,
    RetentionPolicy,
    TablePage,
    acknowledge_alarms,
    change_alarms,
    delete_old,
    open_alarms,
    read_alarms,
)
from adapters.console.messages import AlarmStatus, LinkKind
from adapters.console.requests import AlarmRequests
from adapters.console.rovers import notification_message as notified_of
from adapters.mrs.spec import ReceivedReport
from adapters.system import OPERATING_SYSTEM
from executive.commands import Resume
from tests.console.conftest import Launch
from tests.console.consoles import JsonMessage, Operator, at_console
from tests.console.postgres import fresh
from tests.console.test_archive import notified
from tests.mrs.aboard import Aboard
from tests.support.kinematic import Bench

LOW_V, FULL_V = 20.0, 26.0
BATTERY = "fault 905"
VOLTAGE = "limit BATERY_VOLTAGE"


def is_alarm(source: str, **wanted: object) -> Callable[[JsonMessage], bool]:
    return lambda message: (
        (message["ty"], message.get("source")) == ("alarm", source)
        and all(message[name] == value for name, value in wanted.items())
    )


def show(rover: Aboard, voltage_v: float) -> None:
    """Let the battery show a voltage."""
    rover.do(lambda bench: setattr(bench, "voltage_v", voltage_v))


async def acknowledge(operator: Operator, *alarms: JsonMessage) -> list[JsonMessage]:
    seen = [[each["id"], each["occurrences"]] for each in alarms]
    status, answer = await operator.post("api/alarms/acknowledge", alarms=seen)
    assert status == 200
    found: list[JsonMessage] = answer["alarms"]
    return found


async def test_an_alarm_is_open_until_it_is_cleared_and_acknowledged(
    rover: Aboard, tmp_path: Path
) -> None:
    topics = ("link", "alarm", "cmd")
    async with at_console(tmp_path, rover.uri, "anna", "ben", topics=topics) as (anna, ben):
        await anna.page.is_up()
        show(rover, LOW_V)
        low = await anna.page.until(is_alarm(BATTERY))
        assert (low["severity"], low["cleared"], low["acknowledged"]) == ("ALARM", None, None)
        assert low["text"].startswith("battery voltage 20.0 V is below 22.0 V")
        voltage = await ben.page.until(is_alarm(VOLTAGE))
        assert voltage["text"] == "BATERY_VOLTAGE is 20, below 22"
        (stale,) = await acknowledge(anna, {**low, "occurrences": 7})
        assert stale["operator"] is None
        await acknowledge(anna, low)
        by = await ben.page.until(is_alarm(BATTERY, operator="anna"))
        assert (by["cleared"], by["id"]) == (None, low["id"])
    async with at_console(tmp_path, rover.uri, "ben", topics=topics) as (ben,):
        assert (await ben.page.until(is_alarm(BATTERY)))["operator"] == "anna"
        show(rover, FULL_V)
        over = await ben.page.until(is_alarm(VOLTAGE, acknowledged=None))
        if over["cleared"] is None:
            over = await ben.page.until(is_alarm(VOLTAGE))
        assert over["cleared"] > voltage["raised"]
        (done,) = await acknowledge(ben, over)
        assert (done["operator"], done["cleared"]) == ("ben", over["cleared"])
        assert (await ben.send("go on", "resume"))[0] == 202
        ended = await ben.page.until(
            lambda message: is_alarm(BATTERY)(message) and message["cleared"]
        )
        assert ended["operator"] == "anna"
        history = (await ben.get("api/alarms", asset="jackal"))["alarms"]
        assert {BATTERY, VOLTAGE} <= {each["source"] for each in history}
        async with ben.open_page(*topics) as page:
            await page.is_up()
            standing = {each["source"] for each in page.got if each["ty"] == "alarm"}
            assert not standing & {BATTERY, VOLTAGE}


async def test_what_happens_once_is_over_at_once_and_counted(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna", topics=("link", "alarm", "cmd")) as (anna,):
        await anna.page.is_up()
        for number in (1, 2):
            await anna.send(f"far {number}", "activatePlan", plan_id="none")
            refused = await anna.page.until(
                lambda message: (
                    message["ty"] == "alarm" and message["source"].startswith("command REJECTED")
                )
            )
            assert refused["occurrences"] == number
            assert refused["command"] == f"far {number}"
            assert refused["cleared"] == refused["last"]
        for wrong in ("x", [[1]], [[1, True]], [["1", 1]]):
            status, answer = await anna.post("api/alarms/acknowledge", alarms=wrong)
            assert (status, answer["field"]) == (422, "alarms")


async def test_consoles_at_one_database_show_the_same(
    launch: Launch, postgres: str, tmp_path: Path
) -> None:
    rover = launch()
    rover.runs = True
    topics, url = ("link", "alarm"), fresh(postgres)
    async with (
        at_console(tmp_path / "one", rover.uri, "anna", topics=topics, archive=url) as (anna,),
        at_console(tmp_path / "two", rover.uri, "ben", topics=topics, archive=url) as (ben,),
    ):
        for operator in (anna, ben):
            await operator.page.is_up()
        show(rover, LOW_V)
        here = await anna.page.until(is_alarm(BATTERY))
        there = await ben.page.until(is_alarm(BATTERY))
        assert there["id"] == here["id"]
        await acknowledge(ben, there)
        seen = await anna.page.until(is_alarm(BATTERY, operator="ben"))
        assert seen["occurrences"] == 1
        alarms = (await anna.get("api/alarms"))["alarms"]
        assert len(alarms) == len({each["source"] for each in alarms})


async def test_an_already_received_report_changes_nothing(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    raised = partial(
        AlarmRaised, "jackal", "fault 1", severity="ALARM", text="low", persistent=True
    )

    async def change(*changes: Change) -> list[AlarmStatus]:
        await archive.write(partial(change_alarms, changes=changes))
        return await archive.read(open_alarms)

    async def acknowledge(alarm: AlarmStatus, utc: float) -> list[AlarmStatus]:
        seen = [(alarm.id, alarm.occurrences)]
        act = partial(acknowledge_alarms, seen=seen, operator="anna", utc_s=utc)
        await archive.write(act)
        return await archive.read(open_alarms)

    (first,) = await change(raised(utc=5.0), raised(utc=5.0), raised(utc=4.0))
    assert (first.occurrences, first.raised, first.cleared) == (1, 5.0, None)
    assert await change(AlarmCleared("jackal", "fault 1", 4.0)) == [first]
    assert await change(raised(utc=6.0, reoccurrence=False)) == [first]
    (again,) = await change(
        AlarmCleared("jackal", "fault 1", 7.0), raised(utc=8.0, reoccurrence=False)
    )
    assert (again.id, again.occurrences, again.last, again.cleared) == (first.id, 2, 8.0, None)
    assert await acknowledge(first, 9.0) == [again]
    (known,) = await acknowledge(again, 9.0)
    assert (known.operator, known.acknowledged) == ("anna", 9.0)
    (again_,) = await change(raised(utc=10.0))
    assert (again_.occurrences, again_.operator) == (3, None)
    await acknowledge(again_, 11.0)
    assert await change(AlarmCleared("jackal", "fault 1", 12.0), raised(utc=10.0)) == []
    (other,) = await change(raised(utc=20.0))
    assert (other.id, other.occurrences) == (first.id + 1, 1)
    await delete_old(archive, RetentionPolicy(days=1.0), 1e6)
    all_alarms = partial(read_alarms, page=TablePage("jackal", None, None, 9))
    assert await archive.read(all_alarms) == [other]
    await archive.close()


async def test_no_alarm_depends_on_a_text(engine: Engine, tmp_path: Path) -> None:
    """The battery is low, and charged again: the reports raise an alarm, and clear it."""
    with Bench(tmp_path) as bench:
        for number, voltage_v in enumerate((LOW_V, FULL_V), 1):
            bench.voltage_v = voltage_v
            bench.run(3.0)
            bench.submit(Resume(), number)
        reported = [
            notified_of("jackal", LinkKind.DIRECT, ReceivedReport(each.sequence, each), each.utc_s)
            for each in bench.received.reports
        ]
    archive, found = Archive(engine, OPERATING_SYSTEM.utc_s), []
    for asset in ("as told", "reworded"):
        alarms = AlarmRequests(archive, lambda _: None, lambda *_: (None, None))
        for each in reported:
            alarms.on_report(
                replace(each, asset=asset, text="x" if asset == "reworded" else each.text)
            )
        await alarms.close()
        of_asset = await archive.read(partial(read_alarms, page=TablePage(asset, None, None, 9)))
        found.append([(each.source, each.cleared, each.occurrences) for each in of_asset])
    await archive.close()
    assert found[0] == found[1]
    cleared = [when for source, when, _ in found[0] if source == BATTERY]
    assert len(cleared) == 1
    assert cleared[0] is not None


async def test_an_alarm_raised_during_a_write_is_not_lost(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    reported: list[AlarmStatus] = []
    alarms = AlarmRequests(archive, reported.append, lambda *_: (None, None))

    def receive(utc: float, text: str) -> None:
        alarms.on_report(replace(notified(1, utc), text=text))

    receive(1.0, "dust")
    polls = [asyncio.create_task(alarms.refresh()) for _ in range(3)]
    await asyncio.sleep(0)
    receive(2.0, "wind")
    await asyncio.gather(*polls)
    await alarms.refresh()
    assert [each.text for each in reported] == ["dust", "wind"]
    await archive.close()


async def test_a_report_received_at_the_end_is_stored_and_blocks_nothing(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    alarms = AlarmRequests(archive, lambda _: None, lambda *_: (None, None))
    running = asyncio.create_task(alarms.run())
    await asyncio.sleep(0.1)
    alarms.on_report(replace(notified(1, 1.0), text="late", severity="WARNING"))
    running.cancel()
    done, _ = await asyncio.wait({running}, timeout=5.0)
    assert done
    await alarms.close()
    assert [each.text for each in await archive.read(open_alarms)] == ["late"]
    await archive.close()


@pytest.mark.parametrize(
    "page", [TablePage("no", None, None, 9), TablePage(None, 5_000_001, None, 9)]
)
async def test_alarms_are_found_by_asset_and_time(engine: Engine, page: TablePage) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    changes = (AlarmRaised("jackal", "event 1", 5.0, "WARNING", "dust"),)
    await archive.write(partial(change_alarms, changes=changes))
    assert await archive.read(partial(read_alarms, page=page)) == []
    found = await archive.read(
        partial(read_alarms, page=TablePage("jackal", 5_000_000, 5_000_001, 9))
    )
    assert [each.cleared for each in found] == [5.0]
    await archive.close()
