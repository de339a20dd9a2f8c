"""Questions of plans reach all pages; the first answer counts, and all pages show the end."""

import gzip
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from playwright.async_api import expect

from adapters.console.rovers import rover_link
from adapters.console.rovers.rover_link import LinkListener, RoverLink
from adapters.mal import MalError, StandardError
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AreaError, AssetInfo, with_text
from adapters.mrs.transport import CLEAR
from adapters.system import OPERATING_SYSTEM as SYSTEM
from executive.values.plan_nodes import NodeStatus, PlanNodeReport, Question
from executive.values.reports import PlanStatus, PlanUpdate
from tests.console.consoles import JsonMessage, Operator, at_console
from tests.console.site import open_browser
from tests.console.test_theme_page import AXE, violations
from tests.mrs.aboard import Aboard
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED
from tests.support.plans import AHEAD, plan

QUESTION = (
    '<Ask name="ditch" question="cross it?" options="cross;stay" default="stay"'
    ' deadline_s="{deadline_s}" answer="{{choice}}"/>'
)
TOPICS = ("link", "cmd", "plan", "question", "ntf")


def with_question(*deadlines_s: int) -> str:
    questions = "".join(QUESTION.format(deadline_s=each) for each in deadlines_s)
    return plan(f"<Sequence>{questions}{AHEAD}</Sequence>").content.decode()


def has_ended(message: JsonMessage) -> bool:
    return message["ty"] == "question" and message["end"] is not None


async def start(anna: Operator, content: str) -> JsonMessage:
    await anna.page.is_up()
    await anna.post("api/plans/jackal", id="p1", plan_id="survey", content=content)
    await anna.page.command("p1", "executed")
    await anna.send("go", "activatePlan", plan_id="survey")
    return await anna.page.until(lambda message: message["ty"] == "question")


async def test_the_first_answer_counts_and_all_pages_see_it(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna", "ben", topics=TOPICS) as (anna, ben):
        opened = await start(anna, with_question(80_000))
        assert (opened["text"], opened["options"]) == ("cross it?", ["cross", "stay"])
        assert (opened["default"], opened["end"]) == ("stay", None)
        args = {"plan_id": "survey", "question": opened["question"]}
        await ben.page.until(lambda message: message["ty"] == "question")
        async with anna.open_page("question") as late:
            again = await late.until(lambda message: message["ty"] == "question")
            assert (again["question"], again["end"]) == (opened["question"], None)
        await anna.send("a1", "answerQuestion", **args, option="cross")
        await anna.page.command("a1", "executed")
        await ben.send("a2", "answerQuestion", **args, option="stay")
        refused = await ben.page.command("a2", "rejected")
        assert "was answered: cross" in refused["history"][-1]["detail"]
        for each in (anna, ben):
            assert "answered cross" in (await each.page.until(has_ended))["end"]
        async with anna.open_page("question", "link") as late:
            await late.is_up()
            assert not [each for each in late.got if each["ty"] == "question"]


async def test_the_default_and_a_withdrawal_end_a_question(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna", topics=TOPICS) as (anna,):
        await start(anna, with_question(100, 80_000))
        await anna.page.until(lambda each: "the default is stay" in each.get("text", ""))
        assert "default" in (await anna.page.until(has_ended))["end"]
        await anna.send("x", "abortPlan", plan_id="survey")
        await anna.page.until(lambda each: "ends without an answer" in each.get("text", ""))
        await anna.page.until(has_ended)


class Deaf:
    """A rover with a question, which answers late once; a console that notes the open ones."""

    def __init__(self) -> None:
        self.answers: list[str] = []
        self.plans = [PlanUpdate("survey", PlanStatus.EXECUTING, 0.0, "", 0, 1, "")]
        self.errors: list[MalError] = []

    async def get_plan_status(self) -> list[PlanUpdate]:
        return self.plans

    async def get_plan_nodes(self, _: str) -> tuple[PlanNodeReport, ...]:
        if self.errors:
            raise self.errors.pop(0)
        question = Question("ditch", "cross it?", ("cross", "stay"), None, None)
        return (PlanNodeReport("ditch", "Ask", 3, NodeStatus.RUNNING, question=question),)

    def on_plan_nodes(self, _: RoverLink, __: str, nodes: tuple[PlanNodeReport, ...]) -> None:
        self.answers.append(", ".join(each.path for each in nodes))
        if len(self.answers) % 2 == 0:
            raise ConnectionError("lost")


async def test_only_a_plan_without_nodes_ends_its_questions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rover_link, "STATUS_S", 0.0)
    rover = Deaf()
    link = RoverLink("maltcp://127.0.0.1:1/MRS", CLEAR, cast("LinkListener", rover), SYSTEM)
    link.info = cast("AssetInfo", SimpleNamespace(asset="jackal"))
    rover.errors = [MalError(StandardError.DELIVERY_TIMEDOUT), with_text(AreaError.REJECTED, "?")]
    with pytest.raises(ConnectionError):
        await link._poll_questions(cast("MrsClient", rover))
    assert rover.answers == ["ditch", "ditch"]
    rover.plans, rover.errors = [], [with_text(AreaError.NOT_FOUND, "survey")]
    rover.answers = [""]
    with pytest.raises(ConnectionError):  # it was removed while the link was lost
        await link._poll_questions(cast("MrsClient", rover))
    assert rover.answers == ["", ""]


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium")
async def test_every_page_has_a_banner_until_the_end(rover: Aboard, tmp_path: Path) -> None:
    async with (
        at_console(tmp_path, rover.uri, "script", topics=TOPICS) as (script,),
        open_browser() as browser,
    ):
        await start(script, with_question(80_000))
        pages = []
        for name in ("anna", "ben"):
            context = await browser.new_context(viewport={"width": 1280, "height": 800})
            page = await context.new_page()
            await page.add_init_script(gzip.decompress(AXE.read_bytes()).decode())
            await page.add_init_script(NAMED.format(name=name))
            await page.goto(f"{script.address}lite")
            pages.append(page)
        first, _ = pages
        for page in pages:
            await expect(page.get_by_role("alert").filter(has_text="cross it?")).to_be_visible()
            await expect(page.get_by_role("button", name="cross")).to_be_enabled()
        banner = first.locator(".question")
        await expect(banner.locator(".default")).to_have_text("stay")
        await expect(banner.get_by_role("timer")).to_contain_text(" UTC, then stay")
        assert await violations(first) == []
        ARTIFACTS.mkdir(parents=True, exist_ok=True)
        await first.screenshot(path=ARTIFACTS / "console-question.png")
        await first.keyboard.press("Alt+q")
        await expect(banner.get_by_role("button", name="cross")).to_be_focused()
        await first.keyboard.press("Enter")
        for page in pages:
            await expect(page.locator(".question")).to_have_count(0)
            await expect(page.locator(".rover-bar .message")).to_contain_text(
                "“cross it?” was answered: cross, by anna"
            )
        await script.page.until(lambda each: "answered: cross, by anna" in each.get("text", ""))


NAMED = "sessionStorage.setItem('rover-console-operator', {name!r})"
