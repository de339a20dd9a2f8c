"""The archive on SQLite and on PostgreSQL: what is kept, found, thinned out and deleted."""

import asyncio
import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import Connection, Engine, event, text
from sqlalchemy.exc import OperationalError

from adapters.console.archive import (
    METADATA,
    Archive,
    RetentionPolicy,
    RevisionConflict,
    SampleQuery,
    StoredObject,
    Strategy,
    TablePage,
    delete_object,
    delete_old,
    get_object,
    last_commands,
    last_notification,
    list_objects,
    open_database,
    put_object,
    read_command,
    read_notifications,
    read_records,
    read_samples,
    to_us,
)
from adapters.console.messages import (
    AssetState,
    CommandState,
    CommandStatus,
    LinkKind,
    NotificationMessage,
    Quality,
    Sample,
    StageEntry,
)
from adapters.process import StartError
from adapters.system import OPERATING_SYSTEM

DAY_S = 86_400.0


def sample(utc: float, value: float | str | None, link: LinkKind = LinkKind.DIRECT) -> Sample:
    quality = Quality.INVALID if value is None else Quality.GOOD
    return Sample("jackal", "POS_X", link, utc, utc + 1, value, quality)


def notified(sequence: int, utc: float = 100.0) -> NotificationMessage:
    return NotificationMessage(
        "jackal", LinkKind.DIRECT, sequence, utc, utc, "EVENT", "WARNING", "dust", None, None, None,
        None, None, {"depth": float("inf")}, cursor=sequence,
    )  # fmt: skip


def command(name: str, state: CommandState, made: float = 5.0) -> CommandStatus:
    ended = state is CommandState.EXECUTED
    history = [StageEntry("SENT", "console", made, made, "by anna", figures={"x": 1.5})]
    if ended:
        history.append(StageEntry("EXECUTED", "jackal", made, made + 1, "", sequence=9))
    args = {"waypoints": [{"x": 1.0}]}
    number = int.from_bytes(name.encode())
    return CommandStatus(
        name, "jackal", "followPath", args, "anna", "anna", number, LinkKind.RELAY, state, ended,
        made, None, tuple(history),
    )  # fmt: skip


async def found(
    archive: Archive,
    strategy: Strategy = Strategy.LATEST,
    size: int = 100,
    link: LinkKind | None = None,
    start: float = 0.0,
    end: float = 1e9,
) -> list[tuple[float, float | str | None, str]]:
    wanted = SampleQuery("jackal", "POS_X", link, to_us(start), to_us(end), strategy, size)
    answer = json.loads(await archive.read(partial(read_samples, wanted=wanted)))
    return [(each["utc"], each["value"], each["q"]) for each in answer]


async def test_an_unwritten_batch_is_written_before_later_ones(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)

    def fail(_: Connection) -> None:
        raise OperationalError("COMMIT", None, Exception("disk I/O error"))

    event.listen(engine, "commit", fail, once=True)
    archive.put(notified(1))
    first = asyncio.create_task(archive.flush())
    await asyncio.sleep(0)
    archive.put(notified(2))
    await asyncio.gather(first, archive.flush())
    await archive.flush()
    last = partial(last_notification, asset="jackal", link=LinkKind.DIRECT)
    assert await archive.read(last) == (2, to_us(100.0))
    await archive.close()


async def test_what_waits_when_writing_is_cancelled_is_written_at_the_end(engine: Engine) -> None:
    archive, proceed = Archive(engine, OPERATING_SYSTEM.utc_s), Event()
    before = asyncio.create_task(archive.write(lambda _: proceed.wait()))
    await asyncio.sleep(0)
    archive.put(notified(1))
    writing = asyncio.create_task(archive.flush())
    await asyncio.sleep(0)
    writing.cancel()
    await asyncio.wait((writing,))
    proceed.set()
    await before
    archive.put(notified(2))
    await archive.flush()
    everything = TablePage(None, None, None, 10)
    stored = json.loads(await archive.read(partial(read_notifications, page=everything)))
    assert sorted(each["cursor"] for each in stored) == [1, 2]
    await archive.close()


