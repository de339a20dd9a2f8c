"""A link that is cut: a TCP proxy whose connections end after so many octets."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress

from adapters.mal import MalUri


class Cutting:
    """Passes octets on, and cuts its connections one after the other.

    Attributes:
        cuts: how many connections it has cut.
    """

    def __init__(self, to: MalUri, budgets: Iterator[int | None]) -> None:
        """Give each connection its octets from the rover; None for all it likes."""
        self._to = to
        self._budgets = budgets
        self._passing: set[asyncio.Task[None]] = set()
        self.cuts = 0

    def pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take a connection."""
        self._passing.add(asyncio.create_task(self._pass_on(reader, writer)))

    async def end(self) -> None:
        """Return when all connections have ended."""
        await asyncio.gather(*self._passing)

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection(self._to.host, self._to.port)
        ways = [
            asyncio.create_task(self._pump(reader, back, None)),
            asyncio.create_task(self._pump(there, writer, next(self._budgets))),
        ]
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
        for end in (writer, back):
            end.transport.abort()
            with suppress(ConnectionError):
                await end.wait_closed()

    async def _pump(
        self, source: asyncio.StreamReader, sink: asyncio.StreamWriter, budget: int | None
    ) -> None:
        try:
            while octets := await source.read(1 << 16):
                if budget is not None and len(octets) >= budget:
                    sink.write(octets[:budget])
                    await sink.drain()
                    self.cuts += 1
                    return
                budget = None if budget is None else budget - len(octets)
                sink.write(octets)
                await sink.drain()
        except ConnectionError:
            return


@asynccontextmanager
async def cutting(uri: str, budgets: Iterator[int | None]) -> AsyncIterator[tuple[str, Cutting]]:
    """Give the address of a link that is cut, and what cuts it."""
    proxy = Cutting(MalUri.parse(uri), budgets)
    server = await asyncio.start_server(proxy.pass_on, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    try:
        yield f"127.0.0.1:{port}", proxy
    finally:
        server.close()
        await server.wait_closed()
        await proxy.end()
