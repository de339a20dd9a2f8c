"""A file aboard that is under way to the ground, on a real socket."""

import random
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import pytest

from adapters.mal import Consumer, MalError, Progress
from adapters.mrs.spec.types import FileReport
from tests.mrs.aboard import Aboard

BIG = random.Random(1).randbytes(1_000_000) * 50
"""More than the sockets between two ends hold: a consumer that waits makes the rover wait."""


def put(aboard: Aboard, octets: bytes, path: str = "film.avi") -> Path:
    root = aboard.do(lambda bench: bench.executive.files.root)
    root.mkdir(exist_ok=True)
    place: Path = root / path
    place.write_bytes(octets)
    return place


def retrieve(
    consumer: Consumer, path: str, offset: int | None = None, chunk: int | None = None
) -> AbstractAsyncContextManager[Progress]:
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
    aboard: Aboard, interfere: Callable[[Consumer, Progress], Awaitable[object]]
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
