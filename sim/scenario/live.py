"""Plays a scenario in real time: simulation and executive as processes, commands over the socket.

What is seen goes into the same record as in lock step: notifications and telemetry by
subscription, the mode by asking, the true pose from the simulation's topic.
"""

import asyncio
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Final

import yaml

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import Validity
from executive.commands import SetCameraAngles
from executive.settings import LocomotionKind, config_folder, unstructure
from executive.values.parameters import Parameter
from sim.processes import ANY_PORT, HOST, Deployment, deployed, free_place
from sim.processes import Outage as Dark
from sim.processes.recorder import RoverRecorder, recorder
from sim.processes.relay import Orbiter, relayed
from sim.ros.cargo import loading
from sim.ros.faults import FaultClient, fault_client
from sim.rover.faults import LinkLost, SimulatedFault
from sim.scenario.live_session import GLANCE_S, LiveSession, watched
from sim.scenario.model import Cargo, Clear, Eclipse, Inject, RunMode, Scenario
from sim.scenario.record import Record, TruePose
from sim.scenario.truth import look_up_requests, undelayed_s

START_S: Final = 40.0
"""The longest that it may take until a rover is ready."""
LEAD_S: Final = 5.0
LEAD_RATIO: Final = 1.5
"""From the start of the relay to that of a scenario whose eclipses have to be planned: some
seconds, and more where the rover took long to start, for so will the relay."""


@dataclass(frozen=True, slots=True)
class LiveSetup:
    """Where scenarios are played.

    Attributes:
        orbiter: the relay beside it; None where there is none.
        start_utc_s: when a scenario by the relay must start, whose eclipses are planned; else None.
        ground: the ground's end of the video stream.
        load: gives the rover a cargo, in kg; None where the scenario never does.
        faults: has faults of the rover begin and end; None where there are none in the scenario.
    """

    rover: Deployment
    orbiter: Orbiter | None
    start_utc_s: float | None
    heard: RoverRecorder
    ground: socket.socket
    load: Callable[[float], None] | None
    faults: FaultClient | None

    def check(self) -> None:
        """Do nothing while all processes run; else raise ChildError."""
        (self.orbiter or self.rover).check()

    async def uri(self, mode: RunMode) -> str:
        """Wait until the MRS is served by a link, and return where."""
        if mode is not RunMode.RELAY:
            return await self.rover.uri()
        assert self.orbiter is not None
        return await self.orbiter.uri(self.rover.settings.asset)


@contextmanager
def scene_of(
    scenario: Scenario, folder: Path, relay: bool, speed: float = 1.0
) -> Iterator[LiveSetup]:
    """Yield what it takes to play a scenario, or others with its rover and world.

    Raises:
        PlaceError: no ROS domain is free.
        TimeoutError: simulation or executive did not get ready in time.
    """
    asset, world = _write(scenario, folder)
    name = scenario.settings.asset
    parameters = config_folder() / f"{name}.ros.yaml"
    with ExitStack() as running:
        ground = running.enter_context(socket.socket(type=socket.SOCK_DGRAM))
        ground.bind((HOST, ANY_PORT))
        video_to = "{}:{}".format(*ground.getsockname())
        place = running.enter_context(free_place())
        rover = running.enter_context(
            deployed(place, folder, asset, world, scenario.seed, video_to, speed)
        )
        orbiter, start_utc_s = None, None
        if relay:
            lead_s = _lead_s(rover) if _eclipses(scenario, 0) else 0
            dark = _eclipses(scenario, lead_s)
            orbiter = running.enter_context(relayed(folder, rover, eclipses=dark))
            start_utc_s = orbiter.start_utc_s + lead_s if dark else None
        heard = running.enter_context(recorder(name, place.domain, parameters))
        load: Callable[[float], None] | None = None
        if any(isinstance(entry, Cargo) for entry in scenario.timeline):
            load = running.enter_context(loading(name, place.domain, parameters))
        faults: FaultClient | None = None
        if any(kind is not LinkLost for kind in _fault_kinds(scenario)):
            faults = running.enter_context(fault_client(name, place.domain, parameters, START_S))
        yield LiveSetup(rover, orbiter, start_utc_s, heard, ground, load, faults)


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


