"""Plays a scenario in real time: simulation and executive as processes, commands over the socket.

What is seen goes into the same record as in lock step: notifications and telemetry by
subscription, the mode by asking, the true pose from the simulation's topic.
"""

import asyncio
import time
from pathlib import Path
from typing import Final

from adapters.mrs.client import MrsClient
from adapters.mrs.types import Validity
from executive.commands import SetCameraAngles
from executive.parameters import Parameter
from executive.settings import Way
from sim.scenario.how import How
from sim.scenario.live_scene import START_S, Scene, scene_of
from sim.scenario.live_session import LiveSession
from sim.scenario.live_video import watched
from sim.scenario.model import Scenario
from sim.scenario.record import Record, TruePose

GLANCE_S: Final = 0.02


def run_live(scenario: Scenario, folder: Path, how: How) -> Record:
    """Play a scenario that can be played live, and return what was seen.

    Must be called on the main thread, which no other thread may run beside yet.

    Args:
        scenario: what to do, where and when.
        folder: empty; logs, ledger and files go there.
        how: by which link.

    Raises:
        ChildError: a process ended.
        ConnectionError: the rover could not be reached any more.
        PlaceError: no ROS domain is free.
        TimeoutError: the rover did not get ready in time.
    """
    with scene_of(scenario, folder, how is How.RELAY) as scene:
        return asyncio.run(_play(scene, scenario, how))


async def _play(scene: Scene, scenario: Scenario, how: How) -> Record:
    await ready(scene, How.DIRECT)
    return await play_in(scene, scenario, how)


async def play_in(scene: Scene, scenario: Scenario, how: How, brief: bool = False) -> Record:
    """Play a scenario in a scene of its rover and world.

    Args:
        scene: where.
        scenario: what to do, and when.
        how: by which link. By the relay, an executive that runs must be ready before: where a brick
            moves the rover, it begins with a stop.
        brief: whether it ends as soon as all is played, and all that was admitted has ended.

    Raises:
        ChildError: a process ended.
        ConnectionError: the rover could not be reached any more.
        TimeoutError: the rover did not get ready in time.
    """
    uri = await ready(scene, how)
    start_utc_s = time.time()
    if how is How.RELAY and scene.start_utc_s is not None:
        start_utc_s = scene.start_utc_s
        late_s = time.time() - start_utc_s
        if late_s > 0:
            raise TimeoutError(f"it was ready {late_s:.0f} s too late for the planned eclipse")
        await asyncio.sleep(-late_s)
    record = Record(start_utc_s, scene.rover.aboard / "files")
    async with watched(scene.ground, record):
        await LiveSession(scenario, uri, how, scene.load, record, brief).play()
    scene.check()
    record.poses = [
        TruePose(seen.utc_s - start_utc_s, seen.pose)
        for seen in scene.heard.true
        if seen.utc_s > start_utc_s
    ]
    return record


async def ready(scene: Scene, how: How) -> str:
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
            uri = await scene.uri(how)
            await _known(uri, scene, how)
            return uri
    except TimeoutError as error:
        raise TimeoutError(f"it was not ready after {START_S:.0f} s") from error


async def _known(uri: str, scene: Scene, how: How) -> None:
    """Wait until every parameter is known aboard, or to the orbiter, and the true pose here."""
    needed = () if how is How.DIRECT else (Parameter.POS_X.value, Parameter.CAM_PAN.value)
    async with await MrsClient.connect(uri) as client:
        while not scene.heard.true or any(
            value.validity is not Validity.VALID for value in await client.get_value(*needed)
        ):
            await asyncio.sleep(GLANCE_S)
        brick = scene.rover.settings.locomotion is Way.WHOLE_MOTION
        if brick and how is How.DIRECT and scene.orbiter is not None:
            await client.run(client.command(SetCameraAngles(0.0, 0.0)))
