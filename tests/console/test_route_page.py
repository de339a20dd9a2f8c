"""Commands and plans of other clients on the map, in a real browser."""

import re
from pathlib import Path

import pytest
from playwright.async_api import async_playwright, expect

from adapters.mrs.ground import MrsClient
from executive.commands import MoveForward, MoveTo, Waypoint
from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.console.site import OPTIONS
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
MAP = "#/browse/rover:rovers/rover:jackal/rover:jackal~map?hideInspector=true"


async def test_the_map_shows_the_goals_of_another_client(launch: Launch, tmp_path: Path) -> None:
    rover = launch()
    errors: list[str] = []
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    async with (
        at_console(tmp_path, rover.uri, "anna") as (anna,),
        await MrsClient.connect(rover.uri) as terminal,
        async_playwright() as playwright,
    ):
        browser = await playwright.chromium.launch(executable_path=BROWSER, args=list(OPTIONS))
        page = await browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.goto(f"{anna.address}{MAP}")
        await anna.page.is_up()
        for request in (MoveTo(Waypoint(3.0, 1.0)), MoveForward(1.0)):
            await terminal.submit(terminal.command(request, source="TER"))
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
        await browser.close()
    assert errors == []
