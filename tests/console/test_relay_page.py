"""A rover behind an orbiter in a real browser: an eclipse, and both links at once."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.async_api import expect

from adapters.bundle import ContactPlan
from adapters.mops import LinkHealth
from executive.values.parameters import Parameter, ParameterValue
from tests.console.conftest import Launch
from tests.console.consoles import ALL, at_console, served
from tests.console.site import open_browser, open_whole
from tests.relay.orbiter.sky import Clock, Sky, eclipse, landed, orbiting, publishing, until
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED
from tests.support.certificates import certified

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
AHEAD = """async shift_s => {
    const module = document.querySelector("link[href$='server_clock.js']");
    const { serverClock } = await import(module.href);
    serverClock.offset_s += shift_s;
}"""
LATE = """addEventListener("hashchange", (event) => {
    if (!event.isTrusted) return;
    event.stopImmediatePropagation();
    setTimeout(() => dispatchEvent(new HashChangeEvent("hashchange")), 1000);
}, true)"""
"""A busy browser: the page receives each new address a second later."""
DAY_SPAN = "openmct.time.setClockOffsets({ start: -86_400_000, end: 5_000 })"
PAGE = "#/browse/rover:rovers/rover:{0}/rover:{0}~{1}?hideInspector=true"


def day_with_eclipses(clock: Clock) -> ContactPlan:
    """Return a contact of ten minutes in an hour, and after 20 s another of a day."""
    (first,) = eclipse(clock).contacts
    begin_s = first.end_utc_s + 20.0
    day = replace(first, begin_utc_s=begin_s, end_utc_s=begin_s + 86_400.0)
    return ContactPlan((first, day))


async def test_a_command_is_seen_to_wait_for_the_contact_and_to_go_up_with_it(
    launch: Launch, tmp_path: Path
) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    errors: list[str] = []
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    async with (
        orbiting(sky, clock, day_with_eclipses(clock)) as (relay, (station,)),
        landed(sky, "jackal") as far,
        at_console(tmp_path, [str(station.uri), launch("scout").uri], "anna") as (anna,),
        publishing(station),
        open_browser() as browser,
    ):
        page = await browser.new_page(viewport={"width": 1200, "height": 700})
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.add_init_script(LATE)
        await open_whole(page, f"{anna.address}{PAGE.format('scout', 'dtn')}")
        await expect(page.get_by_text("No orbiter serves scout")).to_be_visible()
        # Open MCT writes this to the address after a delay.
        await page.evaluate("openmct.time.setClockOffsets({ start: -240_000, end: 5_000 })")
        await page.goto(f"{anna.address}{PAGE.format('rover-console', 'values')}")
        own_pages = page.get_by_test_id("value-CONSOLE_PAGES")
        await expect(own_pages).to_have_text("2")
        await expect(page.get_by_test_id("value-CONSOLE_LOST")).to_have_text("0")
        rovers = page.get_by_role("combobox", name="rover")
        await expect(rovers.locator("option")).to_have_text(["jackal", "scout"])
        await page.screenshot(path=ARTIFACTS / "console-own.png")
        await page.goto(f"{anna.address}{PAGE.format('jackal', 'dtn')}")
        path = page.locator("[data-part=bundles]")
        await expect(path).to_contain_text(re.compile(r"no contact.*next at .* in (\d\d min|1 h)"))
        await expect(path).to_have_attribute("data-open", "false")
        await anna.send("waits", "moveForward", distance=2.0)
        command = page.locator("tr[data-id=waits]")
        await expect(command).to_contain_text("at the orbiter for")
        now_s = clock.utc_s()
        await far.link(
            LinkHealth(now_s, 0, 0.0, None, 41.0, 0, 0, True, 0, 12, 12, 1, 0, 4, round_trip_s=0.25)
        )
        await until(lambda: all(each.aboard for each in relay.rovers.values()))
        await expect(page.get_by_test_id("DTN_QUEUED")).to_have_text("1")
        await expect(page.get_by_test_id("DTN_ABOARD_RETRANSMITTED")).to_have_text("1")
        await expect(page.get_by_text("rover → orbiter, reported")).to_be_visible()
        strip = page.locator("[data-strip=DTN_CONTACTS_UP]")
        await expect(strip.locator("[data-contact]")).to_have_count(1)
        await page.screenshot(path=ARTIFACTS / "console-relay.png")
        clock.shift_s = 3601.0
        await expect(command).to_have_count(0)
        await expect(path).to_have_attribute("data-open", "true")
        for counter in ("DTN_SENT", "DTN_ACKNOWLEDGED"):
            await expect(page.get_by_test_id(counter)).to_have_text("1")
        await expect(page.get_by_test_id("DTN_QUEUED")).to_have_text("0")
        await page.evaluate(AHEAD, 3601.0)
        await expect(path).to_contain_text(re.compile(r"until .*, for another \d+ (min|s)"))
        await page.evaluate(AHEAD, 620.0)
        date = r"20\d\d-\d\d-\d\d \d\d:\d\d:\d\d"
        await expect(path).to_contain_text(re.compile(f"until {date}, for another 23 h 5[0-9] min"))
        await page.evaluate(DAY_SPAN)
        await expect(strip.locator(".end")).to_have_text(re.compile(date))
        gap = await strip.locator("[data-gap]").bounding_box()
        assert gap is not None
        assert gap["width"] >= 4.0, "20 s of a day"
        assert gap["height"] >= 10.0
        await page.screenshot(path=ARTIFACTS / "console-relay-day.png")
        await page.goto(f"{anna.address}{PAGE.format('jackal', 'layout')}")
        await expect(page.get_by_test_id("value-DTN_CONTACTS_UP")).to_contain_text("/")
        await expect(page.get_by_test_id("value-POS_X")).to_be_in_viewport(ratio=0.95)
    assert errors == []


async def test_commands_and_values_use_the_chosen_link(launch: Launch, tmp_path: Path) -> None:
    rover, sky = launch(), Sky(tmp_path, "jackal")
    errors: list[str] = []
    async with (
        orbiting(sky) as (_, (station,)),
        landed(sky, "jackal") as far,
        at_console(tmp_path, [rover.uri, str(station.uri)], "anna", topics=[*ALL, "tm"]) as (anna,),
        open_browser() as browser,
    ):
        page = await browser.new_page(viewport={"width": 1600, "height": 1000})
        page.on("pageerror", lambda error: errors.append(str(error)))
        await open_whole(page, anna.address)
        await page.get_by_label("command", exact=True).select_option("moveForward")
        await page.get_by_label("distance", exact=True).fill("1")
        await page.get_by_label("link", exact=True).select_option("relay")
        await page.get_by_role("button", name="Send moveForward to jackal").click()
        command = page.locator(".command[data-name=moveForward]")
        await expect(command).to_have_attribute("data-state", "executed")
        assert [message.command for message in far.commands] == ["MOVE_FORWARD"]

        await far.send_telemetry(BATERY_VOLTAGE=25.0)
        began_s = (await anna.page.until(lambda text: text.get("value") == 26.0))["utc"]
        reported = [
            ParameterValue(Parameter.BATERY_VOLTAGE, began_s + later_s, value)
            for later_s, value in ((1.0, 24.0), (3.0, 23.0), (2.0, 23.5))
        ]
        rover.do(lambda bench: bench.link.send_telemetry(reported))
        received = await anna.page.until(lambda text: text.get("value") == 25.0)
        for link, values, first_s, last_s in (
            ("direct", ["23", "23.5", "24"], began_s + 1.0, began_s + 3.0),
            ("relay", ["25"], received["utc"], received["utc"]),
        ):
            span = f"tc.startBound={1e3 * first_s - 10:.0f}&tc.endBound={1e3 * last_s + 10:.0f}"
            table = f"rover:jackal/rover:jackal~telemetry~{link}~BATERY_VOLTAGE?view=table"
            await page.goto(
                f"{anna.address}#/browse/rover:rovers/{table}&tc.mode=fixed&tc.timeSystem=utc&{span}"
            )
            cells = page.locator(".c-telemetry-table__body [aria-label^='value table cell']")
            await expect(cells).to_have_text(values)
    assert errors == []


async def test_a_token_holder_logs_in_by_tls(tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text("anna 0123456789abcdef\n")
    ends = certified(tmp_path, "console")["console"]
    tls = (ends.certificate, ends.key)
    async with (
        served(tmp_path, "maltcp://127.0.0.1:1/MRS", tokens=tokens, tls=tls) as address,
        open_browser() as browser,
    ):
        page = await browser.new_page(ignore_https_errors=True)
        for path in ("lite", ""):
            await page.goto(f"{address}{path}")
            await expect(page.get_by_test_id("stop")).to_have_count(0)
            await page.get_by_label("token").fill("0123456789abcdeX")
            await page.get_by_role("button", name="Log in").click()
            await expect(page.get_by_role("alert")).to_have_text(re.compile("token"))
            await page.get_by_label("token").fill("0123456789abcdef")
            await page.get_by_role("button", name="Log in").click()
            await expect(page.get_by_role("button", name="anna")).to_be_visible()
            await page.context.clear_cookies()
