"""`run_live` runs a scenario in real time: the rover as processes, commanded over sockets.

The record is the same as in lock step. It holds notifications and telemetry by subscription, the
mode by polling, and the true pose from the simulation's topic.
"""

import asyncio
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

from adapters.mrs.ground import MrsClient
from executive.commands import SetCameraAngles
from executive.settings import LocomotionKind
from executive.values.parameters import Parameter
from sim.scenario.live_session import CONDITION_POLL_S, LiveSession, watched
from sim.scenario.model import RunMode, Scenario
from sim.scenario.record import Record, TruePose
from sim.scenario.scene import START_S, LiveScene, links_of, live_scene
from sim.scenario.truth import load_requests, undelayed_s


def run_live(scenario: Scenario, folder: Path, mode: RunMode, speed: float = 1.0) -> Record:
    """Run a scenario live and return its record.

    Must be called on the main thread, before any other thread is started.

    Raises:
        ChildError: a process ended.
        ConnectionError: the connection to the rover was lost.
        AddressError: no ROS domain is free.
        TimeoutError: the rover did not get ready in time.
    """
    relay = RunMode.RELAY in links_of(scenario, mode)
    with live_scene(scenario, folder, relay, speed) as scene:

        async def play() -> Record:
            await ready(scene, RunMode.DIRECT)
            return await run_in_setup(scene, scenario, mode)

        return asyncio.run(play())


async def run_in_setup(
    scene: LiveScene,
    scenario: Scenario,
    mode: RunMode,
    brief: bool = False,
    on_update: Callable[[Record], None] = lambda _: None,
) -> Record:
    """Run a scenario in a scene with its rover and world.

    Args:
        scene: processes and recorders of the rover.
        scenario: timeline and expectations.
        mode: link of the run. Over the relay, the executive must be ready before. It starts with
            a stop if a brick moves the rover.
        brief: whether the run ends when all entries are done and all admitted commands have ended.
        on_update: called with the record after each addition.

    Raises:
        ChildError: a process ended.
        ConnectionError: the connection to the rover was lost.
        TimeoutError: the rover did not get ready in time.
    """
    uris = {each.link: await ready(scene, each) for each in links_of(scenario, mode)}
    start_utc_s = time.time()
    if mode is RunMode.RELAY and scene.fleet.start_utc_s is not None:
        start_utc_s = scene.fleet.start_utc_s
        late_s = time.time() - start_utc_s
        if late_s > 0:
            raise TimeoutError(f"the rover was ready {late_s:.0f} s after the planned start")
        await asyncio.sleep(-late_s)
    recorder, speed = scene.recorder, scene.rover.speed
    first = len(recorder.true)
    files = scene.rover.aboard / "files"
    scenario_s = recorder.simulated_s if scene.rover.simulated_time else float
    record = Record(start_utc_s, files, scenario_s)

    def poll() -> None:
        new = recorder.true[first + len(record.poses) :]
        record.poses += [TruePose(record.since_start_s(seen.utc_s), seen.pose) for seen in new]

    session = LiveSession(
        scenario,
        uris,
        mode,
        scene.load,
        scene.faults,
        poll,
        record,
        brief,
        speed,
        on_update=on_update,
        round_trip_s=scene.rover.round_trip_s,
    )
    async with AsyncExitStack() as watching:
        if scene.ground is not None:
            await watching.enter_async_context(watched(scene.ground, record))
        await session.play()
    scene.check()
    true = recorder.true[first:]
    received_s = [record.since_start_s(seen.utc_s) for seen in true]
    times_s = undelayed_s(received_s, [seen.stamp_s for seen in true])
    record.poses = [TruePose(time_s, seen.pose) for time_s, seen in zip(times_s, true, strict=True)]
    driven = (seen for seen in recorder.driven if seen.utc_s >= start_utc_s)
    record.odometry = [seen.pose for seen in driven]
    load_requests(record, scene.rover.aboard / "ledger.sqlite")
    return record


async def ready(scene: LiveScene, mode: RunMode) -> str:
    """Wait until link and simulation report the pose of the rover; return the link's URI.

    An executive starts with a stop, which a brick may receive late. If the relay reaches the brick
    as well, the direct link is ready when the brick has answered a later command.

    Raises:
        ChildError: a process ended.
        ConnectionError: the connection to the rover was lost.
        TimeoutError: not ready within `START_S`.
    """
    try:
        async with asyncio.timeout(START_S):
            uri = await scene.uri(mode)
            near = uri if mode is RunMode.RELAY else await scene.rover.uri()  # without a delay
            await _wait_received(near, scene, mode)
            return uri
    except TimeoutError as error:
        raise TimeoutError(f"the rover was not ready after {START_S:.0f} s") from error


async def _wait_received(uri: str, scene: LiveScene, mode: RunMode) -> None:
    """Wait until pose and camera are received over a link, and the true pose here.

    Other parameters follow later: health figures of the executive's process are seconds apart.
    """
    needed = (Parameter.POS_X.value, Parameter.CAM_PAN.value)
    async with await MrsClient.connect(uri) as client:
        while not scene.recorder.true or any(
            value.value is None for value in await client.get_value(*needed)
        ):
            await asyncio.sleep(CONDITION_POLL_S)
        brick = scene.rover.settings.locomotion is LocomotionKind.DELEGATED
        if brick and mode is RunMode.DIRECT and scene.orbiter is not None:
            await client.run(client.command(SetCameraAngles(0.0, 0.0)))
