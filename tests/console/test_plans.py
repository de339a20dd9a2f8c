"""Plans of a page, to a rover and into the archive."""

from pathlib import Path
from typing import Any

from tests.console.consoles import at_console
from tests.mrs.aboard import Aboard
from tests.support.plans import AHEAD, plan


async def test_a_plan_is_submitted_run_and_found_again(rover: Aboard, tmp_path: Path) -> None:
    content = plan(AHEAD).content.decode()
    body = {"id": "p1", "plan_id": "survey", "content": content}
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        status, sent = await anna.post("api/plans/jackal", **body)
        assert (status, sent["name"], sent["args"]["plan_id"]) == (202, "submitPlan", "survey")
        await anna.page.command("p1", "executed")
        assert (await anna.post("api/plans/jackal", **body))[0] == 409
        await anna.send("go", "activatePlan", plan_id="survey")
        done = await anna.page.until(
            lambda message: message["ty"] == "plan" and message["status"] == "COMPLETED"
        )
        assert (done["plan"], done["done"]) == ("survey", done["total"])
        by_plan = [message for message in anna.page.got if message.get("by") == "plan:survey"]
        assert by_plan

        (stored,) = (await anna.get("api/plans/jackal"))["plans"]
        assert (stored["plan"], stored["operator"], stored["command"]) == ("survey", "anna", "p1")
        found = await anna.get(f"api/plans/jackal/{stored['revision']}")
        assert found["content"] == content
        assert (await anna.request("GET", "api/plans/jackal/99"))[0] == 404


async def test_a_plan_that_makes_no_sense_is_refused(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        bad: list[tuple[dict[str, Any], str]] = [
            ({"content": "<x/>"}, "plan_id"),
            ({"plan_id": "a"}, "content"),
            ({"plan_id": "a", "content": "x" * 300_000}, "content"),
            ({"plan_id": "a", "content": "<x/>", "arguments": {"far": 1}}, "arguments"),
        ]
        for number, (body, field) in enumerate(bad):
            status, answer = await anna.post("api/plans/jackal", id=f"b{number}", **body)
            assert (status, answer["field"]) == (422, field)
        await anna.post("api/plans/jackal", id="bad", plan_id="a", content="<x/>")
        refused = await anna.page.command("bad", "rejected")
        assert refused["history"][-1]["detail"]
