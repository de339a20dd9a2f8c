"""What a live run stands on: a rover as processes, the relay beside it, and who looks on."""

import asyncio
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cattrs
import yaml

from executive.settings import config_folder
from sim.processes.contacts import Eclipse
from sim.processes.deployment import Deployment, deployed
from sim.processes.place import ANY_PORT, HOST, free_place
from sim.processes.recorder import Recorder, recorder
from sim.processes.relay import Orbiter, relayed
from sim.scenario.how import How
from sim.scenario.live_cargo import loading
from sim.scenario.model import Cargo, Scenario

START_S: Final = 40.0
"""The longest that it may take until a rover is ready."""


@dataclass(frozen=True, slots=True)
class Scene:
    """Where scenarios are played.

    Attributes:
        orbiter: the relay beside it; None where there is none.
        ground: the ground's end of the video stream.
        load: gives the rover a cargo, in kg.
    """

    rover: Deployment
    orbiter: Orbiter | None
    heard: Recorder
    ground: socket.socket
    load: Callable[[float], None]

    def check(self) -> None:
        """Do nothing while all processes run; else raise ChildError."""
        (self.orbiter or self.rover).check()

    async def uri(self, how: How) -> str:
        """Wait until the MRS is served by a link, and return where."""
        if how is not How.RELAY:
            return await self.rover.uri()
        assert self.orbiter is not None
        return await self.orbiter.uri(self.rover.settings.asset)


@contextmanager
def scene_of(
    scenario: Scenario, folder: Path, relay: bool, eclipses: Sequence[Eclipse] = ()
) -> Iterator[Scene]:
    """Yield what it takes to play a scenario, or others with its rover and world.

    Args:
        scenario: its asset, world and seed are those of the rover.
        folder: empty; logs, ledger and files go there.
        relay: whether the relay runs beside the rover.
        eclipses: times without contact, in seconds after the start of the relay.

    Raises:
        PlaceError: no ROS domain is free.
        TimeoutError: simulation or executive did not get ready in time.
    """
    asset, world = _write(scenario, folder)
    name = scenario.settings.asset
    parameters = config_folder() / f"{name}.ros.yaml"
    with ExitStack() as running:
        ground = running.enter_context(socket.socket(type=socket.SOCK_DGRAM))
        place = running.enter_context(free_place())
        rover = running.enter_context(
            deployed(place, folder, asset, world, scenario.seed, _bound(ground))
        )
        if relay and eclipses:  # what is planned must not come before all are there
            asyncio.run(asyncio.wait_for(rover.uri(), START_S))
        orbiter = (
            running.enter_context(relayed(folder, rover, eclipses=eclipses)) if relay else None
        )
        heard = running.enter_context(recorder(name, place.domain, parameters))
        laden = any(isinstance(entry, Cargo) for entry in scenario.timeline)
        load = running.enter_context(loading(name, place.domain, parameters)) if laden else _nothing
        yield Scene(rover, orbiter, heard, ground, load)


def _bound(ground: socket.socket) -> str:
    """Give the ground's end of the video stream a port of its own, and return its address."""
    ground.bind((HOST, ANY_PORT))
    return "{}:{}".format(*ground.getsockname())


def _write(scenario: Scenario, folder: Path) -> tuple[str, str]:
    """Write asset and world of a scenario as files, and return where."""
    paths = []
    for name, value in (("asset", scenario.settings), ("world", scenario.world)):
        path = folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(cattrs.unstructure(value)), encoding="utf-8")
        paths.append(str(path))
    return paths[0], paths[1]


def _nothing(_: float) -> None:
    """Load nothing, where a scenario never does."""
