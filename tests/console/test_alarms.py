"""Alarms: raised, cleared and acknowledged, by several consoles and over restarts."""

import asyncio
import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import Engine, text

from adapters.console.archive import (
    METADATA,
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
    open_database,
    read_alarms,
    read_notifications,
    shelve_alarm,
)
from adapters.console.messages import AlarmStatus, LinkKind, NotificationMessage
from adapters.console.requests import AlarmRequests
from adapters.console.rovers import notification_message as notified_of
from adapters.mrs.spec import ReceivedReport
from adapters.system import OPERATING_SYSTEM
from executive.commands import Resume
from executive.values.reasons import Reason
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
        assert voltage["text"] == "Battery voltage is 20 V, below 22 V"
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


def reported(
    utc: float, text: str, severity: str = "WARNING", **fields: Any
) -> NotificationMessage:
    given = {"text": text, "severity": severity, "kind": "EVENT"} | fields
    return replace(notified(1, utc), **given)


LATE: dict[str, Any] = {"code": Reason.ODOMETRY_STALE.value, "fault": "odometry_stale"}
ENDED = {**LATE, "kind": "COMMAND", "command": "m1"}
OPERATORS_OWN = (
    reported(1.0, "too far", kind="COMMAND", stage="REJECTED", code=102, command="m1"),
    reported(2.0, "stopped by MOE", kind="COMMAND", stage="CANCELLED", code=801, command="m2"),
    reported(3.0, "plan p SUSPENDED: stopped by MOE", code=Reason.STOPPED.value),
    reported(3.1, "plan p SUSPENDED: by anna", code=Reason.PLAN_SUSPENDED.value),
    reported(4.0, "duplicate of anna:1", code=Reason.DUPLICATE.value),
    reported(
        5.0, "off", "ALARM", kind="COMMAND", stage="FAILED", code=711, command="jackal:plan:p:1"
    ),
)
ONE_LATE_ODOMETRY = (
    reported(10.0, "odometry is 0.3 s old", "ALARM", **LATE),
    reported(10.0, "plan p SUSPENDED: odometry is 0.3 s old", code=LATE["code"]),
    reported(10.1, "odometry is 0.3 s old", "ALARM", stage="FAILED", **ENDED),
    reported(10.1, "odometry is 0.3 s old", stage="CANCELLED", **(ENDED | {"command": "m2"})),
)
ONE_RESTART = (
    reported(20.0, "was interrupted", "ALARM", kind="COMMAND", stage="FAILED", code=803),
    reported(20.1, "plan p SUSPENDED: the executive was restarted", code=803),
)


async def test_equal_causes_are_one_alarm_and_actions_of_operators_none(engine: Engine) -> None:
    archive, log = Archive(engine, OPERATING_SYSTEM.utc_s), [*OPERATORS_OWN, *ONE_LATE_ODOMETRY]
    alarms = AlarmRequests(archive, lambda _: None, lambda *_: None)
    for each in (*log, *ONE_RESTART, *log):  # the other link carries the same reports again
        alarms.on_report(each)
    await alarms.close()
    late, restart = await archive.read(open_alarms)
    assert (late.source, late.occurrences, late.command) == ("fault 902", 1, "m1")
    assert (late.text, late.cleared) == ("odometry is 0.3 s old", None)
    assert (restart.source, restart.occurrences, restart.cleared) == ("reason 803", 2, 20.1)
    cleared = {"code": Reason.FAULT_CLEARED.value, "fault": "odometry_stale"}
    alarms.on_report(reported(11.0, "odometry_stale cleared", "INFORMATIONAL", **cleared))
    alarms.on_report(reported(30.0, "no contact for 9 s: held", code=931, fault="link_lost"))
    await alarms.close()
    assert [each.cleared for each in await archive.read(open_alarms)] == [11.0, 20.1, 30.0]
    await archive.close()


async def test_a_refusal_is_no_alarm_and_wrong_requests_are_refused(
    rover: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, rover.uri, "anna", topics=("link", "alarm", "cmd")) as (anna,):
        await anna.page.is_up()
        await anna.send("far", "activatePlan", plan_id="none")
        await anna.page.until(
            lambda message: message["ty"] == "cmd" and message["state"] == "rejected"
        )
        assert (await anna.get("api/alarms"))["alarms"] == []
        for seen in ("x", [[1]], [[1, True]], [["1", 1]]):
            status, answer = await anna.post("api/alarms/acknowledge", alarms=seen)
            assert (status, answer["field"]) == (422, "alarms")
        shelving: dict[str, object] = {"alarm": 1, "duration": 60.0, "comment": "known"}
        for wrong in ({"alarm": "1"}, {"duration": 1e9}, {"comment": ""}):
            status, answer = await anna.post("api/alarms/shelve", **(shelving | wrong))
            assert (status, [answer["field"]]) == (422, list(wrong))


