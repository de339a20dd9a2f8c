"""A file of 50 MB by PROGRESS, beside as many octets over plain asyncio TCP."""

import asyncio
import time
from typing import Final

from adapters.mal.consumer import Consumer
from adapters.mrs.specification import mrs_specification
from sim.bench.figures import Figure, Goal, quantile
from sim.bench.mal_provider import FILE
from sim.bench.transfer_size import CHUNK_OCTETS, TRANSFER_OCTETS

MB: Final = 1e6
LEAST_RATIO: Final = 0.5


async def transfer(uri: str, source_port: int, transfers: int) -> list[Figure]:
    """Return the rates of both, taken in turn after one of each that is not counted."""
    consumer = await Consumer.connect(mrs_specification(), uri)
    reader, writer = await asyncio.open_connection("127.0.0.1", source_port)
    ours_s, theirs_s = [], []
    for _ in range(1 + transfers):
        ours_s.append(await _by_progress(consumer))
        theirs_s.append(await _by_tcp(reader, writer))
    await consumer.close()
    writer.close()
    ours, theirs = (
        TRANSFER_OCTETS / MB / quantile(taken_s[1:], 0.5) for taken_s in (ours_s, theirs_s)
    )
    beside = f"{transfers} times a file of 50 MB in chunks of 64 KiB, in turn; median"
    goal = Goal(LEAST_RATIO, at_least=True)
    return [
        Figure("transfer by PROGRESS", ours, "MB/s", beside),
        Figure("plain asyncio TCP", theirs, "MB/s", beside),
        Figure("PROGRESS over plain TCP", ours / theirs, "ratio", beside, goal),
    ]


async def _by_progress(consumer: Consumer) -> float:
    octets = 0
    began_s = time.perf_counter()
    async with consumer.progress(
        "FileTransfer", "retrieveFile", FILE, None, CHUNK_OCTETS
    ) as progress:
        async for (chunk,) in progress:
            octets += len(chunk.data)
    assert octets == TRANSFER_OCTETS
    return time.perf_counter() - began_s


async def _by_tcp(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> float:
    left = TRANSFER_OCTETS
    began_s = time.perf_counter()
    writer.write(b"\0")
    while left:
        octets = await reader.read(CHUNK_OCTETS)
        if not octets:
            raise ConnectionError("the source hung up")
        left -= len(octets)
    return time.perf_counter() - began_s
