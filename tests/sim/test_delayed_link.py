"""The simulated link with light time holds a bounded number of octets, of MAL messages only."""

import asyncio
from contextlib import suppress

from sim.processes.delayed_link import DelayedLink, LinkConditions

HOST = "127.0.0.1"
TLS_HELLO = bytes.fromhex("1603010200010001fc0303")
MIB = 1 << 20


def exchange(conditions: LinkConditions, octets: bytes, until_s: float) -> tuple[bool, int]:
    """Send octets to a rover that does not read.

    Returns:
        Whether the link disconnects, and the number of octets that it takes.
    """

    async def scenario() -> tuple[bool, int]:
        done, ended, sent, disconnected = asyncio.Event(), asyncio.Event(), 0, False

        async def hold(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await done.wait()
            writer.transport.abort()
            ended.set()

        rover = await asyncio.start_server(hold, HOST, 0, limit=1024)
        link = DelayedLink(HOST, rover.sockets[0].getsockname()[1], conditions)
        server = await link.serve(HOST, 0)
        async with rover, server:
            port = server.sockets[0].getsockname()[1]
            reader, writer = await asyncio.open_connection(HOST, port)
            with suppress(TimeoutError):
                async with asyncio.timeout(until_s):
                    for at in range(0, len(octets), MIB):
                        writer.write(octets[at : at + MIB])
                        await writer.drain()
                        sent += min(MIB, len(octets) - at)
                    with suppress(ConnectionError):
                        await reader.read()
                    disconnected = True
            done.set()
            await ended.wait()
            writer.transport.abort()
        return disconnected, sent

    return asyncio.run(scenario())


def test_losses_end_a_connection_without_mal_messages_in_clear_text() -> None:
    disconnected, _ = exchange(LinkConditions(0.0, loss=0.5), TLS_HELLO, 5.0)
    assert disconnected


def test_a_rover_that_does_not_read_holds_the_client() -> None:
    _, sent = exchange(LinkConditions(0.0), bytes(96 * MIB), 1.0)
    assert MIB < sent < 48 * MIB
