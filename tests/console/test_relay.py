"""A rover behind an orbiter: real agents and sockets, an eclipse, and both links at once."""

import asyncio
from itertools import groupby
from pathlib import Path
from typing import Any

from executive.commands import MoveForward
from executive.values.plan_nodes import Question
from tests.console.conftest import Launch
from tests.console.consoles import ALL, LIMIT_S, at_console
from tests.relay.orbiter.sky import (
    STAGES,
    Clock,
    Sky,
    eclipse,
    ground,
    landed,
    orbiting,
    publishing,
    until,
)


async def test_in_an_eclipse_a_command_waits_at_the_orbiter_and_is_shown_so(
    tmp_path: Path,
) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with (
        orbiting(sky, clock, eclipse(clock)) as (_, (station,)),
        landed(sky, "jackal") as far,
        at_console(tmp_path, str(station.uri), "anna") as (anna,),
    ):
        link = await anna.page.is_up()
        assert link["link"] == "relay"
        await anna.post(
            "api/commands",
            **{"id": "short", "asset": "jackal", "name": "moveForward", "lifetime": 30.0},
            args={"distance": 1.0},
        )
        await anna.send("long", "moveForward", distance=2.0)
        waiting = await anna.page.command("long", "acknowledged")
        assert (waiting["history"][-1]["node"], waiting["deadline"]) == ("orbiter", None)
        clock.shift_s = 60.0
        lost = await anna.page.command("short", "lost")
        assert not lost["ended"]  # whether the rover got it is not known
        clock.shift_s = 3601.0
        done = await anna.page.command("long", "executed")
        nodes = {each["stage"]: each["node"] for each in done["history"]}
        assert (nodes["ACKNOWLEDGED"], nodes["EXECUTED"]) == ("orbiter", "jackal")
        (left,) = [each for each in done["history"] if each["stage"] == "FORWARDED"]
        assert left["node"] == "orbiter"
        assert left["utc"] > waiting["history"][-1]["utc"] + 3600.0  # by the orbiter's clock
        assert len(far.commands) == 1


