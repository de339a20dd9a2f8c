"""The page of the relay in a real browser: an eclipse, through the orbiter and a console."""

import re
from pathlib import Path

import pytest
from playwright.async_api import async_playwright, expect

from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.console.site import OPTIONS
from tests.relay.orbiter.sky import Clock, Sky, eclipse, landed, orbiting
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
PAGE = "#/browse/rover:rovers/rover:{0}/rover:{0}~{1}?hideInspector=true"


async def test_a_command_is_seen_to_wait_for_the_contact_and_to_go_up_with_it(
    launch: Launch, tmp_path: Path
) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    errors: list[str] = []
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    async with (
        orbiting(sky, clock, eclipse(clock)) as (_, (station,)),
        landed(sky, "jackal"),
        at_console(tmp_path, [str(station.uri), launch("scout").uri], "anna") as (anna,),
        async_playwright() as playwright,
    ):
        browser = await playwright.chromium.launch(executable_path=BROWSER, args=list(OPTIONS))
        page = await browser.new_page(viewport={"width": 1200, "height": 700})
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.goto(f"{anna.address}{PAGE.format('scout', 'dtn')}")
        await expect(page.get_by_text("No orbiter is known by which scout is")).to_be_visible()
        await page.goto(f"{anna.address}{PAGE.format('rover-console', 'values')}")
        await expect(page.get_by_test_id("value-CONSOLE_PAGES")).to_have_text("2")
        await expect(page.get_by_test_id("value-CONSOLE_LOST")).to_have_text("0")
        rovers = page.get_by_role("combobox", name="rover")
        await expect(rovers.locator("option")).to_have_text(["jackal", "scout"])
        await page.screenshot(path=ARTIFACTS / "console-own.png")
        await page.goto(f"{anna.address}{PAGE.format('jackal', 'dtn')}")
        way = page.locator("[data-part=bundles]")
        await expect(way).to_contain_text(re.compile("no contact.*next at .* in (60 min|1 h)"))
        await expect(way).to_have_attribute("data-open", "false")
        await anna.send("waits", "moveForward", distance=2.0)
        command = page.locator("tr[data-id=waits]")
        await expect(command).to_contain_text("waits at the orbiter for")
        station.tell_health()
        await expect(page.get_by_test_id("DTN_QUEUED")).to_have_text("1")
        await expect(page.locator("[data-strip=DTN_CONTACTS_UP] [data-contact]")).to_have_count(1)
        await page.screenshot(path=ARTIFACTS / "console-relay.png")
        clock.shift_s = 3601.0
        await expect(command).to_have_count(0)
        station.tell_health()
        await expect(way).to_have_attribute("data-open", "true")
        for counter in ("DTN_SENT", "DTN_ACKNOWLEDGED"):
            await expect(page.get_by_test_id(counter)).to_have_text("1")
        await expect(page.get_by_test_id("DTN_QUEUED")).to_have_text("0")
        await browser.close()
    assert errors == []
