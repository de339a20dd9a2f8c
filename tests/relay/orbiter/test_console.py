"""`rover mops`, as typed."""

import json
from math import pi
from pathlib import Path

import pytest

from adapters.relay.orbiter.console import report_line
from executive.commands.catalogue import Stop
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from tests.relay.orbiter.sky import Clock, Sky, eclipse, ground, landed, orbiting, rover

TYPED = """
moveForward 150cm    # a comment
setCameraAngles - 0.25rad
followPath 1 2 90deg - 0 1m - 0.1
executeAction "VIDEO ON"
deleteFile "a, 100 %/ü#|.png"
"""


async def test_lines_command_a_rover_and_report_on_it(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky) as (_, (station,)), landed(sky, "jackal") as far:
        await far.send_telemetry(POS_X=1.25)
        status, text = await rover("mops", "--to", str(station.uri), typed=TYPED + "status\n")
        assert status == 0, text
        assert [(m.source, m.command, m.inputs) for m in far.commands] == [
            ("MOPS", "MOVE_FORWARD", ("1.5",)),
            ("MOPS", "SET_CAMERA_ANGLES", ("", "0.25")),
            ("MOPS", "FOLLOW_PATH", ("1.0", "2.0", str(pi / 2), "", "0.0", "1.0", "", "0.1")),
            ("MOPS", "EXECUTE_ACTION", ("VIDEO ON",)),
            ("MOPS", "DELETE_FILE", ("a%2C 100 %25/%C3%BC%23%7C.png",)),
        ]
        lines = [line.split() for line in text.splitlines()]
        for message in far.commands:
            mine = [word for _, word, *rest in lines if f"MOPS:{message.moe_inputs_id}" in rest]
            if "STORED" in mine:  # said only of what the rover has not answered within a second
                mine.remove("STORED")
            mine.remove("FORWARDED")  # before or after what comes down
            assert mine == ["SENT", "RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"]
        assert any(word == "DTN" and "DTN_QUEUED" in rest[0] for _, word, *rest in lines)
        assert any(word == "TELEMETRY" and "POS_Y=-" in rest for _, word, *rest in lines)


async def test_an_unknown_line_is_refused_and_the_rest_continues(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    typed = 'moveForwards 1\nmoveForward far\nrotateBy 5\nmoveForward\n"\nhelp\nstop\n'
    async with orbiting(sky) as (_, (station,)), landed(sky, "jackal") as far:
        status, text = await rover("mops", "--to", str(station.uri), typed=typed)
        assert status == 1
        assert text.count("REFUSED") == 5
        assert "moveForward DISTANCE_M" in text
        assert "'far' is no quantity in m: write 0.5, 0.5m or 50cm" in text
        assert "5 has no unit: write 5deg or 5rad" in text
        assert [m.command for m in far.commands] == ["STOP"]


async def test_quit_does_not_wait(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky) as (_, (station,)):
        status, text = await rover("mops", "--to", str(station.uri), typed="stop\nquit\n")
        assert status == 0
        assert "SENT" in text


async def test_rover_status_shows_the_rover_and_the_relay(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky) as (_, (station,)):
        status, text = await rover("status", "--to", str(station.uri), "--json")
        reported = json.loads(text)
        assert (status, reported["asset"], reported["mode"]) == (0, "jackal", "OFFLINE")
        assert reported["parameters"]["POS_X"] == {"value": None, "unit": "m"}
        assert (reported["faults"], reported["unmonitored"]) == (None, None)
        assert reported["parameters"]["DTN_QUEUED"] == {"value": 0.0, "unit": None}
        status, text = await rover("status", "--to", str(station.uri))
        assert status == 0
        assert "DTN_NEXT_CONTACT" in text
        assert "active faults are not listed here, only reported as events" in text
        status, text = await rover("command", "--to", str(station.uri), "--no-wait", "stop")
        assert status == 0, text


FORGED = "no\n12:00:03.530Z EXECUTED  MOPS:8"


@pytest.mark.parametrize("end", ["\n", "\r", "\x85", "\u2028", "\x1b[2K"])
def test_a_text_cannot_begin_a_line_of_its_own(end: str) -> None:
    text = FORGED.replace("\n", end)
    report = Report(
        1,
        0.0,
        ReportKind.COMMAND,
        Severity.WARNING,
        text,
        Identity("MOPS", 7),
        Stage.FAILED,
        "relay",
    )
    line = report_line(report)
    assert line.isprintable()
    assert line.startswith("00:00:00.000Z FAILED    MOPS:7 no?")


WHERE = "at the orbiter; next contact at 20"


async def test_a_command_waiting_at_the_orbiter_is_reported_there(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with orbiting(sky, clock, eclipse(clock), lifetime_s=3.0) as (_, (station,)):
        to = ("--to", str(station.uri))
        _, text = await rover("command", *to, "stop")
        assert f"STORED     {WHERE}" in text.splitlines()[1]
        _, text = await rover("mops", *to, "--no-telemetry", typed="stop\n")
        (line,) = [line.split() for line in text.splitlines() if WHERE in line]
        assert line[1:4:2] == ["STORED", "at"]
        status, text = await rover("command", *to, "--no-wait", "stop")
        assert (status, text.splitlines()[1].startswith(f"stored {WHERE}")) == (0, True)


async def test_in_contact_nothing_is_reported_as_stored(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with (
        orbiting(sky) as (_, (station,)),
        landed(sky, "jackal"),
        await ground(station) as client,
    ):
        where: list[str] = []
        assert (await client.run(client.command(Stop()), on_stored=where.append)).executed
        assert where == []


async def test_a_repeat_in_the_dark_is_not_called_another_command(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with orbiting(sky, clock, eclipse(clock)) as (_, (station,)):
        typed = ("command", "--to", str(station.uri), "--id", "7", "--no-wait", "stop")
        assert (await rover(*typed))[0] == 0
        again = [word for word in typed if word != "--no-wait"]
        status, text = await rover(*again)
        assert status == 1
        assert f"MOE:7 was accepted before, {WHERE}" in text
        assert "there is no report yet, or it was another command" in text
