"""`rover mops`, as typed."""

import asyncio
import json
import subprocess
import sys
from pathlib import Path

from tests.relay.orbiter.sky import (
    LIMIT_S,
    Sky,
    landed,
    orbiting,
)

TYPED = """
moveForward 1.5    # a comment
setCameraAngles - 0.25
executeAction "VIDEO ON"
deleteFile "a, 100 %/ü#|.png"
"""


async def rover(*arguments: str, typed: str = "") -> tuple[int, str]:
    """Run the command as a process, for this one serves the other end."""
    command = str(Path(sys.executable).with_name("rover"))
    process = await asyncio.create_subprocess_exec(
        command, *arguments,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    async with asyncio.timeout(LIMIT_S):
        said, _ = await process.communicate(typed.encode())
    return process.returncode or 0, said.decode()


def test_lines_command_a_rover_and_tell_of_it(tmp_path: Path) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "jackal")
        async with orbiting(sky) as (_, (station,)), landed(sky, "jackal") as far:
            await far.telemetry(POS_X=1.25)
            status, said = await rover("mops", "--to", str(station.uri), typed=TYPED + "status\n")
            assert status == 0, said
            assert [(m.source, m.command, m.inputs) for m in far.commands] == [
                ("MOPS", "MOVE_FORWARD", ("1.5",)),
                ("MOPS", "SET_CAMERA_ANGLES", ("", "0.25")),
                ("MOPS", "EXECUTE_ACTION", ("VIDEO ON",)),
                ("MOPS", "DELETE_FILE", ("a%2C 100 %25/%C3%BC%23%7C.png",)),
            ]
            lines = [line.split() for line in said.splitlines()]
            for message in far.commands:
                mine = [word for _, word, *rest in lines if f"MOPS:{message.moe_inputs_id}" in rest]
                assert mine == ["SENT", "RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"]
            assert any(word == "DTN" and "DTN_QUEUED" in rest[0] for _, word, *rest in lines)
            assert any(word == "TELEMETRY" and "POS_Y=-" in rest for _, word, *rest in lines)

    asyncio.run(run())


def test_what_is_not_understood_is_refused_and_the_rest_goes_on(tmp_path: Path) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "jackal")
        typed = 'moveForwards 1\nmoveForward far\nmoveForward\n"\nhelp\nstop\n'
        async with orbiting(sky) as (_, (station,)), landed(sky, "jackal") as far:
            status, said = await rover("mops", "--to", str(station.uri), typed=typed)
            assert status == 1
            assert said.count("REFUSED") == 4
            assert "moveForward DISTANCE_M" in said
            assert "distance_m: 'far' is no number" in said
            assert [m.command for m in far.commands] == ["STOP"]

    asyncio.run(run())


def test_quit_does_not_wait(tmp_path: Path) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "jackal")
        async with orbiting(sky) as (_, (station,)):
            status, said = await rover("mops", "--to", str(station.uri), typed="stop\nquit\n")
            assert status == 0
            assert "SENT" in said

    asyncio.run(run())


def test_rover_status_shows_the_rover_and_the_relay(tmp_path: Path) -> None:
    async def run() -> None:
        sky = Sky(tmp_path, "jackal")
        async with orbiting(sky) as (_, (station,)):
            status, said = await rover("status", "--to", str(station.uri), "--json")
            told = json.loads(said)
            assert (status, told["asset"], told["mode"]) == (0, "jackal", "OFFLINE")
            assert told["parameters"]["POS_X"] == {"value": None, "unit": "m"}
            assert told["parameters"]["DTN_QUEUED"] == {"value": 0.0, "unit": None}
            status, said = await rover("status", "--to", str(station.uri))
            assert status == 0
            assert "DTN_NEXT_CONTACT" in said
            status, said = await rover("command", "--to", str(station.uri), "--no-wait", "stop")
            assert status == 0, said

    asyncio.run(run())
