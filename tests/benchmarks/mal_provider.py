"""Services of the MRS without a rover behind them, so that only the link is measured."""

import asyncio
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from adapters.mal import AttributeType, Call, Typed
from adapters.mrs.aboard import FileServices, ServedOperations
from adapters.mrs.spec.types import ParameterValue, Pose, Validity
from executive.settings import load_settings
from executive.state import FileFolder, Parameter
from tests.benchmarks.bare_tcp import TRANSFER_OCTETS

RATE_HZ: Final = 10.0
FILE: Final = "file"
POSE: Final = Pose(frame="odom", x=1.0, y=2.0, z=0.0, heading=0.5)


def get_pose(_call: Call) -> tuple[Pose]:
    """Answer at once."""
    return (POSE,)


def serve_file(offer: ServedOperations, root: Path) -> FileServices:
    """Serve a folder with one file, as it is served aboard."""
    (root / FILE).write_bytes(os.urandom(TRANSFER_OCTETS))
    folder = FileFolder(root, lambda _event: None)
    return FileServices(offer, folder, load_settings("jackal"))


async def publish(tell: Callable[..., None]) -> None:
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
                value=Typed(AttributeType.DOUBLE, float(number)),
            )
            tell(value, keys=("bench", parameter.value))


async def serve(root: Path) -> None:
    """Print the address and serve until killed."""
    offer = ServedOperations()
    offer.serve("MotionControl", "getPose", get_pose)
    serve_file(offer, root)
    tell = offer.broadcast("Monitoring", "monitorValue", "bench", ("bench",), droppable=True)
    await offer.provider.start()
    print(f"listens at {offer.provider.uri}", flush=True)
    await publish(tell)


if __name__ == "__main__":
    root = Path(sys.argv[1])
    root.mkdir()
    asyncio.run(serve(root))
