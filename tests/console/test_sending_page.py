"""Sending from the page, in a real browser: the form, the list of commands, the keyboard."""

import asyncio
import json
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import (
    Locator,
    Page,
    ViewportSize,
    WebSocketRoute,
    expect,
)

from executive.commands import MoveForward, MoveTo, Waypoint
from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.console.site import SLOW, open_browser, open_whole
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
LAPTOP: ViewportSize = {"width": 1280, "height": 800}
OVERLAPS = """rows => rows.flatMap(row => {
    const names = [...row.querySelectorAll('.what, .when, .detail, .by')]
        .map(each => [each.textContent, each.getBoundingClientRect()])
        .filter(([, box]) => box.width > 0);
    return names.filter(([, box], index) => names.some(([, other], later) =>
        later > index && box.right > other.left + 0.5 && box.top < other.bottom - 1
        && other.top < box.bottom - 1)).map(([text]) => text);
})"""
CUT = "all => all.filter(each => each.scrollWidth > each.clientWidth).map(each => each.textContent)"


async def test_a_command_is_sent_once_and_previewed_from_where_the_rover_is(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with page_of(tmp_path, rover.uri) as page:
        await page.get_by_label("command", exact=True).select_option("moveTo")
        await page.get_by_label("x", exact=True).fill("3")
        await page.get_by_label("y", exact=True).fill("0")
        preview = page.get_by_test_id("preview")
        await expect(preview).to_contain_text("3.00 m")
        send = page.get_by_role("button", name="Send moveTo to jackal")
        await send.dblclick()
        await expect(commands(page)).to_have_count(1)
        await expect(send).to_be_disabled()
        await expect(preview).to_be_hidden()
        await expect(page.locator(".map .preview *")).to_have_count(0)
        rover.runs = True
        await expect(commands(page)).to_have_attribute("data-state", "executed")
        await page.get_by_role("button", name="again").click()
        await expect(preview).to_contain_text(re.compile(r" 0\.0. m"))
        await expect(send).to_be_enabled()
        await page.get_by_label("x", exact=True).fill("4")
        await expect(preview).to_contain_text(re.compile(r" (0\.9|1\.0). m"))
        await asyncio.to_thread(rover.carry_out, MoveForward(0.5))
        await expect(preview).to_contain_text(re.compile(r" 0\.[45]. m"))
        shown = page.get_by_label("only if it is where I see it: within 0.5 m and 11° of x 3.4")
        await expect(shown).not_to_be_checked()
        unseen = await behind_a_delay(page)
        await page.get_by_label("command", exact=True).select_option("rotateBy")
        await expect(shown).to_be_checked()
        await page.screenshot(path=ARTIFACTS / "console-precondition.png")
        await page.get_by_label("angle", exact=True).fill("30")
        unseen.append("tm")
        await asyncio.to_thread(rover.carry_out, MoveForward(2.0))
        async with page.expect_request("**/api/commands") as posted:
            await page.get_by_role("button", name="Send rotateBy to jackal").click()
        only_at = json.loads((await posted.value).post_data or "")["only_at"].split(" ")
        assert [round(float(each), 1) for each in only_at] == [3.5, 0.0, 0.5, 0.0, 0.2]
        outcome = page.get_by_test_id("outcome")
        await expect(outcome).to_contain_text(re.compile(r"rejected.* but [12]\.\d\d m away"))
        await shown.set_checked(False)
        await page.get_by_role("button", name="Send rotateBy to jackal").click()
        await expect(outcome).to_contain_text("executed")
        rover.runs = False
        angle = page.get_by_label("angle", exact=True)
        send = page.get_by_role("button", name="Send rotateBy to jackal")
        await angle.fill("5")
        await send.click()  # its end is not known
        await angle.fill("10")
        chained = page.get_by_label(re.compile(r"I see it.*, and after rotateBy \d+ is executed"))
        await chained.set_checked(True)
        text = await page.locator("label", has=chained).inner_text()
        async with page.expect_request("**/api/commands") as posted:
            await send.click()
        only_after = json.loads((await posted.value).post_data or "")["only_after"]
        assert f"and after rotateBy {only_after} is executed" in text


async def test_a_laptop_shows_six_commands_and_announces_new_ones(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    rover.runs = True
    target = MoveTo(Waypoint(-0.125, 0.375, 0.5))
    async with page_of(tmp_path, rover.uri) as page:
        await asyncio.to_thread(rover.carry_out, *[target] * 7)
        await expect(commands(page)).to_have_count(7)
        shown = page.locator(".commands-view .scroll")
        sixth = await commands(page).nth(5).bounding_box()
        whole = await shown.bounding_box()
        assert sixth is not None
        assert whole is not None
        assert sixth["y"] + sixth["height"] <= whole["y"] + whole["height"] + 1
        assert await commands(page).locator(".arguments").evaluate_all(CUT) == []
        await shown.evaluate("each => each.scrollTop = 60")
        await asyncio.to_thread(rover.carry_out, target)
        await page.get_by_role("button", name="↑ 1 new").click()
        await expect(page.get_by_test_id("new-commands")).to_be_hidden()
        await shown.evaluate("each => each.scrollTop = 60")
        await page.get_by_label("command", exact=True).select_option("moveForward")
        await page.get_by_label("distance", exact=True).fill("50 cm")
        await page.keyboard.press("Control+Enter")
        await expect(page.locator("[data-name=moveForward]")).to_be_in_viewport(ratio=0.9)
        await page.screenshot(path=ARTIFACTS / "console-laptop.png")
        await by_relay(page)
        await expect(commands(page).first.locator("[data-stage=FORWARDED]")).to_be_attached()
        for width, height in ((1280, 800), (853, 533), (1920, 1080)):  # as it is, at 150 %, large
            await page.set_viewport_size({"width": width, "height": height})
            assert await commands(page).evaluate_all(OVERLAPS) == []
        await page.screenshot(path=ARTIFACTS / "console-relay-rows.png")


async def test_keys_alone_send_a_command_and_open_its_explanation(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch(explains=True)
    rover.runs = True
    async with page_of(tmp_path, rover.uri) as page:
        keys = page.keyboard
        await keys.press("?")
        await expect(page.get_by_text("Ctrl+Enter in the form")).to_be_visible()
        await page.screenshot(path=ARTIFACTS / "console-shortcuts.png")
        await keys.press("Escape")
        await expect(page.get_by_text("Ctrl+Enter in the form")).to_be_hidden()
        await keys.press("Alt+C")
        await keys.type("moveT")
        for value in ("1", "0.5"):
            await keys.press("Tab")
            await keys.type(value)
        await keys.press("Enter")
        await expect(page.get_by_role("button", name="Send moveTo to jackal")).to_be_focused()
        await expect(commands(page)).to_have_count(0)
        await keys.press("Enter")
        await expect(commands(page)).to_have_attribute("data-state", "executed")
        await keys.press("Control+Space")
        await expect(page.get_by_test_id("mode")).to_have_text("STOPPED")
        await expect(commands(page)).to_have_count(2)
        await keys.press("Alt+L")
        await expect(page.locator(".command[data-name=stop] .head")).to_be_focused()
        await keys.press("ArrowDown")
        await keys.press("Enter")
        moved = page.locator(".command[data-name=moveTo]")
        await expect(moved.locator(".why-steps")).to_contain_text("was executed")
        await page.screenshot(path=ARTIFACTS / "console-why-by-keys.png")


@asynccontextmanager
async def page_of(folder: Path, uri: str, path: str = "") -> AsyncIterator[Page]:
    """Give the whole console of a rover on a small screen, as anna sees it."""
    async with (
        at_console(folder, uri, "anna") as (anna,),
        open_browser() as browser,
    ):
        page = await browser.new_page(viewport=LAPTOP)
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.add_init_script(
            f"{SLOW}sessionStorage.setItem('rover-console-operator', 'anna')"
        )
        await open_whole(page, f"{anna.address}{path}")
        await expect(page.get_by_test_id("value-POS_X")).to_have_text(re.compile("^-?[0-9.]+$"))
        yield page
        assert errors == []


def commands(page: Page) -> Locator:
    return page.locator(".command")


async def by_relay(page: Page) -> None:
    """Open the page again, with each command as if it were sent by the relay."""
    await with_messages(
        page, lambda each: each | ({"link": "relay"} if each["ty"] == "cmd" else {})
    )


async def behind_a_delay(page: Page) -> list[str]:
    """Open the page again on a link with a round trip of 10 s; return the types that it misses."""
    unseen: list[str] = []

    def changed(message: dict[str, Any]) -> dict[str, Any] | None:
        if message["ty"] in unseen:
            return None
        return message | ({"round_trip": 10.0} if message["ty"] == "link" else {})

    await with_messages(page, changed)
    return unseen


async def with_messages(
    page: Page, change: Callable[[dict[str, Any]], dict[str, Any] | None]
) -> None:
    """Open the page again; it receives each message as changed, if at all."""

    def relayed(socket: WebSocketRoute) -> None:
        server = socket.connect_to_server()
        server.on_message(lambda text: socket.send(json.dumps(changed(json.loads(text)))))

    def changed(messages: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [each for each in map(change, messages) if each is not None]

    await page.route_web_socket(re.compile("/ws$"), relayed)
    await page.reload()
    await page.locator("#operations").wait_for(state="detached")
