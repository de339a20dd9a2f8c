"""Commands and plans of other clients on the map, in a real browser."""

import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from playwright.async_api import Page, expect

from adapters.mrs.ground import MrsClient
from executive.commands import (
    ActivatePlan,
    MoveForward,
    MoveTo,
    Request,
    SubmitPlan,
    SuspendPlan,
    Waypoint,
)
from executive.obstacles.zones import ScannedObstacle
from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.console.site import open_browser, open_whole
from tests.docs.pages import CHECKOUT
from tests.mrs.aboard import Aboard
from tests.support import kinematic
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED
from tests.support.plans import plan

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
VIEW = "#/browse/rover:rovers/rover:jackal/rover:jackal~{}?hideInspector=true"
MAP, FILES, CAMERA = (VIEW.format(name) for name in ("map", "files", "video"))
SURVEY = """<Sequence>
  <moveTo x="6" y="0" deadline_s="60"/>
  <takePicture deadline_s="60"/>
  <Repeat num_cycles="900"><Sequence>
    <moveTo x="6" y="3" deadline_s="60"/>
    <moveTo x="3" y="3" deadline_s="60"/>
  </Sequence></Repeat>
  <moveForward distance="1" deadline_s="60"/>
</Sequence>"""
STARTED = """async source => {
    const { commands } = await (await fetch("/api/commands?asset=jackal&limit=100")).json();
    const first = commands.filter(each => each.source === source).at(-1);
    return first.history.find(each => each.stage === "STARTED").utc;
}"""
SHOW_PAST = """utc => {
    location.hash = `${location.hash.split("?")[0]}?tc.mode=fixed&tc.timeSystem=utc`
        + `&tc.startBound=${Math.round(1000 * utc) - 60000}&tc.endBound=${Math.round(1000 * utc)}`
}"""


@asynccontextmanager
async def map_of(rover: Aboard, folder: Path) -> AsyncIterator[tuple[Page, MrsClient]]:
    """Give the page of a rover's map, and another client."""
    errors: list[str] = []
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    async with (
        at_console(folder, rover.uri, "anna") as (anna,),
        await MrsClient.connect(rover.uri) as terminal,
        open_browser() as browser,
    ):
        page = await browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("pageerror", lambda error: errors.append(str(error)))
        await open_whole(page, f"{anna.address}{MAP}")
        await anna.page.is_up()
        yield page, terminal
    assert errors == []


async def test_goals_and_plans_of_another_client_are_on_the_map(
    launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kinematic, "PICTURE", (CHECKOUT / "docs/images/picture.jpg").read_bytes())
    rover = launch()
    laser = SimpleNamespace(circles=(ScannedObstacle("scanned", 9.0, 2.0, 0.4),))
    async with map_of(rover, tmp_path) as (page, terminal):

        async def send(*requests: Request) -> None:
            for request in requests:
                await terminal.submit(terminal.command(request, source="TER"))

        await send(MoveTo(Waypoint(3.0, 1.0)), MoveForward(1.0))
        rover.run(2.0)
        active = page.locator("[data-goal=moveTo].active")
        await expect(active).to_contain_text(re.compile(r"moveTo  [12]\.\d m  \d+ s left"))
        await expect(active.locator("circle")).to_have_count(1)
        queued = page.locator("[data-goal=moveForward].queued")
        await expect(queued.locator("polyline")).to_have_attribute("points", re.compile(r" "))
        await expect(page.get_by_text("commanded", exact=True)).to_be_visible()
        await page.screenshot(path=ARTIFACTS / "console-goals.png")
        rover.run(20.0)
        await expect(page.locator("[data-goal]")).to_have_count(0)
        await expect(page.get_by_text("commanded", exact=True)).to_be_hidden()

        await send(SubmitPlan(plan(SURVEY)))
        route = page.locator("[data-plan=survey]")
        numbers = route.locator("g g text")
        await expect(numbers).to_have_text(["1–2", "3", "4", "5"])
        await expect(route).to_have_class("waiting")
        await expect(route).to_contain_text("survey  not active")
        with monkeypatch.context() as patch:
            patch.setattr(rover.do(lambda bench: bench.executive.status), "_local_map", laser)
            await expect(page.locator(".map .scanned circle")).to_have_attribute("cx", "9")
            await page.screenshot(path=ARTIFACTS / "console-plan-waiting.png")
        await expect(page.locator(".map .scanned circle")).to_have_count(0)
        rover.run(3.0)
        await send(ActivatePlan("survey"))
        rover.run(1.0)
        await expect(route).to_have_class("active")
        await expect(route.locator(".present text")).to_have_text("1–2")
        rover.run(15.0)
        await expect(numbers).to_have_text(["3", "4", "5"])
        await expect(route.locator(".present text")).to_have_text("3")
        await expect(route).to_contain_text(re.compile(r"survey  ≥ \d+\.\d m  ≥ \d+ s left"))
        goal = page.locator("[data-goal=moveTo].active")
        await expect(goal).to_contain_text(re.compile(r"moveTo  \d\.\d m  ≥ \d s left"))
        taken = page.locator(".map [data-picture]")
        await expect(taken).to_have_attribute("data-picture", re.compile(r"^pictures/plan_survey-"))
        await page.get_by_role("button", name="show all").click()
        await taken.click()
        shown = page.get_by_role("figure")
        await expect(shown.locator("img")).to_have_js_property("complete", True)
        taken_by = re.compile("takePicture of plan:survey; [^;]* [56][0-9.]* m;")
        await expect(shown).to_contain_text(taken_by)
        await page.screenshot(path=ARTIFACTS / "console-plan.png")
        await page.keyboard.press("Escape")
        await expect(shown).to_be_hidden()
        await send(SuspendPlan("survey"))
        rover.run(1.0)
        await expect(route).to_have_class("waiting")
        await expect(route).to_contain_text("survey  suspended")

        begun_s = await page.evaluate(STARTED, "plan:survey")
        await page.evaluate(SHOW_PAST, begun_s + 1.0)
        await expect(page.get_by_text("(past)")).to_be_visible()
        await expect(route).to_have_class("active")
        await expect(numbers).to_have_text(["1–2", "3", "4", "5"])
        await expect(goal).to_have_count(1)
        await page.evaluate(SHOW_PAST, begun_s - 1.0)
        await expect(route).to_have_class("waiting")
        await expect(goal).to_have_count(0)

        await page.goto(page.url.partition("#")[0] + FILES)
        row = page.locator("tr:has(.thumbnail)").filter(has_text="plan_survey")
        await expect(row.locator("img.thumbnail")).to_have_js_property("naturalWidth", 640)
        await row.get_by_role("button", name="show").click()
        await expect(shown.locator("img")).to_have_js_property("naturalWidth", 640)
        await expect(row).to_be_in_viewport()
        await page.screenshot(path=ARTIFACTS / "console-pictures.png")
        await page.keyboard.press("Escape")
        await expect(shown).to_be_hidden()
        await page.evaluate("page => { location.hash = page }", CAMERA)
        await expect(page.get_by_test_id("camera-angles")).to_have_text("pan 0°  tilt 0°")
