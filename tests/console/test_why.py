"""Why a rover did what it did, and how its tree was, asked by a page."""

from pathlib import Path

from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.mrs.aboard import Aboard


async def test_a_page_receives_the_explanation(launch: Launch, tmp_path: Path) -> None:
    rover = launch(explains=True)
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        await anna.send("drive", "moveForward", distance=5.0)
        rover.run(0.5)
        await anna.page.command("drive", "started")
        await anna.request("POST", "api/stop/jackal")
        rover.run(2.0)
        await anna.page.command("drive", "cancelled")
        reported = await anna.get("api/why/jackal/drive")
        assert reported["reason"] == "STOPPED"
        assert "moveForward distance 5 m was cancelled: stopped by anna" in reported["headline"]
        assert reported["lines"][0] == reported["headline"]
        assert all(step["text"] for step in reported["steps"])
        assert (await anna.get("api/why/jackal"))["headline"].startswith("STOPPED")
        status, answer = await anna.request("GET", "api/why/jackal/no such thing")
        assert (status, answer["field"]) == (404, "command")


async def test_a_rover_without_history_service_is_reported(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        status, answer = await anna.request("GET", "api/why/jackal")
        assert status == 501
        assert "NotSupported" in answer["error"]


async def test_the_tree_arrives_as_it_changes_and_can_be_displayed_later(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna", topics=["link", "tree", "cmd"]) as (anna,):
        await anna.page.is_up()
        idle = await anna.page.until(lambda message: message["ty"] == "tree")
        assert (idle["asset"], idle["mode"], idle["nodes"][0]["depth"]) == ("jackal", "IDLE", 0)
        await anna.send("drive", "moveForward", distance=3.0)
        rover.run(0.5)
        await anna.page.until(  # the mode is MOVING from the submission on, a tick later the leaf
            lambda message: (
                message["ty"] == "tree"
                and message["mode"] == "MOVING"
                and any(node["status"] == "running" for node in message["nodes"])
            )
        )
        rover.run(10.0)
        await anna.page.command("drive", "executed")
        stored = (await anna.get("api/records/tree", asset="jackal"))["records"]
        assert "MOVING" in {each["mode"] for each in stored}
        at = next(each["utc"] for each in stored if each["mode"] == "MOVING")
        before = await anna.get("api/records/tree", asset="jackal", before=at, limit=1)
        assert before["records"][0]["utc"] < at
