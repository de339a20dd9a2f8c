"""The two links (thesis 7.2, 7.3) over real processes: the same reports, and each by itself."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import ExitStack
from dataclasses import replace
from math import hypot
from pathlib import Path
from typing import Any

import pytest

from adapters.mrs.ground.client import MrsClient
from executive.commands.catalogue import SetTravelSpeed
from sim.processes.children import ChildProcess
from sim.scenario.expect_commands import LifecycleExpectation
from sim.scenario.live import ready, run_in_setup
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode, Scenario, Send
from sim.scenario.outcome import judge
from sim.scenario.reading import load_scenario
from sim.scenario.record import Record
from sim.scenario.scene import LiveScene, live_scene
from tests.support.lifecycles import Lifecycles, lifecycles

pytestmark = [
    pytest.mark.busy,
    pytest.mark.ros,
    pytest.mark.slow,
    pytest.mark.usefixtures("ros_domain", "warm_children"),
]

MOVING_M = 0.03
BUSY = 4.0
"""Factor of times on a machine that does much else."""
PATIENCE_S = 120.0
SHORT = """
title: A drive by the direct link, out of sight for a while
duration: 4
timeline:
  - {at: 0.2, command: {moveTo: {x: 1, y: 0}}, label: there}
  - {after: there STARTED + 0.4, outage: 1}
  - {after: there EXECUTED, command: {moveForward: {distance: 500}}, label: too-far}
  - {after: there EXECUTED, command: {rotateBy: {angle: 20deg}}, label: turn}
expect:
  - {command: turn, ends: EXECUTED}
"""


def reported_by(source: str, scenario: Scenario) -> Scenario:
    """Return a scenario whose commands are of another source, so that their numbers are new."""
    timeline = tuple(
        replace(entry, source=source) if isinstance(entry, Send) else entry
        for entry in scenario.timeline
    )
    return replace(scenario, timeline=timeline)


def patient(scenario: Scenario) -> Scenario:
    """Return a scenario with more time for its commands."""
    expect = tuple(
        replace(each, within_s=BUSY * each.within_s)
        if isinstance(each, LifecycleExpectation) and each.within_s is not None
        else each
        for each in scenario.expect
    )
    return replace(scenario, duration_s=1.5 * scenario.duration_s, expect=expect)


def in_lock_step(scenario: Scenario, folder: Path) -> Lifecycles:
    return lifecycles(run_in_lock_step(scenario, folder / scenario.title))


def failing(scenario: Scenario, record: Record) -> list[str]:
    return [
        f"{found.subject}: {found.expected}, seen {found.observed}"
        for found in judge(scenario, record)
        if not found.passed
    ]


async def briefly(scene: LiveScene, scenario: Scenario, mode: RunMode) -> Record:
    """Play a scenario for its reports, and give it time on a machine that has much to do."""
    patient = replace(scenario, duration_s=PATIENCE_S)
    return await run_in_setup(scene, patient, mode, brief=True)


async def active(scene: LiveScene, then: Callable[[], None]) -> None:
    """Do something as soon as the rover has gone a little way."""
    while not scene.recorder.true:
        await asyncio.sleep(0.02)
    first = scene.recorder.true[-1].pose
    while True:
        pose = scene.recorder.true[-1].pose
        if hypot(pose.x_m - first.x_m, pose.y_m - first.y_m) > MOVING_M:
            return then()
        await asyncio.sleep(0.02)


async def during(play: Coroutine[Any, Any, Record], kill: Coroutine[Any, Any, None]) -> Record:
    killing = asyncio.create_task(kill)
    record = await play
    assert killing.done(), "the rover never went anywhere"
    return record


def kill_relay(scene: LiveScene) -> None:
    assert scene.orbiter is not None
    asset = scene.rover.settings.asset
    scene.orbiter.relays[asset].kill()
    scene.orbiter.children[-1].kill()


def executive_again(scene: LiveScene, folder: Path, uri: str) -> ChildProcess:
    port = uri.rpartition(":")[2].partition("/")[0]
    options = ("--asset", str(folder / "asset.yaml"), "--data", str(scene.rover.aboard))
    environment = {"ROS_DOMAIN_ID": str(scene.rover.address.domain)}
    module = "adapters.onboard.process"
    return ChildProcess("again", module, (*options, "--port", port), folder, environment)


def test_mocup_reports_the_same_by_either_link_while_the_other_dies(tmp_path: Path) -> None:
    camera = load_scenario("mocup_camera")
    locomotion = reported_by("MOE-2", load_scenario("mocup_locomotion"))

    async def by_relay(scene: LiveScene, folder: Path) -> tuple[Record, Record]:
        uri = await ready(scene, RunMode.DIRECT)
        async with await MrsClient.connect(uri, patience_s=PATIENCE_S) as direct:
            kill = active(scene, scene.rover.children[-1].kill)
            first = await during(briefly(scene, camera, RunMode.RELAY), kill)
            second = await briefly(scene, locomotion, RunMode.RELAY)
            again = executive_again(scene, folder, uri)
            try:
                assert (await direct.run(direct.command(SetTravelSpeed(0.2)))).executed
            finally:
                again.end()
            return first, second

    async def by_direct_link(scene: LiveScene) -> tuple[Record, Record]:
        kill = active(scene, lambda: kill_relay(scene))
        first = await during(briefly(scene, camera, RunMode.DIRECT), kill)
        return first, await briefly(scene, locomotion, RunMode.DIRECT)

    with ExitStack() as running:
        scenes = []
        for mode in (RunMode.DIRECT, RunMode.RELAY):
            folder = tmp_path / mode.link
            folder.mkdir()
            scenes.append(running.enter_context(live_scene(camera, folder, relay=True)))

        async def both() -> tuple[tuple[Record, Record], tuple[Record, Record]]:
            relayed = by_relay(scenes[1], tmp_path / RunMode.RELAY.link)
            return await asyncio.gather(by_direct_link(scenes[0]), relayed)

        direct, relay = asyncio.run(both())
    for scenario, one, other in zip((camera, locomotion), direct, relay, strict=True):
        expected = in_lock_step(scenario, tmp_path)
        assert lifecycles(one) == expected
        assert lifecycles(other) == expected


def test_the_jackal_by_the_relay_and_then_without_it(tmp_path: Path) -> None:
    relay = patient(load_scenario("relay", RunMode.RELAY))
    path = tmp_path / "short.yaml"
    path.write_text(SHORT)
    short = reported_by("MOE-2", load_scenario(str(path), RunMode.DIRECT))

    async def session(scene: LiveScene) -> tuple[Record, Record]:
        by_relay = await run_in_setup(scene, relay, RunMode.RELAY)
        kill = active(scene, lambda: kill_relay(scene))
        return by_relay, await during(briefly(scene, short, RunMode.DIRECT), kill)

    with live_scene(relay, tmp_path, relay=True) as scene:
        by_relay, direct = asyncio.run(session(scene))
    assert failing(relay, by_relay) == []
    assert lifecycles(direct) == in_lock_step(short, tmp_path)
