"""Transfers that something happens to: slow and lost consumers, files that change, cancelling."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

from adapters.mal.consumer import Consumer
from adapters.mal.errors import MalError
from adapters.mrs.aboard.file_services import FileServices
from tests.mrs.aboard import Aboard
from tests.mrs.transferring import BIG, error_of, fetch, put, retrieve


def test_who_takes_nothing_holds_up_nobody(aboard: Aboard) -> None:
    put(aboard, BIG)

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


def test_who_takes_nothing_for_too_long_is_given_up(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    aboard.hang_up()
    impatient = partial(FileServices, stalled_s=0.2)
    monkeypatch.setattr("adapters.mrs.link.FileServices", impatient)
    monkeypatch.setattr("adapters.mrs.aboard.file_services.MOST_TRANSFERS", 1)
    aboard.listen()
    put(aboard, BIG)

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
    assert "nothing was taken for 0.2 s" in error.extra.value


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
    film = put(aboard, BIG)

    async def interfere(*_: object) -> None:
        change(film)

    error = error_of(aboard, interfere)
    assert error.number == number
    assert "film.avi" in error.extra.value


def test_a_transfer_is_cancelled_by_whoever_wants(aboard: Aboard) -> None:
    put(aboard, BIG)

    async def cancel(consumer: Consumer) -> None:
        await consumer.submit("FileTransfer", "cancelTransfer", "film.avi")

    async def interfere(*_: object) -> None:
        await asyncio.to_thread(aboard.consume, cancel)

    error = error_of(aboard, interfere)
    assert (error.number, error.extra.value) == (2, "the transfer of film.avi was cancelled")
    with pytest.raises(MalError) as raised:
        aboard.consume(cancel)
    assert raised.value.number == 5


def test_who_hangs_up_is_sent_nothing_more(aboard: Aboard) -> None:
    put(aboard, BIG)

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
