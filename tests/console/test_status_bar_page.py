"""The status bar in a real browser: STOP above all else, and lost links."""

import re
from pathlib import Path

import pytest
from playwright.async_api import Page, expect

from adapters.console.rovers import tracker
from tests.console.conftest import NEEDED, Launch
from tests.console.consoles import Operator, at_console
from tests.console.site import open_browser
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED
from tests.support.examples import ALL
from tests.support.plans import AHEAD, plan

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
NAMED = "sessionStorage.setItem('rover-console-operator', {name!r})"
SIZES = ((390, 844), (1280, 800), (1920, 1080))
OVERLAYS = {
    "Large View": "document.querySelector('[title=\"Large View\"]').click()",
    "menu": "document.querySelector('.c-create-button').click()",
    "form": """document.querySelector('.c-create-button').click();
        [...document.querySelectorAll('.c-menu li, .c-super-menu li')]
            .find(each => each.textContent.includes('Overlay Plot')).click()""",
    "confirm": """{
        const shown = openmct.overlays.dialog({ iconClass: 'alert', message: 'Remove it?',
            buttons: [{ label: 'OK', callback: () => shown.dismiss() }] });
    }""",
}
CLICK_BY_SCRIPT = """() => {
    const stop = document.querySelector('[data-testid=stop]');
    stop.hidden = true;
    document.body.click();
    stop.hidden = false;
}"""
MODAL = {"dialog": "document.body.appendChild(document.createElement('dialog')).showModal()"}
SHOWN = ".c-overlay, .c-menu, .c-super-menu, dialog[open]"
CLOSE = """() => {
    window.openmct?.overlays.dismissLastOverlay();
    document.body.click();
    document.querySelectorAll(".c-overlay__button-bar button").forEach(each => each.click());
    document.querySelectorAll("dialog").forEach(each => each.remove());
}"""
UNCOVERED = """() => {
    const { left, top, width, height } =
        document.querySelector("[data-testid=stop]").getBoundingClientRect();
    return left >= 0 && top >= 0 && left + width <= innerWidth && top + height <= innerHeight;
}"""


async def stops(anna: Operator) -> int:
    """Return how many stops the console knows."""
    return [each["name"] for each in (await anna.get("api/commands"))["commands"]].count("stop")


async def click_stop(page: Page) -> None:
    """Click at the position of STOP, also if it is covered."""
    assert await page.evaluate(UNCOVERED)
    box = await page.get_by_test_id("stop").bounding_box()
    assert box is not None
    async with page.expect_response("**/api/stop/jackal"):
        await page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


async def test_stop_is_above_all_overlays_and_dialogs(launch: Launch, tmp_path: Path) -> None:
    async with at_console(tmp_path, launch().uri, "anna") as (anna,), open_browser() as chromium:
        pressed = 0
        for path in ("", "lite"):
            page = await chromium.new_page()
            await page.goto(f"{anna.address}{path}")
            await expect(page.get_by_test_id("value-POS_X")).to_have_text("0")
            if not path:
                await expect(page.get_by_role("button", name="Large View").first).to_be_attached()
            await page.evaluate(CLICK_BY_SCRIPT)
            overlays = MODAL if path else OVERLAYS | MODAL
            for row, (width, height) in enumerate(SIZES):
                await page.set_viewport_size({"width": width, "height": height})
                for column, (name, show) in enumerate(overlays.items()):
                    if not ALL and (row + column) % len(SIZES):
                        continue
                    await page.evaluate(show)
                    shown = page.locator(SHOWN).first
                    await expect(shown).to_be_attached()
                    await click_stop(page)
                    pressed += 1
                    assert await stops(anna) == pressed, f"/{path}, {width} px, {name}"
                    await expect(shown).to_be_attached()
                    await page.evaluate(CLOSE)
                    await expect(page.locator(SHOWN)).to_have_count(0)
                await page.get_by_test_id("alarms").click()
                await click_stop(page)
                pressed += 1
                assert await stops(anna) == pressed, f"/{path}, {width} px, alarms"
                await page.screenshot(path=ARTIFACTS / f"stop{path and '-lite'}-{width}.png")
                await page.get_by_test_id("alarms").click()
            await page.close()


