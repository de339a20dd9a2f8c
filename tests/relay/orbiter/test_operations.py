"""A rover that knows few commands has those in its directory, and takes no others."""

import asyncio
from pathlib import Path

import pytest

from adapters.mal import MalError
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import describe_error
from adapters.relay.orbiter import load_orbiter
from executive.commands.catalogue import ExecuteAction, MoveForward, Request, Resume, TakePicture
from executive.settings import config_folder
from tests.relay.orbiter.sky import (
    Sky,
    ground,
    landed,
    orbiting,
)


async def refusal(client: MrsClient, request: Request) -> str:
    with pytest.raises(MalError) as caught:
        await client.submit(client.command(request))
    return describe_error(caught.value)


def test_a_brick_is_offered_what_it_knows(tmp_path: Path) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "mocup", numbered=False)
        _, mocup = load_orbiter(config_folder() / "mops" / "orbiter.yaml").rovers
        sky.operations = mocup.operations
        async with (
            orbiting(sky) as (relay, (station,)),
            landed(sky, "mocup") as far,
            await ground(station) as client,
        ):
            far.ledger = ""
            offered = {each.name: each.operations for each in await client.get_services()}
            assert not {"Plan", "FileManagement"} & set(offered)
            assert offered["MotionControl"] == (1, 2, 3, 4, 5, 7, 9, 10, 12, 13)
            assert offered["Camera"] == (2, 3, 4, 5)
            assert offered["Action"] == (1,)
            for request in (TakePicture(), Resume()):
                assert "NotSupported: this asset does not" in await refusal(client, request)
            text = await refusal(client, ExecuteAction("VIDEO ON"))
            assert text.startswith("NotSupported: the rover has no actions; at the orbiter")
            assert (await client.run(client.command(ExecuteAction("contact up")))).executed
            assert (await client.run(client.command(MoveForward(1.0)))).executed
            assert [message.command for message in far.commands] == ["MOVE_FORWARD"]
            assert not relay.agent.health().queued

    asyncio.run(run())
