"""The map on a link of 10 s: where the next command finds the rover, before any report of it."""

import asyncio
import re
from pathlib import Path

import pytest
from playwright.async_api import Page, expect

from adapters.mrs.ground import parse_address
from adapters.mrs.transport import TransportSettings
from sim.processes.delayed_link import DelayedLink, LinkConditions
from tests.console.conftest import Launch
from tests.console.consoles import ALL, at_console
from tests.console.site import open_browser
from tests.mrs import aboard
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

ROUND_TRIP_S = 10.0
TOPICS = (*ALL, "prediction")
TEXT = "The next command finds it at x ([0-9.-]+) m .* ± ([0-9.]+) m: as of ([0-9]+) s ago, "
ARRIVES = "next command arrives in 5 s."


async def shown_x_m(page: Page, name: str) -> float:
    return float(await page.get_by_test_id(name).get_attribute("data-x") or "nan")


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium")
async def test_the_map_shows_where_the_next_command_finds_the_rover(
    launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(aboard, "BUSY_S", 0.05)  # a tick: its time is that of the ground
    monkeypatch.setattr(aboard, "IDLE_S", 0.05)
    rover = launch()
    rover.runs = True
    port = parse_address(rover.uri).port
    link = DelayedLink("127.0.0.1", port, LinkConditions(0.02))
    server = await link.serve("127.0.0.1", 0)
    far = rover.uri.replace(f":{port}/", f":{server.sockets[0].getsockname()[1]}/")
    terms = TransportSettings(round_trip_s=ROUND_TRIP_S)
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    async with (
        at_console(tmp_path, far, "anna", topics=TOPICS, terms=terms) as (anna,),
        open_browser() as browser,
    ):
        await anna.page.is_up()
        link.conditions = LinkConditions(ROUND_TRIP_S)
        await anna.page.until(
            lambda each: (
                each["ty"] == "prediction" and each["arrival"] - each["utc"] > 0.45 * ROUND_TRIP_S
            )
        )
        page = await browser.new_page(viewport={"width": 900, "height": 900})
        await page.goto(f"{anna.address}lite")
        text = page.get_by_test_id("predicted-text")
        await expect(text).to_contain_text(ARRIVES)
        await anna.send("ahead", "moveForward", distance=5.0)
        for _ in range(4):  # the command has not arrived
            await asyncio.sleep(1.0)
        assert await shown_x_m(page, "rover") == pytest.approx(0.0, abs=0.01)
        assert 1.0 < await shown_x_m(page, "predicted-rover") < 5.2
        found = re.search(TEXT, await text.inner_text())
        assert found is not None
        assert 0.05 < float(found[2]) < 0.5
        assert 4 <= int(found[3]) <= 12
        assert await page.locator(".predicted polyline").get_attribute("points")
        await page.locator(".map-view").screenshot(path=ARTIFACTS / "console-predicted.png")
        command = await anna.page.command("ahead", "executed")
        end_m = rover.do(lambda bench: bench.executive.status.pose.x_m)
        assert command["ended"]
        await expect(text).to_contain_text(f"x {end_m:.1f}")
        assert await shown_x_m(page, "predicted-rover") == pytest.approx(end_m, abs=0.1)
    server.close()
    await asyncio.sleep(ROUND_TRIP_S / 2 + 0.5)  # until the ends of its connections have arrived
