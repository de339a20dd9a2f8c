"""Plays a scenario in real time: simulation and executive as processes, commands over the socket.

What is seen goes into the same record as in lock step: notifications and telemetry by
subscription, the mode by asking, the true pose from the simulation's topic.
"""

import asyncio
import socket
import time
from pathlib import Path
from typing import Final

import cattrs
import yaml

from adapters.mrs.client import MrsClient
from adapters.mrs.types import Validity
from executive.settings import config_folder
from sim.processes.deployment import Deployment, deployed
from sim.processes.place import ANY_PORT, HOST, free_place
from sim.processes.recorder import Recorder, recorder
from sim.scenario.live_session import LiveSession
from sim.scenario.live_video import watched
from sim.scenario.model import Scenario
from sim.scenario.record import Record, TruePose

START_S: Final = 40.0
GLANCE_S: Final = 0.02


def run_live(scenario: Scenario, folder: Path) -> Record:
    """Play a scenario that can be played live, and return what was seen.

    Must be called on the main thread, which no other thread may run beside yet.

    Args:
        scenario: what to do, where and when.
        folder: empty; logs, ledger and files go there.

    Raises:
        ChildError: a process ended by itself.
        ConnectionError: the rover could not be reached any more.
        PlaceError: no ROS domain is free.
        TimeoutError: the rover did not get ready in time.
    """
    asset, world = _write(scenario, folder)
    parameters = config_folder() / f"{scenario.settings.asset}.ros.yaml"
    with (
        socket.socket(type=socket.SOCK_DGRAM) as ground,
        free_place() as place,
        deployed(place, folder, asset, world, scenario.seed, _bound(ground)) as rover,
        recorder(scenario.settings.asset, place.domain, parameters) as heard,
    ):
        return asyncio.run(_play(scenario, rover, heard, ground))


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


async def _play(
    scenario: Scenario, rover: Deployment, heard: Recorder, ground: socket.socket
) -> Record:
    try:
        async with asyncio.timeout(START_S):
            client = await MrsClient.connect(await rover.uri())
            await _ready(client, heard)
    except TimeoutError as error:
        raise TimeoutError(f"it was not ready after {START_S:.0f} s") from error
    async with client:
        record = Record(time.time(), rover.aboard / "files")
        async with watched(ground, record):
            await LiveSession(scenario, client, record).play()
    rover.check()
    record.poses = [TruePose(seen.utc_s - record.start_utc_s, seen.pose) for seen in heard.true]
    return record


async def _ready(client: MrsClient, heard: Recorder) -> None:
    """Wait until every parameter is known aboard, and the true pose here."""
    while not heard.true or any(
        value.validity is not Validity.VALID for value in await client.get_value()
    ):
        await asyncio.sleep(GLANCE_S)
