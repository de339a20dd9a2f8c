"""The light and the dark theme in a real browser, and their accessibility by axe-core."""

import gzip
import re
from pathlib import Path
from typing import Final, Literal

import pytest
from playwright.async_api import Page, expect

from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.console.site import open_browser, open_whole
from tests.support.browser import BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
AXE = Path(__file__).parent / "vendor" / "axe-core" / "axe.min.js.gz"
VIOLATIONS = """async () => {
    const own = { include: [".rover-bar", ".rover-view", ".rover-page"] };
    const found = await axe.run(own, { runOnly: ["wcag2a", "wcag2aa"] });
    return found.violations.filter(each => ["serious", "critical"].includes(each.impact))
        .flatMap(each => each.nodes.map(node => `${each.id}: ${node.html}`));
}"""
BACKGROUND = "getComputedStyle(document.querySelector('.rover-bar')).backgroundColor"
VIEW = "#/browse/rover:rovers/rover:jackal/rover:jackal~{}?hideInspector=true"
SCHEMES: Final[tuple[Literal["light", "dark"], ...]] = ("light", "dark")
VIEWS = {
    "layout": "form-view",
    "plans": "plans-view",
    "alarms": "alarms-view",
    "files": "files-view",
    "strip": "strip-view",
    "video": "video-view",
    "dtn": "dtn-view",
    "log": "log-view",
    "tree": "tree-view",
}
"""Classes of the views by the kind of the page."""


async def test_nine_pages_and_the_light_one_are_accessible_in_both_themes(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    axe = gzip.decompress(AXE.read_bytes()).decode()
    async with (
        at_console(tmp_path, rover.uri, "anna") as (anna,),
        open_browser() as browser,
    ):
        await anna.send("far", "moveForward", distance=9.0)
        rover.run(2.0)  # stages that are not reached
        await anna.page.command("far", "started")
        context = await browser.new_context(color_scheme="dark", reduced_motion="reduce")
        page = await context.new_page()
        await page.goto(f"{anna.address}lite")
        await expect(page.get_by_test_id("value-POS_X")).to_have_text(re.compile("[0-9]"))
        for title in ("Log", "Plans", "Camera"):
            await page.locator("summary").get_by_text(title, exact=True).click()
        await expect(page.locator(".log-view, .plans-view, .video-view")).to_have_count(3)
        await page.evaluate(axe)
        colours = []
        for name in ("auto", "light", "dark"):
            await expect(page.get_by_role("button", name=f"theme {name}")).to_be_visible()
            colours.append(await page.evaluate(BACKGROUND))
            assert await violations(page) == [], f"/lite, theme {name}"
            await page.get_by_role("button", name=f"theme {name}").click()
        assert colours[0] == colours[2] != colours[1]
        await open_whole(page, anna.address)
        await page.evaluate(axe)
        for kind, view in VIEWS.items():
            await page.evaluate("hash => { location.hash = hash }", VIEW.format(kind))
            await expect(page.locator(f".{view}")).to_be_visible()
            for scheme in SCHEMES:
                await page.emulate_media(color_scheme=scheme)
                assert await violations(page) == [], f"{kind}, {scheme}"
        assert await page.evaluate("document.getAnimations().length") == 0


async def violations(page: Page) -> list[str]:
    found: list[str] = await page.evaluate(VIOLATIONS)
    return found
