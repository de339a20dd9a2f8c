"""The page of plans in a real browser: steps by clicks, checked, submitted, run and resumed."""

import asyncio
import gzip
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from playwright.async_api import Locator, Page, expect

from tests.console.conftest import Launch
from tests.console.consoles import Operator, at_console, served
from tests.console.site import open_browser, open_whole
from tests.console.test_theme_page import AXE, violations
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
ROVER = "#/browse/rover:rovers/rover:jackal/rover:jackal"
SHOWN = "?hideInspector=true"


async def test_a_plan_is_made_by_clicks_and_resumed_at_a_step(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with (
        page_of_plans(tmp_path, rover.uri) as (_, page),
        served(tmp_path / "second", rover.uri) as second,
    ):
        operations = page.locator(".steps .what")
        picture = page.get_by_role("button", name="+ takePicture")
        for x_m, y_m in ((1.0, 1.0), (2.0, 0.0), (3.0, 1.0)):
            await click_map(page, x_m, y_m)
            await picture.click()
        check, outcome = page.get_by_test_id("plan-check"), page.get_by_test_id("plan-outcome")
        await expect(check).to_contain_text(re.compile(r"takes [0-9.]+ s, [0-9.]+ m"))
        name = page.get_by_label("name of the plan")
        await expect(name).to_have_css("font-weight", "700")  # our styles, not Open MCT's
        await expect(operations).to_have_text(["moveTo", "takePicture"] * 3)
        await expect(steps(page).first).to_contain_text(re.compile(r"x (1|1\.0.|0\.9.) "))
        await page.screenshot(path=ARTIFACTS / "console-plan.png")
        await steps(page).nth(5).locator(".handle").drag_to(steps(page).nth(4))
        await expect(steps(page).nth(4)).to_contain_text("takePicture")
        await page.get_by_role("button", name="move up step 6").click()
        await expect(operations).to_have_text(["moveTo", "takePicture"] * 3)

        await page.get_by_role("button", name="Submit to jackal").click()
        await expect(outcome).to_contain_text("plan-1 submitted: 6 leaves")
        await page.locator(".side .activatePlan").click()
        await expect(outcome).to_contain_text("activatePlan: executed")
        await asyncio.to_thread(rover.run, 2.0)
        await expect(steps(page).first).to_have_attribute("data-state", "active")

        other = await page.context.new_page()
        await open_whole(other, f"{second}{ROVER}~layout{SHOWN}")
        strip = other.get_by_test_id("plan-strip")
        await expect(strip).to_contain_text(re.compile("plan-1executing.*step 1 of 6: moveTo"))
        await expect(strip).to_contain_text(re.compile("[0-9]+ s left"))
        await expect(other.locator(".map [data-plan=plan-1].active")).to_be_attached()
        await strip.get_by_role("button", name="suspend").click()
        await expect(strip).to_contain_text("suspended")
        await expect(steps(page).first).to_have_attribute("data-state", "held")
        await is_accessible(page)

        await steps(page).nth(3).get_by_role("button", name="resume here").click()
        await expect(outcome).to_contain_text("resumePlan: executed")
        await asyncio.to_thread(rover.run, 0.2)
        await expect(strip).to_contain_text(re.compile("executing.*step [45] of 6"))
        rover.runs = True
        row = page.locator(".aboard tr").filter(has_text="plan-1")
        await expect(row).to_contain_text("completed")
        await expect(page.locator(".steps [data-state=done]")).to_have_count(6)
        await expect(strip).to_be_empty()


async def test_refusals_are_shown_beside_steps_and_typed_text_remains(
    launch: Launch, tmp_path: Path
) -> None:
    async with page_of_plans(tmp_path, launch().uri) as (anna, page):
        check, outcome = page.get_by_test_id("plan-check"), page.get_by_test_id("plan-outcome")
        await click_map(page, 1.0, 0.0)
        await page.get_by_label("add a step").select_option("moveForward")
        await expect(steps(page).nth(1)).to_contain_text("fill in distance")
        await page.get_by_label("distance", exact=True).fill("500")
        await expect(steps(page).nth(1).locator("> .problem")).to_contain_text("distance")
        await expect(check).to_contain_text("Step 2: ")
        await page.get_by_label("distance", exact=True).fill("1")
        await page.get_by_label("step name").fill("ahead")
        await page.get_by_label("step deadline").fill("soon")
        await expect(check).to_contain_text("seconds are needed")
        await page.get_by_label("step deadline").fill("30")
        await expect(check).to_contain_text("Valid")
        await page.get_by_role("button", name="save draft").click()
        await expect(outcome).to_contain_text("draft plan-1 is stored")
        await is_accessible(page)

        await page.get_by_role("button", name="XML", exact=True).click()
        text = page.get_by_label("plan", exact=True)
        await expect(text).to_have_value(re.compile('<moveForward name="ahead" distance="1"'))
        await text.fill("<root><takePictur/></root>")
        await page.evaluate(f"location.hash = '{ROVER}~map{SHOWN}'")
        await expect(text).to_be_hidden()
        await page.evaluate(f"location.hash = '{ROVER}~plans{SHOWN}'")
        await expect(text).to_have_value("<root><takePictur/></root>")
        await page.get_by_role("button", name="Submit to jackal").click()
        await expect(outcome).to_contain_text("submitPlan: rejected")
        await click_map(page, 2.0, 0.0)
        await page.reload()
        await expect(text).to_have_value("<root><takePictur/></root>")
        await is_accessible(page)

        await page.get_by_label("open a plan").select_option(label="look-around")
        await expect(page.get_by_text("This plan is no list of steps")).to_be_visible()
        await page.get_by_label("open a plan").select_option(label="plan-1")
        await expect(steps(page).nth(1)).to_contain_text("ahead")
        await drag_on_map(page, (1.0, 0.0), (1.0, 2.0))
        await expect(steps(page).first).to_contain_text(re.compile(r"y (2|2\.0.|1\.9.)"))
        await page.get_by_role("button", name="undo").click()
        await page.get_by_role("button", name="delete draft").click()
        await expect(outcome).to_contain_text("deleted")
        stored = await anna.get("api/objects")
        assert [each for each in stored["objects"] if each["key"].startswith("plan")] == []


async def test_waits_questions_and_conditions_are_steps(launch: Launch, tmp_path: Path) -> None:
    async with page_of_plans(tmp_path, launch().uri) as (_, page):
        check, palette = page.get_by_test_id("plan-check"), page.get_by_label("add a wait")
        await click_map(page, 1.0, 0.0)
        await palette.select_option("Ask")
        await expect(steps(page).nth(1)).to_contain_text("fill in question, options")
        for field, value in QUESTION.items():
            await page.get_by_label(field, exact=True).fill(value)
        await expect(check).to_contain_text("Valid")
        await page.get_by_role("button", name="+ takePicture").click()
        await page.get_by_text("conditions and scripts").click()
        await page.get_by_label("step skip if").fill("choise != 'cross'")
        await expect(steps(page).nth(2).locator("> .problem")).to_contain_text(
            "nothing sets choise"
        )
        await page.get_by_label("step skip if").fill("choice != 'cross'")
        await page.get_by_label("step only if").fill("@BATERY_VOLTAGE > 22")
        await page.get_by_label("step else").select_option("SKIPPED")
        await expect(check).to_contain_text("Valid")
        await palette.select_option("WaitFor")
        await page.get_by_label("if", exact=True).fill("@LINK_UP")
        await page.get_by_label("deadline_s", exact=True).fill("60")
        await expect(steps(page).nth(3)).to_contain_text("if @LINK_UP")
        await expect(check).to_contain_text("Valid")
        await is_accessible(page)
        await page.screenshot(path=ARTIFACTS / "console-plan-conditions.png")
        shown = await steps(page).all_inner_texts()
        await page.get_by_role("button", name="XML", exact=True).click()
        text = page.get_by_label("plan", exact=True)
        guarded = '<Precondition if="@BATERY_VOLTAGE &gt; 22" else="SKIPPED"><takePicture '
        await expect(text).to_have_value(re.compile(guarded))
        await text.fill(f"{await text.input_value()}<!-- typed -->")
        await expect(check).to_contain_text("Valid")
        await page.get_by_role("button", name="steps", exact=True).click()
        await expect(steps(page)).to_have_count(4)
        await steps(page).nth(3).get_by_role("button", expanded=False).click()
        await expect(steps(page).nth(2)).to_contain_text("skip if choice != 'cross'")
        assert await steps(page).all_inner_texts() == shown

        checks = page.get_by_test_id("plan-checks")
        await steps(page).nth(2).get_by_role("button", expanded=False).click()
        await page.get_by_label("step skip if").fill("choice != 'cros'")
        await page.get_by_role("button", name="check", exact=True).click()
        await expect(checks).to_contain_text("check: probable faults")
        await expect(steps(page).nth(2).locator("> .finding")).to_contain_text("mean cross?")
        await is_accessible(page)
        await page.screenshot(path=ARTIFACTS / "console-plan-check.png")
        await page.get_by_label("step skip if").fill("choice != 'cross'")
        await expect(checks).to_be_hidden()
        await expect(steps(page).nth(2).locator("> .finding")).to_be_empty()
        await page.get_by_role("button", name="prove", exact=True).click()
        await expect(checks).to_contain_text(re.compile("prove: proved, [0-9]+ states"))


async def test_nodes_of_a_running_plan_are_shown_and_steered(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with page_of_plans(tmp_path, rover.uri) as (_, page):
        await page.get_by_role("button", name="XML", exact=True).click()
        await page.get_by_label("name of the plan").fill("day")
        await page.get_by_label("plan", exact=True).fill(CONTINGENT)
        await expect(page.get_by_test_id("plan-check")).to_contain_text("Valid")
        await page.get_by_role("button", name="outline").click()
        await expect(page.get_by_text("This plan is no list of steps")).to_be_visible()
        names = page.locator(".node .what")
        await expect(names).to_have_text(["Fallback", "Sequence", "noon", "hills", "moveTo"])
        await expect(node(page, "noon")).to_contain_text("utc 1.9e+09")
        await node(page, "hills").get_by_role("button", name="open hills").click()
        await expect(names).to_have_count(6)
        await page.get_by_role("button", name="Submit to jackal").click()
        outcome = page.get_by_test_id("plan-outcome")
        await expect(outcome).to_contain_text("day submitted")
        await page.locator(".side .activatePlan").click()
        await expect(outcome).to_contain_text("activatePlan: executed")
        await asyncio.to_thread(rover.run, 0.5)
        row = page.locator(".aboard tr").filter(has_text="day")
        await row.get_by_role("button", name="nodes").click()
        await expect(node(page, "noon")).to_have_attribute("data-status", "running")
        await expect(node(page, "noon")).to_contain_text("waits until 2030-03-17 17:46:40 UTC")
        await node(page, "moveTo").get_by_role("button", name="hold before").click()
        await expect(outcome).to_contain_text("holdAtNode: executed")
        await node(page, "noon").get_by_role("button", name="skip").click()
        await is_accessible(page)
        await page.screenshot(path=ARTIFACTS / "console-plan-nodes.png")
        await node(page, "noon").get_by_role("button", name="as failure").click()
        await expect(outcome).to_contain_text("skipNode: executed")
        await asyncio.to_thread(rover.run, 0.3)
        await expect(node(page, "noon")).to_contain_text("skipped with FAILURE")
        await expect(row).to_contain_text("suspended")
        await expect(row).to_contain_text("held at plan:day/Fallback/moveTo")
        await expect(node(page, "moveTo").get_by_role("button", name="skip")).to_be_visible()
        await row.get_by_role("button", name="abort").click()
        await expect(node(page, "moveTo").get_by_role("button", name="skip")).to_have_count(0)
        await page.get_by_role("button", name="nodes of day, aborted").click()
        await expect(page.get_by_text("This plan is no list of steps")).to_be_visible()


CONTINGENT = """<root BTCPP_format="4" main_tree_to_execute="Day">
  <BehaviorTree ID="Day"><Fallback>
    <Sequence><WaitUntil name="noon" utc="1900000000"/><SubTree ID="Hills" name="hills"/></Sequence>
    <moveTo x="1" y="0" deadline_s="60"/>
  </Fallback></BehaviorTree>
  <BehaviorTree ID="Hills"><takePicture deadline_s="20"/></BehaviorTree>
</root>"""


def node(page: Page, name: str) -> Locator:
    return page.locator(f'.node[data-node$="/{name}"]')


QUESTION = {
    "question": "cross the ditch?",
    "options": "cross;stay",
    "default": "stay",
    "deadline_s": "600",
    "answer": "{choice}",
}


def steps(page: Page) -> Locator:
    return page.locator(".steps .step")


async def is_accessible(page: Page) -> None:
    for scheme in ("dark", "light"):
        await page.emulate_media(color_scheme=scheme)
        assert await violations(page) == [], scheme


async def on_map(page: Page, x_m: float, y_m: float) -> tuple[float, float]:
    """Return the px of a point of the map, with the rover at the origin in its centre."""
    picture = page.locator(".plans-view svg.map")
    box, scale = await picture.bounding_box(), await picture.get_attribute("data-scale")
    assert box is not None
    assert scale is not None
    x_px = box["x"] + box["width"] / 2 + x_m * float(scale)
    return x_px, box["y"] + box["height"] / 2 - y_m * float(scale)


async def click_map(page: Page, x_m: float, y_m: float) -> None:
    await page.mouse.click(*await on_map(page, x_m, y_m))


async def drag_on_map(page: Page, start: tuple[float, float], end: tuple[float, float]) -> None:
    await page.mouse.move(*await on_map(page, *start))
    await page.mouse.down()
    await page.mouse.move(*await on_map(page, *end), steps=3)
    await page.mouse.up()


@asynccontextmanager
async def page_of_plans(folder: Path, uri: str) -> AsyncIterator[tuple[Operator, Page]]:
    """Give the page of a rover's plans."""
    errors: list[str] = []
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    async with (
        at_console(folder, uri, "anna", topics=["link"]) as (anna,),
        open_browser() as browser,
    ):
        await anna.page.is_up()
        context = await browser.new_context(viewport={"width": 1280, "height": 800})
        page = await context.new_page()
        await page.add_init_script(gzip.decompress(AXE.read_bytes()).decode())
        page.on("pageerror", lambda error: errors.append(str(error)))
        await open_whole(page, f"{anna.address}{ROVER}~plans{SHOWN}")
        await expect(page.locator(".plans-view [data-testid=rover]")).to_be_visible()
        yield anna, page
    assert errors == []
