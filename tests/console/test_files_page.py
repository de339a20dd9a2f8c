"""Transfers of files on a page, in a real browser: interrupted, paused, resumed, opened."""

from pathlib import Path

import pytest
from playwright.async_api import async_playwright, expect

from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.console.site import OPTIONS
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
FILES = "#/browse/rover:rovers/rover:jackal/rover:jackal~files?hideInspector=true"


async def test_a_transfer_is_paused_resumed_and_opened(
    launch: Launch, drive: Path, tmp_path: Path
) -> None:
    rover = launch()
    rover.put("runs/drive.mcap", drive.read_bytes())
    errors: list[str] = []
    async with (
        at_console(tmp_path, rover.uri, "anna", topics=["link"]) as (anna,),
        async_playwright() as playwright,
    ):
        await anna.page.is_up()
        browser = await playwright.chromium.launch(executable_path=BROWSER, args=list(OPTIONS))
        page = await browser.new_page(viewport={"width": 1200, "height": 700})
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.goto(f"{anna.address}{FILES}")
        fetch = page.get_by_role("button", name="fetch", exact=True)
        await expect(fetch).to_be_visible()
        rover.hang_up()
        await anna.page.until(lambda said: said.get("state") == "down")
        await fetch.click()
        await expect(page.locator(".files-view .told")).to_contain_text("cannot be reached")
        rover.put("rock.txt", b"found while nobody heard of it")
        rover.listen()
        await anna.page.is_up()
        await expect(page.get_by_text("rock.txt")).to_be_visible()
        await page.locator("tr").filter(has_text="drive.mcap").get_by_role("button").click()
        transfer = page.locator("[data-path='runs/drive.mcap']")
        await expect(transfer).to_have_attribute("data-state", "done")
        await page.screenshot(path=ARTIFACTS / "console-transfer.png")
        await transfer.get_by_role("button", name="open").click()
        await expect(page.get_by_test_id("mode")).to_be_visible()
        await expect(page.get_by_role("combobox", name="rover")).to_have_value("jackal@drive")
        await browser.close()
    assert errors == []
