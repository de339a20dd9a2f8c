"""Files in chunks to the ground: whole ones, changed ones, and consumers that take nothing."""

import asyncio
import random
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager, suppress
from functools import partial
from pathlib import Path
from zlib import crc32

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from adapters.mal import Consumer, MalError, ProgressStream, Subscription
from adapters.mrs.spec import FileEventType, FileReport, mrs_specification
from executive.values.reports import Stage
from tests.mrs.aboard import HEADER, Aboard, raises

BIG = random.Random(1).randbytes(1_000_000) * 50
"""More than the sockets between two ends hold: a consumer that waits makes the rover wait."""


def retrieve(
    consumer: Consumer, path: str, offset: int | None = None, chunk: int | None = None
) -> AbstractAsyncContextManager[ProgressStream]:
    return consumer.progress("FileTransfer", "retrieveFile", path, offset, chunk)


async def fetch(
    consumer: Consumer, path: str, offset: int | None = None, chunk: int | None = None
) -> tuple[bytes, FileReport]:
    """Return what comes of a transfer, chunk after chunk, and the report."""
    octets = bytearray()
    async with retrieve(consumer, path, offset, chunk) as progress:
        async for (part,) in progress:
            assert part.offset == (offset or 0) + len(octets)
            octets += part.data
        (report,) = await progress.response()
    return bytes(octets), report


def error_of(
    aboard: Aboard, interfere: Callable[[Consumer, ProgressStream], Awaitable[object]]
) -> MalError:
    """Begin a transfer, interfere once it is under way, and return the error that ends it."""

    async def session(consumer: Consumer) -> MalError:
        async with retrieve(consumer, "film.avi") as progress:
            await anext(progress)
            await interfere(consumer, progress)
            with pytest.raises(MalError) as raised:
                await progress.response()
            return raised.value

    return aboard.consume(session)


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
    for name, octets in (("READ_OCTETS", 64), ("MAX_CHUNK_OCTETS", 64), ("CHUNK_OCTETS", 16)):
        monkeypatch.setattr(f"adapters.mrs.aboard.file_services.{name}", octets)
    film = random.Random(size).randbytes(size)
    aboard.put("film.avi", film)

    async def session(consumer: Consumer) -> None:
        if (offset or 0) > size or chunk == 0:
            with raises(1):
                await fetch(consumer, "film.avi", offset, chunk)
            return
        arrived, report = await fetch(consumer, "film.avi", offset, chunk)
        rest = film[offset or 0 :]
        assert arrived == rest
        wanted = FileReport(path="film.avi", octets=len(rest), checksum=crc32(film))
        assert report == wanted

    aboard.consume(session)


@pytest.mark.parametrize(
    ("requested", "number", "extra"),
    [
        (("nothing",), 5, "nothing"),
        (("../ledger.sqlite",), 1, "path: '../ledger.sqlite': it leaves the folder"),
        (("",), 1, "path: '': a path has 1 to 255 printable characters"),
        (("film.avi", 0, 0), 1, "chunkSize: at least 1 octet, or NULL"),
        (("film.avi", 5), 1, "offset: film.avi has 4 octets"),
        (("film.avi", (1 << 64) - 1), 1, "offset: film.avi has 4 octets"),
    ],
)
async def test_what_cannot_be_sent_is_refused(
    aboard: Aboard, requested: tuple[str, int], number: int, extra: str, consumer: Consumer
) -> None:
    aboard.put("film.avi", b"film")

    with pytest.raises(MalError) as raised:
        await fetch(consumer, *requested)
    error = raised.value
    assert error.number == number
    assert error.extra.value == extra


async def test_a_stop_is_served_between_two_chunks(aboard: Aboard, consumer: Consumer) -> None:
    aboard.put("film.avi", BIG)
    order: list[str] = []

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
    assert order.count("chunk") > 700
    assert order.count("stop") == 1
    assert order[-1] == "whole", "the stop came in among the chunks, by the same way"
    assert aboard.do(lambda bench: bench.finish(1)) is Stage.EXECUTED


