"""Why a rover did what it did, and how its tree was, asked by a page."""

from pathlib import Path

from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.mrs.aboard import Aboard


async def test_a_page_is_told_why(launch: Launch, tmp_path: Path) -> None:
    rover = launch(explains=True)
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        await anna.send("drive", "moveForward", distance=5.0)
        rover.run(0.5)
        await anna.page.command("drive", "started")
        await anna.ask("POST", "api/stop/jackal")
        rover.run(2.0)
        await anna.page.command("drive", "cancelled")
        told = await anna.get("api/why/jackal/drive")
        assert told["reason"] == "STOPPED"
        assert "moveForward distance 5 m was cancelled: stopped by anna" in told["headline"]
        assert told["lines"][0] == told["headline"]
        assert all(step["text"] for step in told["steps"])
        assert (await anna.get("api/why/jackal"))["headline"].startswith("STOPPED")
        status, answer = await anna.ask("GET", "api/why/jackal/no such thing")
        assert (status, answer["field"]) == (404, "command")


async def test_what_tells_no_history_says_so(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        status, answer = await anna.ask("GET", "api/why/jackal")
        assert status == 501
        assert "NotSupported" in answer["error"]


async def test_the_tree_comes_as_it_changes_and_can_be_looked_up_later(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna", topics=["link", "tree", "cmd"]) as (anna,):
        await anna.page.is_up()
        idle = await anna.page.until(lambda said: said["ty"] == "tree")
        assert (idle["asset"], idle["mode"], idle["nodes"][0]["depth"]) == ("jackal", "IDLE", 0)
        await anna.send("drive", "moveForward", distance=3.0)
        rover.run(0.5)
        await anna.page.until(  # the mode is MOVING from the submission on, a tick later the leaf
            lambda said: (
                said["ty"] == "tree"
                and said["mode"] == "MOVING"
                and any(node["look"] == "running" for node in said["nodes"])
            )
        )
        rover.run(10.0)
        await anna.page.command("drive", "executed")
        kept = (await anna.get("api/records/tree", asset="jackal"))["records"]
        assert "MOVING" in {each["mode"] for each in kept}
        at = next(each["utc"] for each in kept if each["mode"] == "MOVING")
        before = await anna.get("api/records/tree", asset="jackal", before=at, limit=1)
        assert before["records"][0]["utc"] < at
