"""`run_deployment` starts a simulated rover: `rover-sim`, its executive, MOCUP's `rover-nxt`."""

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from adapters.process import ROS_ARGS
from executive.settings import LocomotionKind, Settings, load_settings
from sim.processes.children import ChildProcess, ProcessGroup
from sim.processes.rover_address import HOST, RoverAddress, free_udp_ports

LISTENS: Final = re.compile(r"listens at (maltcp://\S+)")


class Deployment(ProcessGroup):
    """A running rover.

    Attributes:
        address: ROS domain and port of the processes.
        settings: settings of the asset.
        aboard: data folder of the executive.
        speed: simulated seconds per second; with `paced`, the maximum.
        paced: whether simulated time waits for late ticks of the executive.
    """

    def __init__(
        self,
        address: RoverAddress,
        settings: Settings,
        aboard: Path,
        speed: float | None,
        executive: ChildProcess,
        *others: ChildProcess,
    ) -> None:
        super().__init__(*others, executive)
        self.address = address
        self.settings = settings
        self.aboard = aboard
        self.speed, self.paced = speed or 1.0, speed is None
        self._executive = executive

    @property
    def simulated_time(self) -> bool:
        """Whether the processes run in simulated time."""
        return self.paced or self.speed != 1.0

    async def uri(self) -> str:
        """Wait until the executive listens and return its URI.

        Raises:
            ChildError: a process ended.
        """
        return await self.wait_for_output(self._executive, LISTENS)


@contextmanager
def run_deployment(
    address: RoverAddress,
    folder: Path,
    asset: str,
    world: str,
    seed: int,
    video_to: str | None = None,
    speed: float | None = 1.0,
) -> Iterator[Deployment]:
    """Yield a rover in a world; at the end the executive ends before the rover.

    Args:
        address: ROS domain and port of its processes.
        folder: created if missing; receives their logs, and the executive's data.
        asset: name of the asset, or its YAML file.
        world: name of the world, or its YAML file.
        seed: seed of all sensor noise.
        video_to: HOST:PORT of the ground's end of the video stream; None as in the asset.
        speed: simulated seconds per second, for all processes; None for real time that waits for
            late ticks of the executive.
    """
    folder.mkdir(parents=True, exist_ok=True)
    aboard = folder / "aboard"
    environment = {"ROS_DOMAIN_ID": str(address.domain)}
    settings = load_settings(asset)
    with ExitStack() as running:

        def start(name: str, module: str, *arguments: str) -> ChildProcess:
            child = ChildProcess(name, module, ("--asset", asset, *arguments), folder, environment)
            running.callback(child.end)
            return child

        stream = None if settings.video is None else f"{HOST}:{free_udp_ports(1)[0]}"
        cable: tuple[str, ...] = ()
        if settings.locomotion is LocomotionKind.DELEGATED:
            bus = running.enter_context(TemporaryDirectory(prefix="rover-usb-"))
            cable = ("--usb-socket", f"{bus}/brick")
        # Rovers in one domain have separate clocks.
        clock = () if speed == 1.0 else (ROS_ARGS, "-r", f"/clock:=/{settings.asset}/clock")
        simulation = start(
            "simulation",
            "sim.ros.process",
            *("--world", world, "--seed", str(seed)),
            *(("--paced",) if speed is None else ("--speed", str(speed))),
            *(("--video-to", stream) if stream else ()),
            *cable,
            *clock,
        )
        followed = (*clock, "-p", "use_sim_time:=true") if clock else ()
        brick = (*cable, "--asset", settings.asset, "--data", str(aboard))  # it accepts names only
        between = (start("nxt", "sim.brick.nxt", *brick, *followed),) if cable else ()
        executive = start(
            "executive",
            "adapters.onboard.process",
            *("--port", str(address.port), "--data", str(aboard)),
            *(() if cable else ("--relay",)),
            *(("--video-from", stream) if stream else ()),
            *(("--video-to", video_to) if stream and video_to else ()),
            *followed,
        )
        yield Deployment(address, settings, aboard, speed, executive, simulation, *between)
