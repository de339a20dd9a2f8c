"""The page of plans in a real browser: steps by clicks, checked, submitted, run and resumed."""

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from playwright.async_api import Locator, Page, async_playwright, expect

from tests.console.conftest import Launch
from tests.console.consoles import Operator, at_console
from tests.console.site import OPTIONS
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
    async with page_of_plans(tmp_path, rover.uri) as (_, page):
        operations = page.locator(".steps .what")
        picture = page.get_by_role("button", name="+ takePicture")
        for x_m, y_m in ((1.0, 1.0), (2.0, 0.0), (3.0, 1.0)):
            await click_map(page, x_m, y_m)
            await picture.click()
        check, outcome = page.get_by_test_id("plan-check"), page.get_by_test_id("plan-outcome")
        await expect(check).to_contain_text(re.compile(r"takes [0-9]+ s, [0-9.]+ m"))
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
        await page.locator(".side .suspendPlan").click()
        await expect(outcome).to_contain_text("suspendPlan: executed")
        await page.locator(".side .resumePlan").click()
        await expect(outcome).to_contain_text("resumePlan: executed")
        rover.runs = True
        await expect(page.locator(".aboard tr").filter(has_text="plan-1")).to_contain_text(
            "completed"
        )


def steps(page: Page) -> Locator:
    return page.locator(".steps .step")


async def click_map(page: Page, x_m: float, y_m: float) -> None:
    """Click a point of the map, with the rover at the origin in its centre."""
    picture = page.locator(".plans-view svg.map")
    box, scale = await picture.bounding_box(), await picture.get_attribute("data-scale")
    assert box is not None
    assert scale is not None
    x_px = box["x"] + box["width"] / 2 + x_m * float(scale)
    await page.mouse.click(x_px, box["y"] + box["height"] / 2 - y_m * float(scale))


@asynccontextmanager
async def page_of_plans(folder: Path, uri: str) -> AsyncIterator[tuple[Operator, Page]]:
    """Give the page of a rover's plans."""
    errors: list[str] = []
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    async with (
        at_console(folder, uri, "anna", topics=["link"]) as (anna,),
        async_playwright() as playwright,
    ):
        await anna.page.is_up()
        browser = await playwright.chromium.launch(executable_path=BROWSER, args=list(OPTIONS))
        page = await browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.goto(f"{anna.address}{ROVER}~plans{SHOWN}")
        await expect(page.locator(".plans-view [data-testid=rover]")).to_be_visible()
        yield anna, page
        await browser.close()
    assert errors == []
