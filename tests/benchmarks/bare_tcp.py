"""Plain asyncio TCP, to compare the MAL with: an echo, or, given a file, a source of its octets."""

import asyncio
import sys
from functools import partial
from pathlib import Path
from typing import Final

TRANSFER_OCTETS: Final = 50_000_000
CHUNK_OCTETS: Final = 64 * 1024


async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Send back what comes, as it comes."""
    while octets := await reader.read(CHUNK_OCTETS):
        writer.write(octets)
        await writer.drain()


async def source(path: Path, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Send a file in chunks for each octet that comes."""
    while await reader.read(1):
        with path.open("rb", buffering=0) as file:
            while chunk := file.read(CHUNK_OCTETS):
                writer.write(chunk)
                await writer.drain()


async def serve(path: Path | None) -> None:
    """Print the port and serve until killed."""
    talk = echo if path is None else partial(source, path)
    server = await asyncio.start_server(talk, "127.0.0.1", 0)
    print(f"listens at {server.sockets[0].getsockname()[1]}", flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(serve(Path(sys.argv[1]) if len(sys.argv) > 1 else None))
