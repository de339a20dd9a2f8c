"""A store that is full says so to everybody, and names what to do."""

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from adapters.mal import MalError
from adapters.mrs.spec import Notification, describe_error
from adapters.mrs.spec.types import Severity
from executive.commands.catalogue import Stop
from tests.relay.orbiter.sky import (
    Sky,
    ground,
    orbiting,
    until,
)

MB = 1_000_000


def disk_with(octets: int) -> Callable[[Path], SimpleNamespace]:
    return lambda _: SimpleNamespace(f_bavail=octets, f_frsize=1)


def test_the_ground_is_told_when_it_fills_and_when_there_is_room_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "jackal")
        async with orbiting(sky) as (relay, (station,)), await ground(station) as client:
            notifications = client.notifications()

            async def said() -> Notification:
                relay.look()
                return await anext(notifications)

            assert (await said()).text == "contact"
            monkeypatch.setattr(os, "statvfs", disk_with(100 * MB))
            await until(lambda: relay.agent.health().room_octets < 50 * MB)
            (room,) = await client.get_value("DTN_ROOM")
            assert room.value is not None
            assert room.value.value == 100 * MB - (64 << 20)
            monkeypatch.setattr(os, "statvfs", disk_with(30 * MB))
            await until(lambda: relay.agent.health().full)
            full = await said()
            assert full.severity is Severity.WARNING
            assert (full.text or "").startswith("the orbiter's store is full: bundle store ")
            with pytest.raises(MalError) as caught:
                await client.submit(client.command(Stop()))
            text = describe_error(caught.value)
            assert text.startswith("Busy: the relay is full: bundle store ")
            assert f"{tmp_path}/orbiter/bundles.sqlite" in text
            assert "30 MB are free on its disk, where 67 MB stay free: make room there" in text
            monkeypatch.undo()
            await until(lambda: not relay.agent.health().full)
            again = await said()
            assert (again.severity, again.text) == (
                Severity.INFORMATIONAL, "the orbiter's store has room again",
            )  # fmt: skip

    asyncio.run(run())
