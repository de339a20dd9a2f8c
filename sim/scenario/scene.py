"""What it takes to play scenarios in real time: rovers and the relay as processes, who listens."""

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
    ProcessGroup,
    RoverAddress,
    deployed,
    free_place,
)
from sim.processes import Outage as Dark
from sim.rover.faults import LinkLost, SimulatedFault
from sim.scenario.model import Cargo, Clear, Eclipse, Inject, Repeat, RunMode, Scenario, Send

if TYPE_CHECKING:
    from sim.processes.recorder import RoverRecorder
    from sim.processes.relay import Orbiter
    from sim.ros.faults import FaultClient

START_S: Final = 40.0
"""The longest that it may take until a rover is ready."""
LEAD_S: Final = 5.0
LEAD_RATIO: Final = 1.5
"""From the start of the relay to that of a scenario whose eclipses have to be planned: some
seconds, and more where the rover took long to start, for so will the relay."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """Rovers that run, each for a scenario.

    Attributes:
        orbiter: the relay beside them; None where there is none.
        start_utc_s: when scenarios by the relay must start, whose eclipses are planned; else None.
    """

    rovers: tuple[Deployment, ...]
    orbiter: "Orbiter | None" = None
    start_utc_s: float | None = None

    @property
    def processes(self) -> ProcessGroup:
        """All processes, to be watched."""
        return self.orbiter or ProcessGroup(*(c for each in self.rovers for c in each.children))

    async def uri(self, rover: Deployment, mode: RunMode) -> str:
        """Wait until the MRS of a rover is served by a link, and return where."""
        if mode is not RunMode.RELAY:
            return await rover.uri()
        assert self.orbiter is not None
        return await self.orbiter.uri(rover.settings.asset)


@dataclass(frozen=True, slots=True)
class Scene:
    """Where scenarios of one rover are played.

    Attributes:
        ground: the ground's end of the video stream; None where it goes where the asset says.
        load: gives the rover a cargo, in kg; None where the scenario never does.
        faults: has faults of the rover begin and end; None where there are none in the scenario.
    """

    fleet: Fleet
    rover: Deployment
    heard: "RoverRecorder"
    ground: socket.socket | None
    load: Callable[[float], None] | None
    faults: "FaultClient | None"

    @property
    def orbiter(self) -> "Orbiter | None":
        """The relay beside it."""
        return self.fleet.orbiter

    def check(self) -> None:
        """Do nothing while all processes run; else raise ChildError."""
        (self.orbiter or self.rover).check()

    async def uri(self, mode: RunMode) -> str:
        """Wait until the MRS is served by a link, and return where."""
        return await self.fleet.uri(self.rover, mode)


def links_of(scenario: Scenario, mode: RunMode) -> tuple[RunMode, ...]:
    """Return the links that a scenario needs, that by which it is played first."""
    named = {
        each.link for each in scenario.timeline if isinstance(each, Send | Repeat) and each.link
    }
    others = (each for each in (RunMode.DIRECT, RunMode.RELAY) if each is not mode)
    return (mode, *(each for each in others if each.link in named))


@contextmanager
def fleet_of(
    scenarios: Sequence[Scenario],
    folders: Sequence[Path],
    place: RoverAddress,
    relay: Path | None,
    speed: float = 1.0,
    video_to: str | None = None,
    restart: bool = False,
) -> Iterator[Fleet]:
    """Yield rovers in one ROS domain that start, one for each scenario.

    Args:
        scenarios: of different assets; eclipses are those of the first.
        folders: for each, with its logs and what its executive keeps.
        place: of the first rover, beside which the others are.
        relay: the folder of the orbiter; None without the relay.
        speed: simulated seconds per second.
        video_to: HOST:PORT of the ground's end of the video stream; None as the asset has it.
        restart: whether a `rover-relay` that ends by itself is started again.

    Raises:
        TimeoutError: an executive did not start in time, where eclipses are planned.
    """
    with ExitStack() as running:
        rovers = tuple(
            running.enter_context(
                deployed(
                    place.beside(number),
                    folder,
                    *_write(scenario, folder),
                    scenario.seed,
                    video_to,
                    speed,
                )
            )
            for number, (scenario, folder) in enumerate(zip(scenarios, folders, strict=True))
        )
        if relay is None:
            yield Fleet(rovers)
            return
        from sim.processes.relay import relayed

        lead_s = _lead_s(rovers) if _eclipses(scenarios[0], 0) else 0
        dark = _eclipses(scenarios[0], lead_s)
        orbiter = running.enter_context(relayed(relay, *rovers, eclipses=dark, restart=restart))
        yield Fleet(rovers, orbiter, orbiter.start_utc_s + lead_s if dark else None)


@contextmanager
def scene_in(
    fleet: Fleet, rover: Deployment, scenario: Scenario, ground: socket.socket | None = None
) -> Iterator[Scene]:
    """Yield what it takes to play a scenario with a rover; begins a thread that listens.

    Raises:
        TimeoutError: the simulation did not get ready in time.
    """
    from sim.processes.recorder import recorder

    name, domain = rover.settings.asset, rover.place.domain
    parameters = config_folder() / f"{name}.ros.yaml"
    with ExitStack() as running:
        heard = running.enter_context(recorder(name, domain, parameters))
        load: Callable[[float], None] | None = None
        if any(isinstance(entry, Cargo) for entry in scenario.timeline):
            from sim.ros.cargo import loading

            load = running.enter_context(loading(name, domain, parameters))
        faults: FaultClient | None = None
        if any(kind is not LinkLost for kind in _fault_kinds(scenario)):
            from sim.ros.faults import fault_client

            faults = running.enter_context(fault_client(name, domain, parameters, START_S))
        yield Scene(fleet, rover, heard, ground, load, faults)


@contextmanager
def scene_of(scenario: Scenario, folder: Path, relay: bool, speed: float = 1.0) -> Iterator[Scene]:
    """Yield what it takes to play a scenario, or others with its rover and world.

    Raises:
        PlaceError: no ROS domain is free.
        TimeoutError: simulation or executive did not get ready in time.
    """
    with ExitStack() as running:
        ground = running.enter_context(socket.socket(type=socket.SOCK_DGRAM))
        ground.bind((HOST, ANY_PORT))
        video_to = "{}:{}".format(*ground.getsockname())
        place = running.enter_context(free_place())
        fleet = running.enter_context(
            fleet_of([scenario], [folder], place, folder if relay else None, speed, video_to)
        )
        yield running.enter_context(scene_in(fleet, fleet.rovers[0], scenario, ground))


def _fault_kinds(scenario: Scenario) -> Iterator[type[SimulatedFault]]:
    """Yield the kind of each fault that begins or ends."""
    for entry in scenario.timeline:
        match entry:
            case Inject(inject=fault):
                yield type(fault)
            case Clear(clear=kind):
                yield kind
            case _:
                pass


def _lead_s(rovers: Sequence[Deployment]) -> int:
    """Wait until rovers that were started are there; return how long all the rest may take."""
    began_s = time.monotonic()

    async def wait() -> None:
        async with asyncio.timeout(START_S):
            for rover in rovers:
                await rover.uri()

    asyncio.run(wait())
    return ceil(LEAD_S + LEAD_RATIO * (time.monotonic() - began_s))


def _eclipses(scenario: Scenario, lead_s: int) -> Sequence[Dark]:
    """Return the eclipses that are planned, counted from so long before the scenario's start."""
    return [
        Dark(lead_s + round(entry.at_s), lead_s + round(entry.at_s + entry.eclipse_s))
        for entry in scenario.timeline
        if isinstance(entry, Eclipse) and entry.at_s is not None
    ]


def _write(scenario: Scenario, folder: Path) -> tuple[str, str]:
    """Write asset and world of a scenario as files, and return where."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, value in (("asset", scenario.settings), ("world", scenario.world)):
        path = folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(unstructure(value)), encoding="utf-8")
        paths.append(str(path))
    return paths[0], paths[1]
