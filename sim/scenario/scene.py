"""Starts the processes of a live run: rovers and relay, with recorders and fault injectors."""

import asyncio
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Final

import yaml

from executive.settings import config_folder, unstructure
from sim.processes import (
    ANY_PORT,
    HOST,
    Deployment,
    Orbiter,
    ProcessGroup,
    RoverAddress,
    allocate_address,
    run_deployment,
    run_relay,
)
from sim.processes import Outage as Dark
from sim.rover.faults import LinkLost, SimulatedFault
from sim.scenario.model import Cargo, Clear, Inject, Outage, Repeat, RunMode, Scenario, Send

if TYPE_CHECKING:
    from sim.processes.recorder import RoverRecorder
    from sim.ros.faults import FaultClient

START_S: Final = 40.0
"""Maximum time until a rover is ready."""
LEAD_S: Final = 5.0
LEAD_RATIO: Final = 1.5
"""Lead of the relay's start over a scenario with planned outages: `LEAD_S` plus `LEAD_RATIO` times
the rover's start-up time, because a slow machine starts the relay slowly, too."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """Running rovers, one for each scenario.

    Attributes:
        orbiter: orbiter of the relay; None without a relay.
        start_utc_s: start time of scenarios with planned outages over the relay; else None.
    """

    rovers: tuple[Deployment, ...]
    orbiter: "Orbiter | None" = None
    start_utc_s: float | None = None

    @property
    def processes(self) -> ProcessGroup:
        """All processes, for supervision."""
        return self.orbiter or ProcessGroup(*(c for each in self.rovers for c in each.children))

    async def uri(self, rover: Deployment, mode: RunMode) -> str:
        """Wait until the MRS of a rover is served on a link, and return its URI."""
        if mode is not RunMode.RELAY:
            return await rover.ground_uri()
        assert self.orbiter is not None
        return await self.orbiter.uri(rover.settings.asset)


@dataclass(frozen=True, slots=True)
class LiveScene:
    """Environment of the live runs of one rover.

    Attributes:
        ground: ground socket of the video stream; None for the destination in the asset's settings.
        load: sets the mass of the rover's cargo, in kg; None if the scenario has no cargo.
        faults: injects and clears faults of the rover; None if the scenario has none.
    """

    fleet: Fleet
    rover: Deployment
    recorder: "RoverRecorder"
    ground: socket.socket | None
    load: Callable[[float], None] | None
    faults: "FaultClient | None"

    @property
    def orbiter(self) -> "Orbiter | None":
        """Orbiter of the relay, or None."""
        return self.fleet.orbiter

    def check(self) -> None:
        """Raise ChildError unless all processes run."""
        (self.orbiter or self.rover).check()

    async def uri(self, mode: RunMode) -> str:
        """Wait until the MRS is served on a link, and return its URI."""
        return await self.fleet.uri(self.rover, mode)


def links_of(scenario: Scenario, mode: RunMode) -> tuple[RunMode, ...]:
    """Return the links that a scenario needs, with the link of the run first."""
    named = {
        each.link for each in scenario.timeline if isinstance(each, Send | Repeat) and each.link
    }
    others = (each for each in (RunMode.DIRECT, RunMode.RELAY) if each is not mode)
    return (mode, *(each for each in others if each.link in named))


@contextmanager
def fleet_of(
    scenarios: Sequence[Scenario],
    folders: Sequence[Path],
    address: RoverAddress,
    relay: Path | None,
    speed: float | None = 1.0,
    video_to: str | None = None,
    restart: bool = False,
    round_trip_s: float = 0.0,
) -> Iterator[Fleet]:
    """Start rovers in one ROS domain, one for each scenario, and yield them.

    Args:
        scenarios: scenarios of different assets; outages are those of the first.
        folders: one per scenario, for logs and the data of the executive.
        address: that of the first rover; the others use the following ones.
        relay: folder of the orbiter; None without a relay.
        speed: simulated seconds per second; None for real time that waits for late ticks.
        video_to: HOST:PORT on the ground for the video stream; None for the asset's setting.
        restart: whether a `rover-relay` that ends by itself is restarted.
        round_trip_s: light time of a simulated link before each rover; 0 for none.

    Raises:
        TimeoutError: an executive did not start in time for planned outages.
    """
    with ExitStack() as running:
        rovers = tuple(
            running.enter_context(
                run_deployment(
                    address.next_address(number),
                    folder,
                    *_write(scenario, folder),
                    scenario.seed,
                    video_to,
                    speed,
                    round_trip_s,
                )
            )
            for number, (scenario, folder) in enumerate(zip(scenarios, folders, strict=True))
        )
        if relay is None:
            yield Fleet(rovers)
            return
        lead_s = _lead_s(rovers) if _outages(scenarios[0], 0) else 0
        outages = _outages(scenarios[0], lead_s)
        orbiter = running.enter_context(run_relay(relay, *rovers, outages=outages, restart=restart))
        yield Fleet(rovers, orbiter, orbiter.start_utc_s + lead_s if outages else None)


@contextmanager
def scene_in(
    fleet: Fleet, rover: Deployment, scenario: Scenario, ground: socket.socket | None = None
) -> Iterator[LiveScene]:
    """Yield the environment of a scenario's run; starts a thread that records topics.

    Raises:
        TimeoutError: the simulation did not get ready in time.
    """
    from sim.processes.recorder import recorder

    name, domain = rover.settings.asset, rover.address.domain
    parameters = config_folder() / f"{name}.ros.yaml"
    with ExitStack() as running:
        received = running.enter_context(recorder(name, domain, parameters))
        load: Callable[[float], None] | None = None
        if any(isinstance(entry, Cargo) for entry in scenario.timeline):
            from sim.ros.cargo import cargo_publisher

            load = running.enter_context(cargo_publisher(name, domain, parameters))
        faults: FaultClient | None = None
        if any(kind is not LinkLost for kind in _fault_kinds(scenario)):
            from sim.ros.faults import fault_client

            faults = running.enter_context(fault_client(name, domain, parameters, START_S))
        yield LiveScene(fleet, rover, received, ground, load, faults)


@contextmanager
def live_scene(
    scenario: Scenario, folder: Path, relay: bool, speed: float = 1.0
) -> Iterator[LiveScene]:
    """Start a rover and yield its environment, for scenarios with this rover and world.

    Raises:
        AddressError: no ROS domain is free.
        TimeoutError: simulation or executive did not get ready in time.
    """
    with ExitStack() as running:
        ground = running.enter_context(socket.socket(type=socket.SOCK_DGRAM))
        ground.bind((HOST, ANY_PORT))
        video_to = "{}:{}".format(*ground.getsockname())
        address = running.enter_context(allocate_address())
        fleet = running.enter_context(
            fleet_of([scenario], [folder], address, folder if relay else None, speed, video_to)
        )
        yield running.enter_context(scene_in(fleet, fleet.rovers[0], scenario, ground))


def _fault_kinds(scenario: Scenario) -> Iterator[type[SimulatedFault]]:
    """Yield the kind of each injected or cleared fault."""
    for entry in scenario.timeline:
        match entry:
            case Inject(inject=fault):
                yield type(fault)
            case Clear(clear=kind):
                yield kind
            case _:
                pass


def _lead_s(rovers: Sequence[Deployment]) -> int:
    """Wait until the MRS of all rovers is served; return the lead for the rest in seconds."""
    began_s = time.monotonic()

    async def wait() -> None:
        async with asyncio.timeout(START_S):
            for rover in rovers:
                await rover.uri()

    asyncio.run(wait())
    return ceil(LEAD_S + LEAD_RATIO * (time.monotonic() - began_s))


def _outages(scenario: Scenario, lead_s: int) -> Sequence[Dark]:
    """Return the planned outages, in seconds from `lead_s` before the scenario's start."""
    return [
        Dark(lead_s + round(entry.at_s), lead_s + round(entry.at_s + entry.outage_s))
        for entry in scenario.timeline
        if isinstance(entry, Outage) and entry.at_s is not None
    ]


def _write(scenario: Scenario, folder: Path) -> tuple[str, str]:
    """Write asset and world of a scenario as files, and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, value in (("asset", scenario.settings), ("world", scenario.world)):
        path = folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(unstructure(value)), encoding="utf-8")
        paths.append(str(path))
    return paths[0], paths[1]
