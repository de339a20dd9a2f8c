"""Plays a scenario in real time: simulation and executive as processes, commands over the socket.

What is seen goes into the same record as in lock step: notifications and telemetry by
subscription, the mode by asking, the true pose from the simulation's topic.
"""

import asyncio
import re
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

import cattrs
import yaml

from adapters.mrs.client import MrsClient
from adapters.mrs.types import Validity
from executive.settings import config_folder
from sim.demo.children import Child
from sim.demo.place import free_place
from sim.demo.recorder import Recorder, recorder
from sim.scenario.live_session import LiveSession
from sim.scenario.model import Scenario
from sim.scenario.record import Record, TruePose

START_S: Final = 40.0
GLANCE_S: Final = 0.02
_LISTENS: Final = re.compile(r"listens at (maltcp://\S+)")


def run_live(scenario: Scenario, folder: Path) -> Record:
    """Play a scenario that can be played live, and return what was seen.

    Must be called on the main thread, which no other thread may run beside yet.

    Args:
        scenario: what to do, where and when.
        folder: empty; logs, ledger and pictures go there.

    Raises:
        ChildError: a process ended by itself.
        ConnectionError: the rover could not be reached any more.
        PlaceError: no ROS domain is free.
        TimeoutError: the rover did not get ready in time.
    """
    parameters = config_folder() / f"{scenario.settings.asset}.ros.yaml"
    with (
        free_place() as place,
        _processes(scenario, folder, place.domain) as children,
        recorder(scenario.settings.asset, place.domain, parameters) as heard,
    ):
        return asyncio.run(_play(scenario, folder / "aboard", children, heard))


@contextmanager
def _processes(scenario: Scenario, folder: Path, domain: int) -> Iterator[tuple[Child, Child]]:
    """Yield simulation and executive; in the end the executive ends first."""
    asset, world = folder / "asset.yaml", folder / "world.yaml"
    for path, value in ((asset, scenario.settings), (world, scenario.world)):
        path.write_text(yaml.safe_dump(cattrs.unstructure(value)), encoding="utf-8")
    aboard = str(folder / "aboard")
    environment = {"ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(folder / "ros")}
    with ExitStack() as running:

        def start(name: str, module: str, *arguments: str) -> Child:
            child = Child(name, module, ("--asset", str(asset), *arguments), folder, environment)
            running.callback(child.end)
            return child

        yield (
            start(
                *("simulation", "sim.process", "--world", str(world)),
                *("--seed", str(scenario.seed)),
            ),
            start("executive", "adapters.onboard.process", "--port", "0", "--data", aboard),
        )


async def _play(
    scenario: Scenario, aboard: Path, children: tuple[Child, Child], heard: Recorder
) -> Record:
    try:
        async with asyncio.timeout(START_S):
            uri = await _address(children)
            client = await MrsClient.connect(uri)
            await _ready(client, heard)
    except TimeoutError as error:
        raise TimeoutError(f"it was not ready after {START_S:.0f} s") from error
    async with client:
        record = Record(time.time(), aboard / "pictures")
        await LiveSession(scenario, client, record).play()
    for child in children:
        child.check()
    record.poses = [TruePose(seen.utc_s - record.start_utc_s, seen.pose) for seen in heard.true]
    return record


async def _address(children: tuple[Child, Child]) -> str:
    """Wait until the executive listens and return where."""
    while (found := children[1].said(_LISTENS)) is None:
        for child in children:
            child.check()
        await asyncio.sleep(GLANCE_S)
    return found[1]


async def _ready(client: MrsClient, heard: Recorder) -> None:
    """Wait until every parameter is known aboard, and the true pose here."""
    while not heard.true or any(
        value.validity is not Validity.VALID for value in await client.get_value()
    ):
        await asyncio.sleep(GLANCE_S)
