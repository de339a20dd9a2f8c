"""Transfers of files on a page, in a real browser: interrupted, paused, resumed, opened."""

import asyncio
import re
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from itertools import repeat
from pathlib import Path

import pytest
from playwright.async_api import Page, expect

from tests.console.conftest import Launch
from tests.console.consoles import Operator, at_console
from tests.console.site import open_browser
from tests.console.test_files import OCTETS
from tests.mrs.aboard import Aboard
from tests.mrs.test_file_retrieval import cutting
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
FILES = "#/browse/rover:rovers/rover:jackal/rover:jackal~files?hideInspector=true"


async def test_a_transfer_is_paused_and_resumed(launch: Launch, tmp_path: Path) -> None:
    rover = launch()
    rover.put("rock.raw", OCTETS)
    resumed = asyncio.Event()

    def budgets() -> Iterator[int | None]:
        yield from (None, 1_000_000)
        while not resumed.is_set():
            yield 0
        yield from repeat(None)

    async with page_of_files(tmp_path, rover, budgets()) as (_, page):
        await page.get_by_role("button", name="fetch", exact=True).click()
        transfer = page.locator("[data-path='rock.raw']")
        await expect(transfer).to_have_attribute("data-state", "interrupted")
        await expect(transfer).to_contain_text(re.compile("of 3 MB"))
        await expect(transfer.get_by_role("progressbar")).to_be_visible()
        await page.screenshot(path=ARTIFACTS / "console-transfer.png")
        await transfer.get_by_role("button", name="pause").click()
        await expect(transfer).to_have_attribute("data-state", "paused")
        resumed.set()
        await transfer.get_by_role("button", name="resume").click()
        await expect(transfer).to_have_attribute("data-state", "done")
        await transfer.get_by_role("button", name="clear").click()
        await expect(transfer).to_have_count(0)


async def test_files_aboard_are_listed_again_and_a_recording_opened(
    launch: Launch, drive: Path, tmp_path: Path
) -> None:
    rover = launch()
    rover.put("runs/drive.mcap", drive.read_bytes())
    async with page_of_files(tmp_path, rover, repeat(None)) as (anna, page):
        fetch = page.get_by_role("button", name="fetch", exact=True)
        await expect(fetch).to_be_visible()
        rover.hang_up()
        await anna.page.until(lambda message: message.get("state") == "down")
        await fetch.click()
        await expect(page.locator(".files-view .message")).to_contain_text("cannot be reached")
        rover.put("rock.txt", b"found while nobody heard of it")
        rover.listen()
        await anna.page.is_up()
        await expect(page.get_by_text("rock.txt")).to_be_visible()
        await page.locator("tr").filter(has_text="drive.mcap").get_by_role("button").click()
        transfer = page.locator("[data-path='runs/drive.mcap']")
        await expect(transfer).to_have_attribute("data-state", "done")
        await transfer.get_by_role("button", name="open").click()
        await expect(page.get_by_test_id("mode")).to_be_visible()
        await expect(page.get_by_role("combobox", name="rover")).to_have_value("jackal@drive")


@asynccontextmanager
async def page_of_files(
    folder: Path, rover: Aboard, budgets: Iterator[int | None]
) -> AsyncIterator[tuple[Operator, Page]]:
    """Give the page of a rover's files, over a link that is cut after so many octets."""
    errors: list[str] = []
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    async with (
        cutting(rover.uri, budgets) as (address, _),
        at_console(folder, address, "anna", topics=["link"]) as (anna,),
        open_browser() as browser,
    ):
        await anna.page.is_up()
        page = await browser.new_page(viewport={"width": 1200, "height": 700})
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.goto(f"{anna.address}{FILES}")
        yield anna, page
    assert errors == []
