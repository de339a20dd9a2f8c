"""Whom the benchmark of the MAL talks to: `python -m tests.benchmarks.mal_peers`.

`provider` serves the MRS without a rover behind it, so that only the link is measured. `echo` and
`source` are plain asyncio TCP to compare it with: an echo, and a source of a file's octets.
"""

import asyncio
import os
import sys
import time
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Final

from adapters.mal import AttributeType, CallContext, TypedAttribute
from adapters.mrs.aboard import FileServices, ServedOperations
from adapters.mrs.spec import ParameterValue, Pose, Validity
from executive.settings import load_settings
from executive.state import FileFolder
from executive.values.parameters import Parameter

TRANSFER_OCTETS: Final = 50_000_000
CHUNK_OCTETS: Final = 64 * 1024
RATE_HZ: Final = 10.0
FILE: Final = "file"
POSE: Final = Pose(frame="odom", x=1.0, y=2.0, z=0.0, heading=0.5)


def get_pose(_call: CallContext) -> tuple[Pose]:
    return (POSE,)


def serve_file(offer: ServedOperations, root: Path) -> FileServices:
    """Serve a folder with one file, as it is served aboard."""
    (root / FILE).write_bytes(os.urandom(TRANSFER_OCTETS))
    folder = FileFolder(root, lambda _event: None)

    async def absent() -> None:
        return None

    return FileServices(offer, folder, load_settings("jackal"), absent)


async def publish(log: Callable[..., None]) -> None:
    """Send every parameter at a rate: the value is the number of the round, the timestamp now."""
    loop = asyncio.get_running_loop()
    began_s, number = loop.time(), 0
    while True:
        number += 1
        await asyncio.sleep(began_s + number / RATE_HZ - loop.time())
        for parameter in Parameter:
            value = ParameterValue(
                name=parameter.value,
                timestamp=time.monotonic_ns(),
                validity=Validity.VALID,
                value=TypedAttribute(AttributeType.DOUBLE, float(number)),
            )
            log(value, keys=("bench", parameter.value))


async def serve_provider(root: Path) -> None:
    """Print the address and serve until killed."""
    root.mkdir()
    offer = ServedOperations()
    offer.serve("MotionControl", "getPose", get_pose)
    serve_file(offer, root)
    log = offer.broadcast("Monitoring", "monitorValue", "bench", ("bench",), droppable=True)
    await offer.provider.start()
    print(f"listens at {offer.provider.uri}", flush=True)
    await publish(log)


async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
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


async def serve_tcp(talk: Callable[..., Awaitable[None]]) -> None:
    server = await asyncio.start_server(talk, "127.0.0.1", 0)
    print(f"listens at {server.sockets[0].getsockname()[1]}", flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    match sys.argv[1:]:
        case "provider", root:
            asyncio.run(serve_provider(Path(root)))
        case "source", file:
            asyncio.run(serve_tcp(partial(source, Path(file))))
        case _:
            asyncio.run(serve_tcp(echo))