async def test_a_lost_link_is_an_alarm_and_its_stop_is_repeated(
    launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracker, "REPORT_TIMEOUT_S", 1.0)
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna") as (anna,), open_browser() as chromium:
        page = await chromium.new_page(viewport={"width": 1280, "height": 800})
        await page.goto(f"{anna.address}lite")
        bar, mode = page.locator(".rover-bar"), page.get_by_test_id("mode")
        drive = page.locator(".command[data-name=moveForward]")
        await expect(mode).to_have_text("IDLE")
        await anna.send("drive", "moveForward", distance=5.0)
        rover.run(1.0)
        await expect(mode).to_have_text("MOVING")
        await expect(drive).to_have_attribute("data-state", "started")
        rover.hang_up()

        banner = bar.get_by_text("No link to jackal for")
        await expect(banner).to_contain_text("Last state: MOVING moveForward. STOP is sent")
        await expect(mode).to_have_attribute("data-stale", "true")
        await expect(mode).to_have_text(re.compile(r"^MOVING \d+ s ago$"))
        await expect(drive).to_have_attribute("data-state", "unknown")
        await expect(page).to_have_title(re.compile(r"^⚠ no link \(1\) "))
        await page.get_by_test_id("alarms").click()
        alarm = bar.locator("tr[data-source='link direct']")
        await expect(alarm).to_have_attribute("data-state", "active")
        await expect(alarm).to_contain_text("the direct link is lost")
        await page.screenshot(path=ARTIFACTS / "link-lost.png")

        await click_stop(page)
        waiting = bar.get_by_text("no answer of jackal for")
        await expect(waiting).to_be_visible()
        await page.reload()
        await expect(waiting).to_be_visible()
        await page.screenshot(path=ARTIFACTS / "stop-repeated.png")
        await bar.get_by_role("button", name="call off").click()
        await expect(bar.get_by_text("called off by")).to_be_visible()
        await expect(waiting).to_be_hidden()
        rover.listen()
        await expect(drive).to_have_attribute("data-state", "started")
        await expect(banner).to_be_hidden()
        await expect(mode).to_have_attribute("data-stale", "false")
        await page.get_by_test_id("alarms").click()
        await expect(alarm).to_have_attribute("data-state", "cleared")
        notices = (await anna.get("api/notifications", asset="jackal"))["notifications"]
        texts = [each["text"] for each in notices if each["link"] == "console"]
        assert texts[0] == "the direct link is up"
        assert texts[1].startswith("the direct link is lost: ")

        rover.hang_up()
        await expect(banner).to_be_visible()
        await page.keyboard.press("F8")
        await expect(waiting).to_be_visible()
        rover.listen()
        await expect(bar.get_by_text("reached jackal")).to_be_visible()
        await expect(waiting).to_be_hidden()
        rover.run(1.0)
        await expect(mode).to_have_text("STOPPED")
        await expect(drive).to_have_attribute("data-state", "cancelled")


async def test_one_button_continues_a_stopped_plan(launch: Launch, tmp_path: Path) -> None:
    rover = launch(authority=NEEDED)
    async with at_console(tmp_path, rover.uri, "anna") as (anna,), open_browser() as chromium:
        page, other = [await chromium.new_page() for _ in range(2)]
        for each, name in ((page, "anna"), (other, "bert")):
            await each.add_init_script(NAMED.format(name=name))
            await each.goto(f"{anna.address}lite")
        bar, mode = page.locator(".rover-bar"), page.get_by_test_id("mode")
        await bar.get_by_role("button", name="request", exact=True).click()
        await expect(bar.get_by_test_id("holder")).to_have_text("you command")
        content = plan(AHEAD).content.decode()
        await anna.post("api/plans/jackal", id="plan", plan_id="survey", content=content)
        await anna.page.command("plan", "executed")
        await anna.send("run", "activatePlan", plan_id="survey")
        await anna.page.command("run", "executed")
        rover.run(1.0)
        await expect(mode).to_have_text("PLAN")

        await other.keyboard.press("F8")
        await expect(mode).to_have_text("STOPPED")
        await expect(bar.locator(".doing")).to_have_text("stopped by bert")
        rover.run(0.5)
        await bar.get_by_role("button", name="release the stop").click()
        await expect(bar.get_by_text("Sent to jackal: release the stop.")).to_be_visible()
        rover.run(0.5)
        await expect(mode).to_have_text("PAUSED")
        await bar.get_by_role("button", name="resume plan survey").click()
        await expect(page.locator(".command[data-name=resumePlan]")).to_be_visible()
        rover.run(0.5)
        await expect(mode).to_have_text("PLAN")
        await expect(bar.locator(".resume")).to_be_hidden()

        theirs = other.locator(".rover-bar")
        await expect(theirs.get_by_role("button", name="take")).to_be_hidden()
        await theirs.get_by_role("button", name="request", exact=True).click()
        await expect(theirs.get_by_text("Requested from anna")).to_be_visible()
        await expect(bar.get_by_text("bert requests the authority")).to_be_visible()
        await page.screenshot(path=ARTIFACTS / "authority-requested.png")
        await bar.get_by_role("button", name="hand over to bert").click()
        await expect(theirs.get_by_test_id("holder")).to_have_text("you command")
