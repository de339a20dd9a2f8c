"""Plain asyncio TCP, to compare the MAL with: an echo, or a source of octets."""

import asyncio
import sys

from sim.bench.transfer_size import CHUNK_OCTETS, TRANSFER_OCTETS


async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Send back what comes, as it comes."""
    while octets := await reader.read(CHUNK_OCTETS):
        writer.write(octets)
        await writer.drain()


async def source(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Send a file's worth of octets, in chunks, for each octet that comes."""
    while await reader.read(1):
        for begin in range(0, TRANSFER_OCTETS, CHUNK_OCTETS):
            writer.write(bytes(min(CHUNK_OCTETS, TRANSFER_OCTETS - begin)))
            await writer.drain()


async def serve(mode: str) -> None:
    """Print the port and serve until killed."""
    talk = {"echo": echo, "source": source}[mode]
    server = await asyncio.start_server(talk, "127.0.0.1", 0)
    print(f"listens at {server.sockets[0].getsockname()[1]}", flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1]))