async def test_a_command_of_another_client_is_known_from_its_departure_on(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with (
        orbiting(sky, clock, eclipse(clock), retransmit_after_s=0.1) as (relay, (station,)),
        landed(sky, "jackal") as far,
        at_console(tmp_path, str(station.uri), "anna") as (anna,),
        await ground(station) as client,
    ):
        await anna.page.is_up()
        far.lifecycle = ()
        command = client.command(MoveForward(1.0))
        await client.submit(command)
        clock.shift_s = 3601.0
        name = f"jackal:{command.identity}"
        left = await anna.page.command(name, "acknowledged")
        assert [each["stage"] for each in left["history"]] == ["FORWARDED"]
        assert (left["name"], left["by"], left["link"]) == ("", "MOE", "relay")
        far.lifecycle = STAGES
        await far.send_telemetry(POS_X=1.0)
        while not far.commands[1:]:
            await relay.retransmit_unanswered()
            await asyncio.sleep(0.02)
        assert (await anna.page.command(name, "executed"))["name"] == "RECEIVED"  # its text


async def test_what_waits_at_the_orbiter_counts_up_and_drains_and_is_kept_in_the_archive(
    tmp_path: Path,
) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with (
        orbiting(sky, clock, eclipse(clock)) as (relay, (station,)),
        landed(sky, "jackal"),
        at_console(tmp_path, str(station.uri), "anna", topics=[*ALL, "tm"]) as (anna,),
        publishing(station),
    ):

        async def published(key: str, value: float) -> None:
            await anna.page.until(lambda text: (text.get("key"), text.get("value")) == (key, value))

        await anna.page.is_up()
        for number in (1.0, 2.0):
            await anna.send(f"waits{number}", "moveForward", distance=number)
            await anna.page.command(f"waits{number}", "acknowledged")
            await published("DTN_QUEUED", number)
        clock.shift_s = 3601.0
        await anna.page.command("waits2.0", "executed")
        await until(lambda: relay.agent.health().queued == 0)
        await published("DTN_ACKNOWLEDGED", 2.0)

        async def stored(key: str) -> list[Any]:
            samples = (await anna.get(f"api/tm/jackal/{key}", link="relay"))["samples"]
            return [each["value"] for each in samples]

        async with asyncio.timeout(LIMIT_S):  # the archive writes a batch now and then
            while (await stored("DTN_ACKNOWLEDGED"))[-1:] != [2.0]:
                await asyncio.sleep(0.05)

        assert [each for each, _ in groupby(await stored("DTN_QUEUED"))] == [0.0, 1.0, 2.0, 0.0]
        assert max(await stored("DTN_QUEUED_OCTETS")) > 100.0
        assert (await stored("DTN_SENT"))[-1] == 2.0
        assert len(await stored("DTN_CONTACTS_UP")) == 1, "told often, kept at each change"


async def test_one_rover_by_both_links_is_one_asset_with_two_sources(
    launch: Launch, tmp_path: Path
) -> None:
    rover, sky = launch(), Sky(tmp_path, "jackal")
    async with (
        orbiting(sky) as (_, (station,)),
        landed(sky, "jackal") as far,
        at_console(
            tmp_path, [rover.uri, str(station.uri)], "anna", topics=["tm", "link", "cmd"]
        ) as (anna,),
    ):
        links = {(await anna.page.is_up())["link"], (await anna.page.is_up())["link"]}
        assert links == {"direct", "relay"}
        # What the orbiter does not know yet is told as of when it is asked: later than this.
        await far.send_telemetry(BATERY_VOLTAGE=25.0)
        await anna.page.until(lambda text: (text.get("link"), text.get("value")) == ("relay", 25.0))
        await far.send_telemetry(BATERY_VOLTAGE=25.5)
        await anna.page.until(lambda text: (text.get("link"), text.get("value")) == ("relay", 25.5))
        dictionary = (await anna.get("api/dictionary"))["assets"]
        keys = [each["key"] for each in dictionary["jackal"]["parameters"]]
        assert "DTN_NEXT_CONTACT" in keys
        assert len(keys) == len(set(keys))
        found = (await anna.post("api/tm:batch", keys=[["jackal", "BATERY_VOLTAGE"]]))[1]["samples"]
        assert {(each["link"], each["value"]) for each in found} == {
            ("direct", 26.0),
            ("relay", 25.5),
        }
        status, sent = await anna.send("soon", "moveForward", distance=1.0)
        assert (status, sent["link"]) == (202, "direct")
        stop = (await anna.request("POST", "api/stop/jackal"))[1]
        rover.run(2.0)
        assert (await anna.page.command(stop["id"], "executed"))["link"] == "direct"
        assert not far.commands  # it might arrive long after a resume
        rover.hang_up()
        await anna.page.until(lambda text: text.get("state") == "down")
        stop = (await anna.request("POST", "api/stop/jackal"))[1]
        assert (await anna.page.command(stop["id"], "executed"))["link"] == "relay"
        assert [message.command for message in far.commands] == ["STOP"]


async def test_a_rover_that_is_known_by_the_relay_is_found_by_a_service_layer_too(
    launch: Launch, tmp_path: Path
) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    scout = launch("scout")
    async with (
        orbiting(sky, clock, eclipse(clock)) as (_, (station,)),
        landed(sky, "jackal"),
        at_console(tmp_path, [str(station.uri), scout.uri], "anna") as (anna,),
    ):
        assert (await anna.page.is_up())["link"] == "relay"
        launch("jackal", service_layer=scout.uri)
        assert (await anna.page.is_up())["link"] == "direct"


async def test_a_question_of_a_plan_is_known_through_the_orbiter(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    question = Question("plan:survey/ditch", "cross?", ("cross", "back"), "back", 1.9e9)
    topics = (*ALL, "question")
    async with (
        orbiting(sky, clock) as (_, (station,)),
        landed(sky, "jackal") as far,
        at_console(tmp_path, str(station.uri), "anna", topics=topics) as (anna,),
    ):
        await anna.page.is_up()
        await far.question(100.0, survey=question)
        opened = await anna.page.until(lambda each: each["ty"] == "question")
        assert (opened["plan"], opened["question"]) == ("survey", question.key)
        assert (opened["options"], opened["until"]) == (["cross", "back"], 1.9e9)
        await far.question(130.0)
        ended = await anna.page.until(lambda each: each["ty"] == "question")
        assert ended == opened | {"end": "", "seq": ended["seq"]}
