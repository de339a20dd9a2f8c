"""Commands from pages to a rover and back: real octets on both sides of the console."""

from pathlib import Path

from tests.console.consoles import at_console
from tests.mrs.aboard import Aboard


def stages(command: dict[str, object]) -> list[str]:
    history = command["history"]
    assert isinstance(history, list)
    return [each["stage"] for each in history]


async def test_two_consoles_see_a_command_stage_by_stage(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna", "ben") as (anna, ben):
        await anna.page.is_up()
        status, sent = await anna.send("drive", "moveForward", distance=1.0)
        assert (status, sent["state"], sent["by"]) == (202, "sending", "anna")
        for page in (anna.page, ben.page):
            done = await page.command("drive", "executed")
            reported = [each for each in stages(done) if each not in {"ACKNOWLEDGED", "PREDICTED"}]
            assert reported == ["SENT", "RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"]
            assert done["ended"]
            assert done["args"] == {"distance": 1.0}
            aboard = [each for each in done["history"] if each["node"] == "jackal"]
            assert all(each["rx"] > 0 and each["utc"] > 0 for each in aboard)
            assert done["history"][-1]["figures"]["length"] > 0.9
        received = await ben.page.until(lambda message: message.get("stage") == "EXECUTED")
        assert (received["ty"], received["command"]) == ("ntf", "drive")


async def test_the_same_id_is_sent_once(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        await anna.send("once", "moveForward", distance=0.5)
        await anna.page.command("once", "executed")
        status, again = await anna.send("once", "moveForward", distance=0.5)
        assert (status, again["command"]["state"]) == (409, "executed")
        taken = (await anna.get("api/notifications"))["notifications"]
        assert [each["stage"] for each in taken].count("RECEIVED") == 1
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        status, again = await anna.send("once", "moveForward", distance=0.5)
        assert (status, again["command"]["state"]) == (409, "executed")


async def test_without_the_authority_a_command_is_refused_and_then_granted(
    guarded: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, guarded.uri, "anna", "ben") as (anna, ben):
        await anna.page.holds(None)
        status, refusal = await anna.send("a1", "moveForward", distance=0.5)
        assert status == 403
        assert "no operator holds it; request it first" in refusal["error"]
        assert (await anna.authority("request"))[1]["operator"] == "anna"
        await ben.page.holds("anna")
        assert (await anna.send("a2", "moveForward", distance=0.5))[0] == 202
        await ben.page.command("a2", "executed")

        status, refusal = await ben.send("b1", "moveForward", distance=0.5)
        assert (status, refusal["holder"]) == (403, "anna")
        status, refusal = await ben.authority("request")
        assert (status, refusal["holder"]) == (403, "anna")
        assert "anna holds it" in refusal["error"]
        requested = await anna.page.until(lambda message: message.get("requested_by") == "ben")
        assert requested["holder"] == "anna"
        assert (await anna.authority("hand_over", to="ben"))[1]["operator"] == "ben"
        await ben.page.holds("ben")
        assert (await ben.send("b2", "moveForward", distance=0.5))[0] == 202
        await anna.page.command("b2", "executed")
        assert (await anna.send("a3", "moveForward", distance=0.5))[1]["holder"] == "ben"
        assert (await ben.authority("release"))[1]["holder"] is None
        await anna.page.holds(None)


async def test_every_operator_can_stop_the_rover_and_all_see_the_sender(
    guarded: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, guarded.uri, "anna", "ben") as (anna, ben):
        await anna.page.is_up()
        await anna.authority("request")
        await anna.send("long", "moveForward", distance=50.0)
        await anna.page.command("long", "started")
        status, stop = await ben.request("POST", "api/stop/jackal")
        assert (status, stop["by"]) == (202, "ben")
        assert (await anna.page.command(stop["id"], "executed"))["by"] == "ben"
        assert guarded.do(lambda bench: bench.executive.mode.name) == "STOPPED"
        ended = [
            message
            for message in anna.page.got
            if message["ty"] == "cmd" and message["id"] == "long"
        ]
        assert ended[-1]["state"] == "cancelled"
        again = await ben.send(stop["id"], "stop")
        assert again[0] == 202
        assert again[1]["id"] != stop["id"]  # a stop is never a repeat


async def test_a_command_refused_by_the_rover_ends_rejected_with_its_reason(
    rover: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        await anna.request("POST", "api/stop/jackal")
        await anna.page.until(lambda message: message.get("mode") == "STOPPED")
        assert (await anna.send("no", "moveForward", distance=0.5))[0] == 202
        refused = await anna.page.command("no", "rejected")
        while refused["history"][-1]["code"] is None:
            refused = await anna.page.command("no", "rejected")
        assert stages(refused).count("REJECTED") == 1
        assert "send resume first" in refused["history"][-1]["detail"]


async def test_a_preview_moves_nothing(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        body = {"asset": "jackal", "name": "moveTo", "args": {"x": 2.0, "y": 0.0}}
        status, preview = await anna.post("api/preview", **body)
        assert status == 200
        assert 1.8 < preview["path"][-1]["x"] < 2.2
        status, refusal = await anna.post("api/preview", asset="jackal", name="stop", args={})
        assert (status, refusal["field"]) == (422, "name")
        assert rover.do(lambda bench: bench.rover.pose.x_m) == 0.0


async def test_of_a_command_into_a_dead_link_nothing_is_claimed(
    rover: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        rover.runs = False
        await anna.send("drive", "moveForward", distance=5.0)
        rover.run(0.5)
        await anna.page.command("drive", "started")
        rover.hang_up()
        await anna.page.until(lambda message: message.get("state") == "down")
        status, refusal = await anna.send("later", "moveForward", distance=1.0)
        assert (status, "nothing was sent" in refusal["error"]) == (503, True)
        rover.run(60.0)
        rover.listen()
        done = await anna.page.command("drive", "executed")
        assert stages(done)[-1] == "EXECUTED"
