"""What the orbiter tells of a rover's state."""

import asyncio
from math import isnan, pi
from pathlib import Path

from adapters.mrs.spec import AssetMode, Validity
from executive.commands.catalogue import MoveForward, Stop
from executive.commands.modes import Mode
from executive.reports import Stage
from tests.relay.orbiter.sky import (
    LIMIT_S,
    Sky,
    ground,
    meeting,
    orbiting,
)


def test_telemetry_answers_questions_and_is_pushed(tmp_path: Path) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "jackal")
        async with meeting(sky) as (_, rover, client):
            assert isnan((await client.get_pose()).x)
            telemetry = await client.telemetry()
            await rover.telemetry(POS_X=1.0, POS_Y=-2.0, HEAD=pi / 2, CAM_PAN=0.25)
            pushed = [await anext(telemetry) for _ in range(12)]
            known = {v.name for v in pushed if v.validity is Validity.VALID}
            assert known == {"POS_X", "POS_Y", "HEAD", "CAM_PAN"}
            pose = await client.get_pose()
            assert (pose.x, pose.y, pose.heading) == (1.0, -2.0, pi / 2)
            assert isnan((await client.get_speeds()).travelSpeed)
            assert (await client.get_camera_state()).pan == 0.25
            names = [d.name for d in await client.list_definition()]
            assert [v.name for v in await client.get_value()] == names
            services = {s.name: s.operations for s in await client.get_services()}
            assert services["Notification"] == (2, 3)
            assert "FileTransfer" not in services
        async with orbiting(sky) as (_, (station,)), await ground(station) as client:
            assert (await client.get_pose()).x == 1.0
            assert (await client.get_asset()).mode is AssetMode.OFFLINE

    asyncio.run(run())


def test_the_mode_is_what_the_rover_says(tmp_path: Path) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "jackal")
        async with meeting(sky) as (_, rover, client):
            telemetry = await client.telemetry()
            assert (await client.run(client.command(Stop()))).executed
            assert (await client.get_status()).mode is AssetMode.STOPPED
            for mode in (Mode.MOVING, Mode.SAFE, Mode.IDLE):
                rover.mode = mode
                await rover.telemetry(POS_X=1.0)
                await anext(telemetry)
                assert (await client.get_status()).mode is AssetMode[mode.name]
                assert [await anext(telemetry) for _ in range(11)]

    asyncio.run(run())


def test_a_brick_is_not_stopped_for_ever(tmp_path: Path) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "mocup", numbered=False)
        async with meeting(sky) as (_, rover, client):
            rover.ledger = ""
            assert (await client.run(client.command(Stop()))).executed
            assert (await client.get_status()).mode is AssetMode.IDLE
            rover.life = (Stage.STARTED,)
            moving = asyncio.create_task(client.run(client.command(MoveForward(1.0))))
            async with asyncio.timeout(LIMIT_S):
                while (await client.get_status()).mode is AssetMode.IDLE:
                    await asyncio.sleep(0.02)
            assert (await client.get_status()).mode is AssetMode.MOVING
            moving.cancel()

    asyncio.run(run())
