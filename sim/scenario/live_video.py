"""The ground's end of the video stream in a live run."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from adapters.video.jpeg_stream import JpegStream
from sim.scenario.record import Datagram, Record


class _Watch(asyncio.DatagramProtocol):
    def __init__(self, record: Record) -> None:
        self._record = record
        self._stream = JpegStream()

    def datagram_received(self, data: bytes, _: object) -> None:
        time_s = time.time() - self._record.start_utc_s
        self._record.video.append(Datagram(time_s, self._stream.add(data)))


@asynccontextmanager
async def watched(ground: socket.socket, record: Record) -> AsyncIterator[None]:
    """Put every datagram that arrives into the record.

    Args:
        ground: a UDP socket, bound to where the rover forwards to.
        record: where to.
    """
    loop = asyncio.get_running_loop()
    own = ground.dup()
    own.setblocking(False)
    transport, _ = await loop.create_datagram_endpoint(lambda: _Watch(record), sock=own)
    try:
        yield
    finally:
        transport.close()