async def test_several_at_a_time_and_no_further_than_capacity(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch, consumer: Consumer
) -> None:
    monkeypatch.setattr("adapters.mrs.aboard.file_services.MAX_TRANSFERS", 2)
    aboard.put("film.avi", BIG)
    aboard.put("other.avi", BIG[:3_000_000])

    one, other = await asyncio.gather(
        fetch(consumer, "film.avi"), fetch(consumer, "other.avi", 1_000_000)
    )
    assert one[0] == BIG
    assert other[0] == BIG[1_000_000:3_000_000]
    assert one[1].checksum == crc32(BIG)
    neighbour = await Consumer.connect(mrs_specification(), aboard.uri)
    async with retrieve(consumer, "film.avi") as first, retrieve(neighbour, "film.avi") as second:
        assert first.acknowledgement == second.acknowledgement
        refused = partial(fetch, path="other.avi")
        with raises(6):
            await asyncio.to_thread(aboard.consume, refused)
    await neighbour.close()


async def test_it_is_notified_when_all_was_sent(aboard: Aboard, consumer: Consumer) -> None:
    aboard.put("film.avi", b"film")
    received: asyncio.Queue[tuple[FileEventType, str]] = asyncio.Queue()

    await consumer.subscribe(
        "FileManagement",
        "monitorFiles",
        Subscription(subscriptionId="all"),
        lambda _, event, file: received.put_nowait((event, file.path)),
    )
    await fetch(consumer, "film.avi", 2)
    assert await received.get() == (FileEventType.TRANSFERRED, "film.avi")


def test_a_consumer_that_accepts_nothing_delays_no_other(aboard: Aboard) -> None:
    aboard.put("film.avi", BIG)

    async def session(slow: Consumer) -> None:
        async with retrieve(slow, "film.avi") as progress:
            await anext(progress)
            octets, _ = await asyncio.to_thread(aboard.consume, partial(fetch, path="film.avi"))
            assert octets == BIG
            size = 1 << 16
            async for (chunk,) in progress:
                assert chunk.data == BIG[size : size + len(chunk.data)]
                size += len(chunk.data)
            assert size == len(BIG)

    aboard.consume(session)


def test_a_consumer_that_accepts_nothing_for_too_long_is_aborted(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adapters.mrs.aboard.file_services.STALLED_S", 0.2)
    monkeypatch.setattr("adapters.mrs.aboard.file_services.MAX_TRANSFERS", 1)
    aboard.put("film.avi", BIG)

    async def ended(consumer: Consumer) -> None:
        """Return when there is room for a transfer again."""
        while True:
            with suppress(MalError):
                await fetch(consumer, "film.avi", len(BIG))
                return

    async def wait(*_: object) -> None:
        await asyncio.to_thread(aboard.consume, ended)

    error = error_of(aboard, wait)
    assert error.number == 2
    assert "no chunk was accepted for 0.2 s" in error.extra.value


def grow(film: Path) -> None:
    with film.open("ab") as file:
        file.write(b"more")


def shrink(film: Path) -> None:
    with film.open("r+b") as file:
        file.truncate(100)


def replace_by_its_like(film: Path) -> None:
    film.with_name("new").write_bytes(BIG)
    film.with_name("new").replace(film)


def rewrite(film: Path) -> None:
    film.write_bytes(BIG[::-1])


@pytest.mark.parametrize(
    ("change", "number"),
    [(rewrite, 2), (grow, 2), (shrink, 2), (replace_by_its_like, 2), (Path.unlink, 5)],
)
def test_a_file_that_changes_ends_its_transfer(
    aboard: Aboard, change: Callable[[Path], object], number: int
) -> None:
    film = aboard.put("film.avi", BIG)

    async def interfere(*_: object) -> None:
        change(film)

    error = error_of(aboard, interfere)
    assert error.number == number
    assert "film.avi" in error.extra.value


def test_a_transfer_is_cancelled_from_another_connection_of_its_peer(
    aboard: Aboard,
) -> None:
    aboard.put("film.avi", BIG)

    async def cancel(consumer: Consumer) -> None:
        await consumer.submit("FileTransfer", "cancelTransfer", "film.avi")

    async def interfere(*_: object) -> None:
        await asyncio.to_thread(aboard.consume, cancel)

    error = error_of(aboard, interfere)
    assert (error.number, error.extra.value) == (2, "the transfer of film.avi was cancelled")
    with raises(5):
        aboard.consume(cancel)


def test_a_disconnected_consumer_is_sent_nothing_further(aboard: Aboard) -> None:
    aboard.put("film.avi", BIG)

    async def leave(consumer: Consumer) -> None:
        async with retrieve(consumer, "film.avi") as progress:
            await anext(progress)

    aboard.consume(leave)

    async def none_runs(consumer: Consumer) -> None:
        """Return when there is none to be cancelled."""
        with suppress(MalError):
            while True:
                await consumer.submit("FileTransfer", "cancelTransfer", "film.avi")

    aboard.consume(none_runs)