async def test_samples_are_found_by_time_and_link_each_once(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    for utc, value in ((3.0, 30.0), (1.0, 10.0), (2.0, None), (3.0, 31.0), (4.5, "Infinity")):
        archive.put(sample(utc, value))
    archive.put(sample(2.0, 21.0, LinkKind.RELAY))
    await archive.flush()
    assert await found(archive, link=LinkKind.DIRECT) == [
        (1.0, 10.0, "good"),
        (2.0, None, "invalid"),
        (3.0, 30.0, "good"),
        (4.5, "Infinity", "good"),
    ]
    assert await found(archive, link=LinkKind.RELAY) == [(2.0, 21.0, "good")]
    assert len(await found(archive)) == 5
    assert [utc for utc, _, _ in await found(archive, size=2)] == [3.0, 4.5]
    assert [utc for utc, _, _ in await found(archive, start=2.0, end=3.0)] == [2.0, 2.0, 3.0]
    assert (
        await archive.read(
            partial(
                read_samples,
                wanted=SampleQuery("no", "POS_X", None, 0, 1, Strategy.LATEST, 1),
            )
        )
        == "[]"
    )
    await archive.close()


async def test_a_long_time_is_thinned_out_without_losing_its_extremes(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    for number in range(1000):
        archive.put(sample(float(number), {333: -50.0, 666: 50.0}.get(number, number % 7)))
    await archive.flush()
    thin = await found(archive, Strategy.MINMAX, size=20)
    assert len(thin) <= 40
    assert thin == sorted(thin)
    assert (333.0, -50.0, "good") in thin
    assert (666.0, 50.0, "good") in thin
    few = await found(archive, Strategy.MINMAX, size=20, start=10.0, end=40.0)
    assert len(few) == 31  # as they are
    await archive.close()


async def test_an_outage_is_a_gap_however_long_the_time_is(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    for second in range(20 * 3600):
        if second < 2000 or second % 600 == 0:
            value = None if 500 <= second <= 510 else 24.0 + second % 5
            quality = Quality.INVALID if value is None else Quality.GOOD
            utc = float(second)
            archive.put(Sample("jackal", "POS_X", LinkKind.DIRECT, utc, utc, value, quality))
    await archive.flush()
    for end in (600.0, 1999.0, 20 * 3600.0):
        for size in (5, 50, 500):
            thin = await found(archive, Strategy.MINMAX, size=size, end=end)
            unknown = [utc for utc, value, _ in thin if value is None]
            assert unknown
            assert all(500.0 <= utc <= 510.0 for utc in unknown)
            assert min(unknown) == 500.0
    await archive.close()


RECEIVED = st.lists(
    st.tuples(
        st.builds(
            lambda minute, second: minute * 60.0 + second,
            st.sampled_from([0, 1, 2, 700, 701, 1400]),
            st.sampled_from([0, 0.5, 30, 59.999999]),
        ),
        st.sampled_from([None, "Infinity", -1.0, 0.0, 1.0, 2.5]),
    ),
    min_size=12,
    max_size=60,
)
"""Times, some of them twice, and values, in the order of their arrival."""


def test_a_long_time_is_thinned_out_alike_in_any_order_of_reception(
    engine: Engine,
) -> None:
    @settings(max_examples=30, deadline=None)
    @given(
        received=RECEIVED,
        batch=st.integers(1, 9),
        size=st.integers(1, 6),
        cut=st.sampled_from([0, 0, 0, 5]),
    )
    def check(
        received: list[tuple[float, float | str | None]], batch: int, size: int, cut: int
    ) -> None:
        first: dict[float, tuple[int, float | str | None]] = {}
        for number, (utc, value) in enumerate(received):
            first.setdefault(utc, (number, value))
        expected = {utc: value for utc, (number, value) in first.items() if number >= cut}
        asyncio.run(compare(received, batch, size, cut, thinned(expected, size)))

    async def compare(
        received: list[tuple[float, float | str | None]],
        batch: int,
        size: int,
        cut: int,
        expected: list[tuple[float, float | str | None]],
    ) -> None:
        archive = Archive(engine, OPERATING_SYSTEM.utc_s)
        await delete_old(archive, RetentionPolicy(days=0.0), 1e9)
        for number, (utc, value) in enumerate(received):
            quality = Quality.INVALID if value is None else Quality.GOOD
            received_s = 1000.0 + number
            put = Sample("jackal", "POS_X", LinkKind.DIRECT, utc, received_s, value, quality)
            archive.put(put)
            if number % batch == 0:
                await archive.flush()
        await archive.flush()
        await delete_old(archive, RetentionPolicy(days=0.0), 1000.0 + cut)
        thin = await found(archive, Strategy.MINMAX, size=size)
        assert [(utc, value) for utc, value, _ in thin] == expected
        await archive.close()

    check()


def thinned(
    samples: dict[float, float | str | None], size: int
) -> list[tuple[float, float | str | None]]:
    """Return the extremes and the first gap of each part, as all the samples tell them."""
    times = sorted(samples)
    if len(times) <= 2 * size:
        return [(utc, samples[utc]) for utc in times]
    first_us, last_us = to_us(times[0]), to_us(times[-1])
    width_us = (last_us - first_us) // size + 1
    if last_us - first_us >= 12 * 3600 * 10**6:
        first_us -= first_us % (60 * 10**6)
        width_us = ((last_us - first_us) // (60 * 10**6) // size + 1) * 60 * 10**6
    parts: dict[int, list[tuple[float, float]]] = {}
    gaps: dict[int, float] = {}
    for utc in times:
        value, part = samples[utc], (to_us(utc) - first_us) // width_us
        if isinstance(value, float):
            parts.setdefault(part, []).append((value, utc))
        elif value is None:
            gaps.setdefault(part, utc)
    extremes = {
        utc
        for part in parts.values()
        for utc in (min(part)[1], min((-value, utc) for value, utc in part)[1])
    }
    return [(utc, samples[utc]) for utc in sorted(extremes | set(gaps.values()))]


async def test_commands_notifications_and_records_are_read_as_they_were(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    began = command("one", CommandState.SENDING)
    assert await archive.claim_command(began)
    assert await archive.read(partial(read_command, name="one")) == began
    assert not await archive.claim_command(began)
    ended = command("one", CommandState.EXECUTED, made=5.0)
    archive.put(ended)
    archive.put(command("old", CommandState.STARTED, made=1.0))
    for number in range(9):
        archive.put(command(f"c{number}", CommandState.EXECUTED, made=10.0 + number))
    for sequence in (1, 2, 2, 3):
        archive.put(notified(sequence))
    archive.put(AssetState("jackal", LinkKind.DIRECT, 3.0, "IDLE", None, 0, None))
    for cursor in (5, 6, 6, None, None):  # refusals without a number, and not recorded
        archive.put(replace(notified(0, utc=50.0), cursor=cursor))
    archive.put(notified(4))
    await archive.flush()
    assert await archive.read(partial(read_command, name="one")) == ended
    last = await archive.read(partial(last_commands, count=2))
    assert [each.id for each in last] == ["old", "c7", "c8"]
    reported = json.loads(
        await archive.read(partial(read_notifications, page=TablePage("jackal", None, None, 2)))
    )
    assert len(reported) == 2
    assert reported[0]["figures"] == {"depth": "Infinity"}
    every = partial(read_notifications, page=TablePage("jackal", None, None, 99))
    cursors = [each["cursor"] for each in json.loads(await archive.read(every))]
    assert sorted(cursor or 0 for cursor in cursors) == [0, 1, 2, 3, 4, 5, 6]
    known = partial(last_notification, asset="jackal", link=LinkKind.DIRECT)
    assert await archive.read(known) == (4, to_us(100.0))
    assert await archive.read(partial(last_notification, asset="no", link=LinkKind.DIRECT)) is None
    page = TablePage(None, to_us(0.0), to_us(4.0), 10)
    (state,) = json.loads(await archive.read(partial(read_records, ty="asset", page=page)))
    assert state["mode"] == "IDLE"
    await archive.close()


async def test_objects_change_by_their_revision_only(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)

    async def put(value: str, revision: int | None) -> StoredObject | RevisionConflict:
        return await archive.write(
            lambda connection: put_object(connection, "plot", value, revision, "anna", 1.0)
        )

    assert await put("1", 1) == RevisionConflict(None)
    assert await put("1", None) == StoredObject("plot", 1, "anna", "1")
    assert await put("2", None) == RevisionConflict(1)
    assert await put("2", 1) == StoredObject("plot", 2, "anna", "2")
    assert await put("3", 1) == RevisionConflict(2)
    assert await archive.read(list_objects) == [("plot", 2)]
    assert await archive.read(partial(get_object, key="plot")) == StoredObject(
        "plot", 2, "anna", "2"
    )
    assert await archive.write(partial(delete_object, key="plot", revision=1)) == RevisionConflict(
        2
    )
    assert await archive.write(partial(delete_object, key="plot", revision=2)) is None
    assert await archive.read(partial(get_object, key="plot")) is None
    await archive.close()


async def test_excess_data_is_deleted_in_order_of_age(engine: Engine) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)
    now_s = 100 * DAY_S
    for day in range(100):
        for number in range(50):
            archive.put(sample(day * DAY_S + number, float(number)))
        archive.put(notified(day + 1, utc=day * DAY_S))
    archive.put(command("open", CommandState.UNKNOWN, made=1.0))
    await archive.flush()
    for name in ("first", "last"):
        assert await archive.claim_command(command(name, CommandState.EXECUTED, made=2.0))
    clock_is_wrong = Sample("sim", "X", LinkKind.DIRECT, 5.0, now_s - 1.0, 1.0, Quality.GOOD)
    archive.put(clock_is_wrong)
    await archive.flush()
    await archive.write(lambda connection: put_object(connection, "plot", "1", None, "anna", 1.0))
    await delete_old(archive, RetentionPolicy(days=30.0), now_s)
    stored = await found(archive, size=10_000)
    assert len(stored) == 30 * 50
    assert stored[0][0] == 70 * DAY_S
    wrong = SampleQuery("sim", "X", None, 0, to_us(9.0), Strategy.LATEST, 9)
    assert '"utc":5.0' in await archive.read(partial(read_samples, wanted=wrong))
    await delete_old(archive, RetentionPolicy(days=30.0, megabytes=0.04), now_s)
    fewer = await found(archive, size=10_000)
    assert 0 < len(fewer) < 1000
    assert fewer[-1] == stored[-1]
    await delete_old(archive, RetentionPolicy(days=0.001), now_s)
    assert await found(archive) == []
    known = partial(last_notification, asset="jackal", link=LinkKind.DIRECT)
    assert await archive.read(known) == (100, to_us(99 * DAY_S))
    stored_commands = await archive.read(partial(last_commands, count=9))
    assert [each.id for each in stored_commands] == [
        "open",
        "last",
    ]  # revisions go on from the last
    assert await archive.read(list_objects) == [("plot", 1)]
    await archive.close()


async def test_what_cannot_be_written_waits(
    engine: Engine, caplog: pytest.LogCaptureFixture
) -> None:
    archive = Archive(engine, OPERATING_SYSTEM.utc_s)

    def rename(old: str, new: str) -> None:
        with engine.begin() as connection:
            connection.execute(text(f"ALTER TABLE {old} RENAME TO {new}"))

    rename("sample", "away")
    archive.put(sample(1.0, 1.0))
    await archive.flush()
    await archive.flush()
    assert caplog.text.count("the archive cannot be written") == 1
    rename("away", "sample")
    await archive.flush()
    assert "can be written again" in caplog.text
    assert len(await found(archive)) == 1
    await archive.close()


def test_a_new_archive_has_the_tables(engine: Engine) -> None:
    with engine.connect() as connection:
        context = MigrationContext.configure(connection)
        assert compare_metadata(context, METADATA) == []


@pytest.mark.parametrize("revision", ["0001", "9999"])
def test_an_archive_is_opened_again_and_one_of_another_version_is_refused(
    revision: str, engine: Engine, tmp_path: Path
) -> None:
    url = engine.url.render_as_string(hide_password=False).replace("+psycopg", "")
    open_database(url, tmp_path).dispose()
    with engine.begin() as connection:
        connection.execute(text(f"UPDATE alembic_version SET version_num = '{revision}'"))
    with pytest.raises(StartError, match=rf"another version \(revision {revision}\)"):
        open_database(url, tmp_path)


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("nonsense", "no supported database: write sqlite:///FILE"),
        ("mysql://localhost/x", "no supported database"),
        ("sqlite:////nowhere/at/all.sqlite", "cannot be opened: unable to open"),
        ("postgresql://me:secret@127.0.0.1:1/x", "127.0.0.1:1/x cannot be opened"),
    ],
)
def test_a_database_that_cannot_be_opened_is_reported(
    url: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(StartError, match=message) as raised:
        open_database(url, tmp_path)
    assert "secret" not in str(raised.value)


def test_a_file_that_is_no_database_is_reported(tmp_path: Path) -> None:
    (tmp_path / "archive.sqlite").write_text("something else, and more than a header of it" * 9)
    with pytest.raises(StartError, match="not a database"):
        open_database(None, tmp_path)
