"""The alarms of a rover in a real browser: evidence, filters, shelving, and the page's title."""

import gzip
import re
import time
from pathlib import Path

import pytest
from playwright.async_api import expect

from executive.values.clock import START_UTC_S
from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.console.site import SLOW, open_browser, open_whole
from tests.console.test_alarms import BATTERY, FULL_V, LOW_V, VOLTAGE, is_alarm, show
from tests.console.test_relay_page import AHEAD, PAGE
from tests.console.test_theme_page import AXE, violations
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
NAMED = "if (origin !== 'null') sessionStorage.setItem('rover-console-operator', 'anna')"


async def test_an_operator_finds_evidence_shelves_and_acknowledges(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch(explains=True)
    rover.runs = True
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    errors: list[str] = []
    async with (
        at_console(tmp_path, rover.uri, "ben") as (ben,),
        open_browser() as browser,
    ):
        page = await browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme="dark")
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.add_init_script(SLOW + NAMED)
        await open_whole(page, f"{ben.address}{PAGE.format('jackal', 'alarms')}")
        await expect(page).to_have_title("jackal – Alarms")
        await ben.page.is_up()
        await ben.send("drive", "moveForward", distance=3.0)
        await ben.page.command("drive", "started")
        show(rover, LOW_V)
        view = page.locator(".l-shell .alarms-view")
        low, voltage = (view.locator(f"tr[data-source='{each}']") for each in (BATTERY, VOLTAGE))
        for row in (low, voltage):
            await expect(row).to_have_attribute("data-state", "active")
        await expect(page).to_have_title("(2) jackal – Alarms")
        await expect(low).to_contain_text("active, to acknowledge")

        first = low.locator(".time").first
        in_simulation_s = START_UTC_S - time.time()
        await page.evaluate(AHEAD, in_simulation_s)
        await expect(first).to_have_text(re.compile(r"^08:0\d:\d\d"))
        await low.get_by_role("button", name="evidence").focus()
        await page.keyboard.press("Enter")
        evidence = view.locator(".below")
        await expect(evidence.locator(".why-steps")).to_contain_text("battery voltage")
        await expect(evidence.locator(".entries")).to_contain_text("battery voltage")
        await page.screenshot(path=ARTIFACTS / "console-alarms.png")
        await page.evaluate(AHEAD, -in_simulation_s)
        await expect(first).to_have_text(re.compile(r"2027-01-15 08:0\d:\d\d"))
        await page.evaluate(gzip.decompress(AXE.read_bytes()).decode())
        assert await violations(page) == []
        await page.get_by_role("button", name="theme auto").click()
        assert await violations(page) == []
        await page.screenshot(path=ARTIFACTS / "console-alarms-light.png")
        await low.get_by_role("button", name="hide evidence").click()
        await expect(evidence).to_have_count(0)

        await view.get_by_label("find an alarm").fill("BATERY")
        await expect(low).to_have_count(0)
        await expect(voltage).to_be_visible()
        await view.get_by_label("find an alarm").fill("")
        await view.get_by_label("minimum severity").select_option("alarm and worse")
        await expect(voltage).to_have_count(0)
        await expect(low).to_be_visible()
        await view.get_by_label("minimum severity").select_option("all severities")

        await voltage.get_by_role("button", name="shelve …").click()
        await page.keyboard.type("charged at noon")
        await page.keyboard.press("Enter")
        await expect(voltage).to_have_count(0)
        await expect(page).to_have_title("(1) jackal – Alarms")
        state = view.get_by_label("state of the alarms")
        await state.select_option("shelved")
        shelved = re.compile("shelved by anna for another 1[45] min: charged at noon")
        await expect(voltage).to_contain_text(shelved)
        await page.evaluate(AHEAD, 900.0)
        await expect(page).to_have_title("(2) jackal – Alarms")
        await page.evaluate(AHEAD, -900.0)
        await expect(page).to_have_title("(1) jackal – Alarms")
        await voltage.get_by_role("button", name="end shelving").click()
        await expect(view).to_contain_text("No alarm matches these filters.")
        await state.select_option("open")

        seen = [
            [each["id"], each["occurrences"]] for each in (await ben.get("api/alarms"))["alarms"]
        ]
        await ben.post("api/alarms/acknowledge", alarms=seen[-1:])
        await ben.page.until(is_alarm(BATTERY, operator="ben"))
        await expect(view.get_by_text("acknowledged by ben")).to_be_visible()
        await expect(page).to_have_title("(1) jackal – Alarms")
        await view.get_by_role("button", name="acknowledge all shown").click()
        await expect(page).to_have_title("jackal – Alarms")
        show(rover, FULL_V)
        await expect(voltage).to_have_count(0)
        await state.select_option("open and closed")
        await expect(voltage).to_contain_text("closed, acknowledged by anna")
        await page.get_by_test_id("alarms").click()
        await expect(page.locator(".alarm-list .alarms-view tr[data-source]")).to_have_count(1)
    assert errors == []
