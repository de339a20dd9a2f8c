"""A provider of the MRS without a rover behind it, so that the MAL alone is measured."""

import asyncio
import time
from typing import Any, Final

from adapters.mal.interaction import Interaction
from adapters.mal.provider import Call, Provider
from adapters.mal.values import AttributeType, Typed
from adapters.mrs.specification import NAME, mrs_specification
from adapters.mrs.types import FileChunk, FileInfo, FileReport, ParameterValue, Pose, Validity
from executive.parameters import Parameter
from sim.bench.transfer_size import CHUNK_OCTETS, TRANSFER_OCTETS

RATE_HZ: Final = 10.0
POSE: Final = Pose(frame="odom", x=1.0, y=2.0, z=0.0, heading=0.5)


def get_pose(_call: Call) -> tuple[Pose]:
    """Answer at once."""
    return (POSE,)


async def retrieve_file(
    interaction: Interaction, path: str, _offset: int | None, _chunk: int | None
) -> tuple[FileReport]:
    """Send a file that is all zeros and on no disk."""
    interaction.acknowledge(FileInfo(path=path, size=TRANSFER_OCTETS, modified=0))
    for offset in range(0, TRANSFER_OCTETS, CHUNK_OCTETS):
        data = bytes(min(CHUNK_OCTETS, TRANSFER_OCTETS - offset))
        await interaction.update(FileChunk(offset=offset, data=data))
    return (FileReport(path=path, octets=TRANSFER_OCTETS, checksum=0),)


async def publish(publisher: Any) -> None:
    """Send every parameter at a rate; a value says which time it is, its timestamp when it left."""
    loop = asyncio.get_running_loop()
    began_s, tick = loop.time(), 0
    while True:
        tick += 1
        await asyncio.sleep(began_s + tick / RATE_HZ - loop.time())
        for parameter in Parameter:
            value = ParameterValue(
                name=parameter.value,
                timestamp=time.monotonic_ns(),
                validity=Validity.VALID,
                value=Typed(AttributeType.DOUBLE, float(tick)),
            )
            keys = ("bench", parameter.value)
            publisher.publish(value, keys=keys, domain=("bench",), source="bench", droppable=True)


async def serve() -> None:
    """Print the address and serve until killed."""
    provider = Provider(mrs_specification(), NAME)
    provider.serve("MotionControl", "getPose", get_pose)
    provider.serve("FileTransfer", "retrieveFile", retrieve_file)
    publisher = provider.publisher("Monitoring", "monitorValue")
    await provider.start()
    print(f"listens at {provider.uri}", flush=True)
    await publish(publisher)


if __name__ == "__main__":
    asyncio.run(serve())
