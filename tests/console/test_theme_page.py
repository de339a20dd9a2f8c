"""The light and the dark theme in a real browser, and their accessibility by axe-core."""

import gzip
from pathlib import Path

import pytest
from playwright.async_api import Page, async_playwright, expect

from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.console.site import OPTIONS
from tests.support.browser import BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
AXE = Path(__file__).parent / "vendor" / "axe-core" / "axe.min.js.gz"
VIOLATIONS = """async () => {
    const own = { include: [".rover-bar", ".rover-view"] };
    const found = await axe.run(own, { runOnly: ["wcag2a", "wcag2aa"] });
    return found.violations.filter(each => ["serious", "critical"].includes(each.impact))
        .flatMap(each => each.nodes.map(node => `${each.id}: ${node.html}`));
}"""
BACKGROUND = "getComputedStyle(document.querySelector('.rover-bar')).backgroundColor"


async def violations(page: Page) -> list[str]:
    found: list[str] = await page.evaluate(VIOLATIONS)
    return found


async def test_both_themes_are_accessible(launch: Launch, tmp_path: Path) -> None:
    axe = gzip.decompress(AXE.read_bytes()).decode()
    async with (
        at_console(tmp_path, launch().uri, "anna") as (anna,),
        async_playwright() as playwright,
    ):
        browser = await playwright.chromium.launch(executable_path=BROWSER, args=list(OPTIONS))
        for path in ("lite", ""):
            page = await browser.new_page(color_scheme="dark")
            await page.goto(f"{anna.address}{path}")
            await expect(page.get_by_test_id("value-POS_X")).to_have_text("0")
            await page.evaluate(axe)
            colours = []
            for name in ("auto", "light", "dark"):
                await expect(page.get_by_role("button", name=f"theme {name}")).to_be_visible()
                colours.append(await page.evaluate(BACKGROUND))
                assert await violations(page) == [], f"/{path}, theme {name}"
                await page.get_by_role("button", name=f"theme {name}").click()
            assert colours[0] == colours[2] != colours[1]
            await page.close()
        await browser.close()
