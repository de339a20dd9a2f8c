"""A stop of an operator is repeated until the rover has answered, and stops it once."""

import asyncio
from pathlib import Path

import pytest

from adapters.console.requests import stops
from adapters.mrs.ground import MrsClient
from executive.commands import Command, Stop
from executive.values.reasons import Reason
from tests.console.consoles import JsonMessage, Operator, at_console
from tests.mrs.aboard import Aboard


async def stop(operator: Operator) -> JsonMessage:
    status, found = await operator.request("POST", "api/stop/jackal")
    assert status == 202, found
    return found


async def is_stop(operator: Operator, state: str) -> JsonMessage:
    return await operator.page.until(
        lambda message: message["ty"] == "stop" and message["state"] == state
    )


async def lose_link(anna: Operator, rover: Aboard) -> None:
    await anna.page.is_up()
    rover.hang_up()
    await anna.page.until(lambda message: message.get("state") == "down")


def mode(rover: Aboard) -> str:
    return rover.do(lambda bench: bench.executive.mode.name)


async def test_a_stop_without_a_link_is_sent_when_the_link_is_back(
    rover: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, rover.uri, "anna", "ben") as (anna, ben):
        await lose_link(anna, rover)
        pressed = await stop(anna)
        assert (await stop(ben))["id"] == pressed["id"]
        waiting = await is_stop(ben, "waiting")
        assert (waiting["operator"], waiting["command"]) == ("anna", pressed["id"])
        async with ben.open_page("stop") as later:
            assert (await later.until(lambda message: message["ty"] == "stop")) | {"seq": 0} == (
                waiting | {"seq": 0}
            )
        assert mode(rover) == "IDLE"
        rover.listen()
        await anna.page.command(pressed["id"], "executed")
        await is_stop(ben, "answered")
        assert mode(rover) == "STOPPED"
        async with ben.open_page("stop", "cmd") as later:
            await later.command(pressed["id"], "executed")
            assert "stop" not in {each["ty"] for each in later.got}


async def test_a_stop_that_was_called_off_is_not_sent(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna", "ben") as (anna, ben):
        await lose_link(anna, rover)
        pressed = await stop(anna)
        status, found = await ben.request("DELETE", "api/stop/jackal")
        assert (status, found["detail"]) == (200, "called off by ben")
        ended = await anna.page.command(pressed["id"], "rejected")
        await is_stop(anna, "called_off")
        assert ended["history"][-1]["detail"] == "called off by ben: it was not sent"
        assert (await ben.request("DELETE", "api/stop/jackal"))[0] == 404
        rover.listen()
        await anna.page.is_up()
        await anna.send("on", "moveForward", distance=0.2)
        await anna.page.command("on", "executed")


async def test_a_stop_with_a_lost_answer_stops_the_rover_once(
    rover: Aboard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submit = MrsClient.submit
    lost: list[Command] = []

    async def lose_answer(client: MrsClient, command: Command) -> None:
        await submit(client, command)
        if isinstance(command.request, Stop):
            lost.append(command)
            raise ConnectionError("lost")

    monkeypatch.setattr(MrsClient, "submit", lose_answer)
    monkeypatch.setattr(stops, "LIFECYCLE_STATES", frozenset())  # as if no report had arrived
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        await stop(anna)
        await is_stop(anna, "answered")
        assert len(lost) == 1
        events = [each.get("code") for each in anna.page.got if each["ty"] == "ntf"]
        assert Reason.DUPLICATE.value not in events


async def test_a_stop_expires_at_its_maximum_age(
    rover: Aboard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stops, "MAX_AGE_S", 0.0)
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await lose_link(anna, rover)
        await stop(anna)
        assert (await is_stop(anna, "expired"))["detail"] == "expired after 0 s"


async def test_the_maximum_age_counts_from_the_press(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        pressed = (await anna.request("POST", "api/stop/jackal", json={"age": 700.0}))[1]
        ended = await anna.page.command(pressed["id"], "rejected")
        assert ended["history"][-1]["detail"] == "expired after 600 s: it was not sent"
        assert mode(rover) == "IDLE"


async def test_an_expired_stop_does_not_call_off_the_stop_of_another_operator(
    rover: Aboard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submit, sent, free = MrsClient.submit, asyncio.Event(), asyncio.Event()

    async def submit_late(client: MrsClient, command: Command) -> None:
        sent.set()
        await free.wait()
        await submit(client, command)

    monkeypatch.setattr(MrsClient, "submit", submit_late)
    async with at_console(tmp_path, rover.uri, "anna", "ben") as (anna, ben):
        await anna.page.is_up()
        pressed = await stop(ben)
        await sent.wait()
        late = (await anna.request("POST", "api/stop/jackal", json={"age": 3600.0}))[1]
        assert late["id"] == pressed["id"]
        free.set()
        await ben.page.command(pressed["id"], "executed")
        assert mode(rover) == "STOPPED"
