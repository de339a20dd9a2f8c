"""A simulated rover as processes: simulation, executive, and what stands between them."""

import asyncio
import re
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from executive.settings import Way, load_settings
from sim.processes.children import Child
from sim.processes.place import ANY_PORT, HOST, Place

LOOK_S: Final = 0.1
LISTENS: Final = re.compile(r"listens at (maltcp://\S+)")


class Deployment:
    """A rover that runs.

    Attributes:
        place: where the processes meet.
        aboard: the executive's own folder.
    """

    def __init__(self, place: Place, aboard: Path, executive: Child, *others: Child) -> None:
        """Take charge of the processes."""
        self.place = place
        self.aboard = aboard
        self._executive = executive
        self._all = (*others, executive)

    @property
    def logs(self) -> tuple[Path, ...]:
        """Where the processes log."""
        return tuple(child.log for child in self._all)

    def check(self) -> None:
        """Do nothing while all run.

        Raises:
            ChildError: a process ended.
        """
        for child in self._all:
            child.check()

    async def guard(self) -> None:
        """Watch for ever.

        Raises:
            ChildError: a process ended.
        """
        while True:
            self.check()
            await asyncio.sleep(LOOK_S)

    async def uri(self) -> str:
        """Wait until the executive listens and return where.

        Raises:
            ChildError: a process ended.
        """
        while (found := self._executive.said(LISTENS)) is None:
            self.check()
            await asyncio.sleep(LOOK_S / 5)
        return found[1]


@contextmanager
def deployed(
    place: Place, folder: Path, asset: str, world: str, seed: int, video_to: str | None = None
) -> Iterator[Deployment]:
    """Yield a rover that starts, in a world; in the end the executive ends before the rover.

    Args:
        place: where its processes are to meet.
        folder: gets their logs, and what the executive keeps.
        asset: name of the asset, or its YAML file.
        world: name of the world, or its YAML file.
        seed: of all sensor noise.
        video_to: HOST:PORT of the ground's end of the video stream; None as the asset has it.
    """
    aboard = folder / "aboard"
    environment = {"ROS_DOMAIN_ID": str(place.domain)}
    settings = load_settings(asset)
    with ExitStack() as running:

        def start(name: str, module: str, *arguments: str) -> Child:
            child = Child(name, module, ("--asset", asset, *arguments), folder, environment)
            running.callback(child.end)
            return child

        stream = None if settings.video is None else f"{HOST}:{_free_udp_port()}"
        cable: tuple[str, ...] = ()
        if settings.locomotion is Way.WHOLE_MOTION:
            bus = running.enter_context(TemporaryDirectory(prefix="rover-usb-"))
            cable = ("--usb-socket", f"{bus}/brick")
        simulation = start(
            "simulation",
            "sim.process",
            *("--world", world, "--seed", str(seed)),
            *(("--video-to", stream) if stream else ()),
            *cable,
        )
        between = (start("nxt", "sim.brick.nxt", *cable),) if cable else ()
        executive = start(
            "executive",
            "adapters.onboard.process",
            *("--port", str(place.port), "--data", str(aboard)),
            *(() if cable else ("--relay",)),
            *(("--video-from", stream) if stream else ()),
            *(("--video-to", video_to) if stream and video_to else ()),
        )
        yield Deployment(place, aboard, executive, simulation, *between)


def _free_udp_port() -> int:
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, ANY_PORT))
        port: int = probe.getsockname()[1]
        return port