def _lead_s(rover: Deployment) -> int:
    """Wait until a rover that was started is there; return how long all the rest may take."""
    began_s = time.monotonic()
    asyncio.run(asyncio.wait_for(rover.uri(), START_S))
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
    paths = []
    for name, value in (("asset", scenario.settings), ("world", scenario.world)):
        path = folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(unstructure(value)), encoding="utf-8")
        paths.append(str(path))
    return paths[0], paths[1]


def run_live(scenario: Scenario, folder: Path, mode: RunMode, speed: float = 1.0) -> Record:
    """Play a scenario that can be played live, and return what was seen.

    Must be called on the main thread, which no other thread may run beside yet.

    Raises:
        ChildError: a process ended.
        ConnectionError: the rover could not be reached any more.
        PlaceError: no ROS domain is free.
        TimeoutError: the rover did not get ready in time.
    """
    with scene_of(scenario, folder, mode is RunMode.RELAY, speed) as scene:

        async def play() -> Record:
            await ready(scene, RunMode.DIRECT)
            return await play_in(scene, scenario, mode)

        return asyncio.run(play())


async def play_in(
    scene: LiveSetup, scenario: Scenario, mode: RunMode, brief: bool = False
) -> Record:
    """Play a scenario in a scene of its rover and world.

    Args:
        scene: where.
        scenario: what to do, and when.
        mode: by which link. By the relay, an executive that runs must be ready before, which
            begins with a stop where a brick moves the rover.
        brief: whether it ends as soon as all is played, and all that was admitted has ended.

    Raises:
        ChildError: a process ended.
        ConnectionError: the rover could not be reached any more.
        TimeoutError: the rover did not get ready in time.
    """
    uri = await ready(scene, mode)
    start_utc_s = time.time()
    if mode is RunMode.RELAY and scene.start_utc_s is not None:
        start_utc_s = scene.start_utc_s
        late_s = time.time() - start_utc_s
        if late_s > 0:
            raise TimeoutError(f"it was ready {late_s:.0f} s too late for the planned eclipse")
        await asyncio.sleep(-late_s)
    heard, speed = scene.heard, scene.rover.speed
    first = len(heard.true)
    files = scene.rover.aboard / "files"
    record = Record(start_utc_s, files, float if speed == 1.0 else heard.simulated_s)

    def look() -> None:
        new = heard.true[first + len(record.poses) :]
        record.poses += [TruePose(record.since_start_s(seen.utc_s), seen.pose) for seen in new]

    async with watched(scene.ground, record):
        await LiveSession(
            scenario, uri, mode, scene.load, scene.faults, look, record, brief, speed
        ).play()
    scene.check()
    true = heard.true[first:]
    heard_s = [record.since_start_s(seen.utc_s) for seen in true]
    times_s = undelayed_s(heard_s, [seen.stamp_s for seen in true])
    record.poses = [TruePose(time_s, seen.pose) for time_s, seen in zip(times_s, true, strict=True)]
    look_up_requests(record, scene.rover.aboard / "ledger.sqlite")
    return record


async def ready(scene: LiveSetup, mode: RunMode) -> str:
    """Wait until a link tells where the rover is, and the simulation too; return its address.

    An executive begins with a stop, which a brick may hear late: where the relay reaches it, too,
    the direct link is ready when the brick has answered another command after that.

    Raises:
        ChildError: a process ended.
        ConnectionError: the rover could not be reached any more.
        TimeoutError: it took too long.
    """
    try:
        async with asyncio.timeout(START_S):
            uri = await scene.uri(mode)
            await _known(uri, scene, mode)
            return uri
    except TimeoutError as error:
        raise TimeoutError(f"it was not ready after {START_S:.0f} s") from error


async def _known(uri: str, scene: LiveSetup, mode: RunMode) -> None:
    """Wait until every parameter is known aboard, or to the orbiter, and the true pose here."""
    needed = () if mode is RunMode.DIRECT else (Parameter.POS_X.value, Parameter.CAM_PAN.value)
    async with await MrsClient.connect(uri) as client:
        while not scene.heard.true or any(
            value.validity is not Validity.VALID for value in await client.get_value(*needed)
        ):
            await asyncio.sleep(GLANCE_S)
        brick = scene.rover.settings.locomotion is LocomotionKind.WHOLE_MOTION
        if brick and mode is RunMode.DIRECT and scene.orbiter is not None:
            await client.run(client.command(SetCameraAngles(0.0, 0.0)))
