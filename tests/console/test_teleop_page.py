"""Driving by keys and gamepad beside the camera, in a real browser."""

import asyncio
import re
from pathlib import Path

import pytest
from playwright.async_api import expect

from executive.commands import Mode
from executive.values.geometry import STANDING
from tests.console.conftest import Launch
from tests.console.consoles import JsonMessage, at_console
from tests.console.site import open_browser, open_whole
from tests.mrs.aboard import Aboard
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
CAMERA = "#/browse/rover:rovers/rover:jackal/rover:jackal~video?hideInspector=true"
GAMEPAD = (
    "axes => { navigator.getGamepads = () => axes ? [{ index: 0, connected: true, axes }] : [] }"
)


async def test_the_rover_drives_while_a_key_is_held(launch: Launch, tmp_path: Path) -> None:
    rover, seen = launch(), set[str]()

    def accepted(travel: float, rotate: float) -> asyncio.Task[JsonMessage]:
        """Return the next accepted drive of a direction."""

        def is_wanted(message: JsonMessage) -> bool:
            if message.get("name") != "drive" or message["state"] in ("sending", "received"):
                return False
            if message["id"] in seen:
                return False
            signs = [(each > 0) - (each < 0) for each in list(message["args"].values())[:2]]
            if signs != [travel, rotate]:
                return False
            seen.add(message["id"])
            return True

        return asyncio.create_task(anna.page.until(is_wanted))

    async with (
        at_console(tmp_path, rover.uri, "anna") as (anna,),
        open_browser() as browser,
    ):
        page = await browser.new_page(viewport={"width": 1280, "height": 800})
        await open_whole(page, f"{anna.address}{CAMERA}")
        keys, arm = page.keyboard, page.get_by_role("button", name="drive by keys: off")
        await keys.press("w")
        await arm.click()
        await expect(page.get_by_text("0.30 m/s, 26 °/s")).to_be_visible()

        await keys.down("w")
        for _ in range(8):  # as each lasts for 0.8 s
            await accepted(1, 0)
            travel_mps, _ = await moved(rover, 0.2)
        assert travel_mps > 0.2
        await expect(page.get_by_test_id("velocity")).to_contain_text("actual 0.30 m/s")
        await page.screenshot(path=ARTIFACTS / "console-teleop.png")
        await keys.down("ArrowLeft")
        await accepted(1, 1)
        await keys.up("w")
        await accepted(0, 1)
        await keys.up("ArrowLeft")
        await accepted(0, 0)
        assert await moved(rover, 1.0) == (0.0, 0.0)

        await keys.down("s")
        await accepted(-1, 0)
        await page.evaluate("window.dispatchEvent(new Event('blur'))")
        await accepted(0, 0)
        await keys.up("s")
        assert await moved(rover, 1.0) == (0.0, 0.0)

        await page.evaluate(GAMEPAD, [0.5, -1])
        await accepted(1, -1)
        await page.evaluate(GAMEPAD, None)
        await accepted(0, 0)
        assert await moved(rover, 1.0) == (0.0, 0.0)
        assert rover.do(lambda bench: bench.executive.mode) is Mode.IDLE

        await keys.down("d")
        await accepted(0, -1)
        await keys.press("Control+Space")
        # By the mode, or by the refusal of a velocity that was sent before the mode was received.
        stopped = re.compile("STOPPED.*resume")
        await expect(page.get_by_test_id("teleop")).to_have_text(stopped)
        await expect(arm).to_be_visible()
        await page.goto(f"{anna.address}lite")
        drives = page.locator(".command[data-name=drive]")
        await expect(drives.first).to_be_visible()
        assert await drives.count() <= 3  # after the stop some may have been refused


async def moved(rover: Aboard, duration_s: float) -> tuple[float, float]:
    """Return the velocity of the rover after some time."""
    await asyncio.to_thread(rover.run, duration_s)
    velocity = await asyncio.to_thread(rover.do, lambda bench: bench.rover.velocity)
    return (0.0, 0.0) if velocity == STANDING else (velocity.travel_mps, velocity.rotate_radps)
