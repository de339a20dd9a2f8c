"""A store that is full says so to everybody, and names what to do."""

import asyncio
import os
from collections.abc import Callable
from math import isnan, pi
from pathlib import Path
from types import SimpleNamespace

import pytest

from adapters.mal import MalError
from adapters.mrs.spec import AssetMode, describe_error
from adapters.mrs.spec.types import Severity
from executive.commands import Mode
from executive.commands.catalogue import MoveForward, Stop
from executive.values.reports import Report, Stage
from tests.relay.orbiter.sky import LIMIT_S, Sky, ground, meeting, orbiting, until

MB = 1_000_000


def disk_with(octets: int) -> Callable[[Path], SimpleNamespace]:
    return lambda _: SimpleNamespace(f_bavail=octets, f_frsize=1)


async def test_the_ground_is_notified_when_it_fills_and_when_there_is_space_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky) as (relay, (station,)), await ground(station) as client:
        notifications = client.notifications()

        async def next_report() -> Report:
            relay.poll()
            return (await anext(notifications)).report

        assert (await next_report()).text == "contact"
        monkeypatch.setattr(os, "statvfs", disk_with(100 * MB))
        await until(lambda: relay.agent.health().free_octets < 50 * MB)
        (free,) = await client.get_value("DTN_FREE_OCTETS")
        assert free.value == 100 * MB - (64 << 20)
        monkeypatch.setattr(os, "statvfs", disk_with(30 * MB))
        await until(lambda: bool(relay.agent.health().full_text))
        full = await next_report()
        assert full.severity is Severity.WARNING
        assert full.text.startswith("the orbiter's store is full: bundle store ")
        with pytest.raises(MalError) as caught:
            await client.submit(client.command(MoveForward(1.0)))
        text = describe_error(caught.value)
        assert text.startswith("Busy: the relay is full: bundle store ")
        assert f"{tmp_path}/orbiter/bundles.sqlite" in text
        assert "30 MB are free on the disk, 67 MB must stay free: free disk space" in text
        await client.submit(client.command(Stop()))
        monkeypatch.undo()
        await until(lambda: not relay.agent.health().full_text)
        again = await next_report()
        assert (again.severity, again.text) == (
            Severity.INFORMATIONAL, "the orbiter's store has free space again",
        )  # fmt: skip


async def test_telemetry_answers_questions_and_is_pushed(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with meeting(sky) as (_, rover, client):
        assert isnan((await client.get_pose()).x)
        telemetry = await client.telemetry()
        await rover.send_telemetry(POS_X=1.0, POS_Y=-2.0, HEAD=pi / 2, CAM_PAN=0.25)
        pushed = [await anext(telemetry) for _ in range(12)]
        known = {v.name for v in pushed if v.value is not None}
        assert known == {"POS_X", "POS_Y", "HEAD", "CAM_PAN"}
        pose = await client.get_pose()
        assert (pose.x, pose.y, pose.heading) == (1.0, -2.0, pi / 2)
        assert isnan((await client.get_speeds()).travelSpeed)
        assert (await client.get_camera_state()).pan == 0.25
        names = [d.name for d in await client.list_definition()]
        assert [v.name for v in await client.get_value()] == names
        services = {s.name: s.operations for s in await client.get_services()}
        assert services["Notification"] == (2, 3, 5)
        assert "FileTransfer" not in services
    async with orbiting(sky) as (_, (station,)), await ground(station) as client:
        assert (await client.get_pose()).x == 1.0
        assert (await client.get_asset()).mode is AssetMode.OFFLINE


async def test_the_mode_is_that_reported_by_the_rover(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with meeting(sky) as (_, rover, client):
        telemetry = await client.telemetry()
        assert (await client.run(client.command(Stop()))).executed
        assert (await client.get_status()).mode is AssetMode.STOPPED
        for mode in (Mode.MOVING, Mode.SAFE, Mode.IDLE):
            rover.mode = mode
            await rover.send_telemetry(POS_X=1.0)
            await anext(telemetry)
            assert (await client.get_status()).mode is AssetMode[mode.name]
            assert [await anext(telemetry) for _ in range(11)]


async def test_a_brick_is_not_stopped_for_ever(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "mocup", numbered=False)
    async with meeting(sky) as (_, rover, client):
        rover.ledger = ""
        assert (await client.run(client.command(Stop()))).executed
        assert (await client.get_status()).mode is AssetMode.IDLE
        rover.lifecycle = (Stage.STARTED,)
        moving = asyncio.create_task(client.run(client.command(MoveForward(1.0))))
        async with asyncio.timeout(LIMIT_S):
            while (await client.get_status()).mode is AssetMode.IDLE:
                await asyncio.sleep(0.02)
        assert (await client.get_status()).mode is AssetMode.MOVING
        moving.cancel()
