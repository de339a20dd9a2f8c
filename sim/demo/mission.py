"""The demonstration once its processes are starting: waits until they are ready, and plays."""

import asyncio
import logging
from contextlib import AbstractContextManager
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Final

from rich.console import Console

from adapters.mrs.client import MrsClient
from executive.settings import config_folder
from sim.demo.display import display
from sim.demo.script import Script
from sim.demo.session import Session, look, until_first
from sim.processes.deployment import Deployment
from sim.processes.guarding import LOOK_S
from sim.processes.place import PlaceError
from sim.processes.recorder import Recorder, recorder
from sim.processes.uptime import since_start_s, told

LOG: Final = "mission-control.log"
START_S: Final = 60.0
SETTLE_S: Final = 0.3
DISCOVERY_S: Final = 3.0
"""What it may take to see who else is in a ROS domain."""


@dataclass(frozen=True, slots=True)
class Played:
    """A session that was played, and what was heard beside it."""

    script: Script
    session: Session
    heard: Recorder


def await_rover(rover: Deployment, asset: str, console: Console) -> None:
    """Wait until the rover can be commanded, and say so.

    Raises:
        ChildError: a process ended.
        PlaceError: another rover is in the same ROS domain.
        TimeoutError: it did not get ready in time.
    """
    with _recorder(rover, asset) as heard:
        asyncio.run(_get_ready(rover, heard, console))


def play(rover: Deployment, script: Script, folder: Path, console: Console) -> Played:
    """Play a session; mission control's own log goes to the folder.

    Raises:
        ChildError: a process ended.
        ConnectionError: the rover could not be reached any more.
        PlaceError: another rover is in the same ROS domain.
        TimeoutError: the rover did not get ready in time, or a command did not end.
    """
    logging.basicConfig(
        filename=folder / LOG,
        level="INFO",
        format="%(asctime)s %(levelname)-7s %(message)s",
        force=True,
    )
    with _recorder(rover, script.asset) as heard:
        return Played(script, asyncio.run(_play(rover, script, heard, console)), heard)


def _recorder(rover: Deployment, asset: str) -> AbstractContextManager[Recorder]:
    return recorder(asset, rover.place.domain, config_folder() / f"{asset}.ros.yaml")


async def _play(rover: Deployment, script: Script, heard: Recorder, console: Console) -> Session:
    uri = await _get_ready(rover, heard, console)
    async with await MrsClient.connect(uri) as client:
        with display(console) as shown:
            session = Session(client, shown)
            await until_first(session.play(script.steps), rover.guard())
        await asyncio.sleep(SETTLE_S)
    return session


async def _get_ready(rover: Deployment, heard: Recorder, console: Console) -> str:
    """Wait until the rover can be commanded, and return its address."""
    try:
        async with asyncio.timeout(START_S):
            await until_first(_located(rover, heard), rover.guard())
    except TimeoutError as error:
        logs = " and ".join(map(str, rover.logs))
        raise TimeoutError(f"it was not ready after {START_S:.0f} s; see {logs}") from error
    if rover.place.shared:
        await asyncio.sleep(DISCOVERY_S)
    if heard.rovers() > 1:
        raise PlaceError(
            f"another rover drives in ROS domain {rover.place.domain}. End that one, or set"
            " ROS_DOMAIN_ID to another number, the same in every terminal."
        )
    console.print(f"rover and executive are ready after {told(since_start_s())}", style="dim")
    return await rover.uri()


async def _located(rover: Deployment, heard: Recorder) -> None:
    """Return when the executive knows where the rover is, and the recorder hears both."""
    async with await MrsClient.connect(await rover.uri()) as client:
        while not heard.ready or isnan((await look(client)).x_m):
            await asyncio.sleep(LOOK_S / 5)
