"""Transfers on real sockets: chunks and offsets, a stop amid them, several at a time."""

import asyncio
import random
from functools import partial
from zlib import crc32

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from adapters.mal import AttributeType, Consumer, MalError, Subscription, TypedList
from adapters.mrs.spec import types
from adapters.mrs.spec.specification import mrs_specification
from adapters.mrs.spec.types import FileEventType, FileReport
from executive.reports import Stage
from tests.mrs.aboard import Aboard
from tests.mrs.transferring import BIG, fetch, put, retrieve

HEADER = types.CommandHeader(commandId=1, source="MOE", reportStarted=True, reportProgress=True)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    size=st.integers(0, 700),
    offset=st.none() | st.integers(0, 800),
    chunk=st.none() | st.integers(0, 80),
)
def test_chunks_join_to_the_rest_of_the_file(
    aboard: Aboard,
    monkeypatch: pytest.MonkeyPatch,
    size: int,
    offset: int | None,
    chunk: int | None,
) -> None:
    for name, octets in (("READ_OCTETS", 64), ("LARGEST_CHUNK_OCTETS", 64), ("CHUNK_OCTETS", 16)):
        monkeypatch.setattr(f"adapters.mrs.aboard.file_services.{name}", octets)
    film = random.Random(size).randbytes(size)
    put(aboard, film)
    bad = (1,) if chunk in range(1, 65) or chunk is None else (2,)

    async def session(consumer: Consumer) -> None:
        if (offset or 0) > size or bad == (2,):
            with pytest.raises(MalError) as raised:
                await fetch(consumer, "film.avi", offset, chunk)
            assert raised.value.number == 1
            assert raised.value.extra == TypedList(AttributeType.UINTEGER, bad)
            return
        came, report = await fetch(consumer, "film.avi", offset, chunk)
        rest = film[offset or 0 :]
        assert came == rest
        wanted = FileReport(path="film.avi", octets=len(rest), checksum=crc32(film))
        assert report == wanted

    aboard.consume(session)


@pytest.mark.parametrize(
    ("asked", "number", "extra"),
    [
        (("nothing",), 5, "nothing"),
        (("../ledger.sqlite",), 1, (0,)),
        (("",), 1, (0,)),
        (("film.avi", 0, 0), 1, (2,)),
        (("film.avi", 0, (1 << 18) + 1), 1, (2,)),
        (("film.avi", 5), 1, (1,)),
        (("film.avi", (1 << 64) - 1), 1, (1,)),
    ],
)
def test_what_cannot_be_sent_is_refused(
    aboard: Aboard, asked: tuple[str, int], number: int, extra: object
) -> None:
    put(aboard, b"film")

    async def session(consumer: Consumer) -> MalError:
        with pytest.raises(MalError) as raised:
            await fetch(consumer, *asked)
        return raised.value

    error = aboard.consume(session)
    assert error.number == number
    said = error.extra.value if isinstance(extra, str) else error.extra.values
    assert said == extra


def test_a_stop_is_served_between_two_chunks(aboard: Aboard) -> None:
    put(aboard, BIG)
    order: list[str] = []

    async def session(consumer: Consumer) -> None:
        async with retrieve(consumer, "film.avi") as progress:
            await anext(progress)
            stop = asyncio.create_task(consumer.submit("MotionControl", "stop", HEADER))
            stop.add_done_callback(lambda _: order.append("stop"))
            async for (chunk,) in progress:
                order.append("chunk")
                assert chunk.data
                await asyncio.sleep(0.001)  # a link that is slower than the rover
            order.append("whole")
            await stop

    aboard.consume(session)
    assert order.count("chunk") > 700
    assert order.count("stop") == 1
    assert order[-1] == "whole", "the stop came in among the chunks, by the same way"
    assert aboard.do(lambda bench: bench.stages(1))[-1] is Stage.EXECUTED


def test_several_at_a_time_and_no_more_than_there_is_room_for(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adapters.mrs.aboard.file_services.MOST_TRANSFERS", 2)
    put(aboard, BIG)
    put(aboard, BIG[:3_000_000], "other.avi")

    async def session(consumer: Consumer) -> None:
        one, other = await asyncio.gather(
            fetch(consumer, "film.avi"), fetch(consumer, "other.avi", 1_000_000)
        )
        assert one[0] == BIG
        assert other[0] == BIG[1_000_000:3_000_000]
        assert one[1].checksum == crc32(BIG)
        neighbour = await Consumer.connect(mrs_specification(), aboard.uri)
        async with (
            retrieve(consumer, "film.avi") as first,
            retrieve(neighbour, "film.avi") as second,
        ):
            assert first.acknowledgement == second.acknowledgement
            refused = partial(fetch, path="other.avi")
            with pytest.raises(MalError) as raised:
                await asyncio.to_thread(aboard.consume, refused)
            assert raised.value.number == 6
        await neighbour.close()

    aboard.consume(session)


def test_it_is_told_when_all_was_sent(aboard: Aboard) -> None:
    put(aboard, b"film")
    heard: asyncio.Queue[tuple[FileEventType, str]] = asyncio.Queue()

    async def session(consumer: Consumer) -> None:
        await consumer.subscribe(
            "FileManagement",
            "monitorFiles",
            Subscription(subscriptionId="all"),
            lambda _, event, file: heard.put_nowait((event, file.path)),
        )
        await fetch(consumer, "film.avi", 2)
        assert await heard.get() == (FileEventType.TRANSFERRED, "film.avi")

    aboard.consume(session)