async def test_consoles_at_one_database_show_the_same(
    launch: Launch, postgres: str, tmp_path: Path
) -> None:
    rover = launch()
    rover.runs = True
    topics, url = ("link", "alarm", "ntf"), fresh(postgres)
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
        for operator in (anna, ben):
            await operator.page.until(is_entry("ben acknowledged the alarm: battery"))
        shelve = {"alarm": here["id"], "duration": 60.0, "comment": "is charged at noon"}
        status, answer = await anna.post("api/alarms/shelve", **shelve)
        shelved = await ben.page.until(is_alarm(BATTERY, shelved_by="anna"))
        assert (status, answer["alarms"][0]["shelved"]) == (200, shelved["shelved"])
        assert shelved["shelved_until"] == pytest.approx(shelved["shelved"] + 60.0, abs=0.001)
        await ben.page.until(is_entry("anna shelved the alarm for 1 min (is charged at noon): "))
        await anna.post("api/alarms/shelve", alarm=here["id"], duration=0)
        await ben.page.until(is_alarm(BATTERY, shelved_until=None, comment=None))
    archive = Archive(open_database(url, tmp_path), OPERATING_SYSTEM.utc_s)
    page = TablePage("jackal", None, None, 100)
    entries = json.loads(await archive.read(partial(read_notifications, page=page)))
    done = [" ".join(each["text"].split()[:2]) for each in entries if each["link"] == "console"]
    assert done == ["anna ended", "anna shelved", "ben acknowledged"]
    await archive.close()


def test_an_archive_without_shelving_is_migrated_with_its_alarms(
    engine: Engine, tmp_path: Path
) -> None:
    with engine.begin() as connection:
        for column in ("shelved_us", "shelved_until_us", "shelved_by", "comment"):
            connection.execute(text(f"ALTER TABLE alarm DROP COLUMN {column}"))
        connection.execute(text("UPDATE alembic_version SET version_num = '0002'"))
        names = "asset, source, severity, text, raised_us, last_us, occurrences, open"
        values = "'jackal', 'fault 905', 'ALARM', 'low', 1000000, 1000000, 1, 1"
        connection.execute(text(f"INSERT INTO alarm ({names}) VALUES ({values})"))
    url = engine.url.render_as_string(hide_password=False).replace("+psycopg", "")
    migrated = open_database(url, tmp_path)
    with migrated.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), METADATA) == []
        (low,) = open_alarms(connection)
    assert (low.source, low.raised, low.shelved_until) == ("fault 905", 1.0, None)
    migrated.dispose()


def is_entry(text: str) -> Callable[[JsonMessage], bool]:
    return lambda message: message["ty"] == "ntf" and message["text"].startswith(text)


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
    shelve = partial(shelve_alarm, number=other.id, shelving=(60.0, "ben", "known"), utc_s=21.0)
    await archive.write(shelve)
    assert await acknowledge(other, 21.0) != []
    assert await change(AlarmCleared("jackal", "fault 1", 22.0)) == []
    (while_shelved,) = await change(raised(utc=80.0))
    assert (while_shelved.shelved_until, while_shelved.comment) == (81.0, "known")
    await acknowledge(while_shelved, 81.0)
    assert await change(AlarmCleared("jackal", "fault 1", 82.0)) == []
    (other,) = await change(raised(utc=90.0))
    assert other.shelved_until is None
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
        alarms = AlarmRequests(archive, lambda _: None, lambda *_: None)
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
    published: list[AlarmStatus | NotificationMessage] = []
    alarms = AlarmRequests(archive, published.append, lambda *_: None)

    def receive(utc: float, text: str) -> None:
        alarms.on_report(replace(notified(1, utc), text=text))

    receive(1.0, "dust")
    polls = [asyncio.create_task(alarms.refresh()) for _ in range(3)]
    await asyncio.sleep(0)
    receive(2.0, "wind")
    await asyncio.gather(*polls)
    await alarms.refresh()
    assert [each.text for each in published] == ["dust", "wind"]
    await archive.close()


async def test_a_report_received_at_the_end_is_stored_and_blocks_nothing(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    alarms = AlarmRequests(archive, lambda _: None, lambda *_: None)
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
