"""The full console by a weak link: STOP first, then operations, and Open MCT last."""

import asyncio
import re
import shutil
from pathlib import Path
from typing import Any, Final

import pytest
from aiohttp import ClientSession
from playwright.async_api import CDPSession, Page, Route, expect

from adapters.console.service import STATIC
from tests.console.conftest import Launch
from tests.console.consoles import at_console, served
from tests.console.site import LIMIT_MS, open_browser
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

UNREACHABLE: Final = "127.0.0.1:1"
PLAN: Final = """<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">
<moveForward distance="99" deadline_s="999"/></BehaviorTree></root>"""
EMULATION: Final = "Network.emulateNetworkConditions"
WEAK: Final = {"latency": 600, "downloadThroughput": 32e3, "uploadThroughput": 32e3}
UNLIMITED: Final = {"latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}


async def test_files_of_a_page_are_cached_until_their_content_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = tmp_path / "static"
    shutil.copytree(STATIC, pages)
    monkeypatch.setattr("adapters.console.service.STATIC", pages)
    async with served(tmp_path, UNREACHABLE) as address, ClientSession() as browser:

        async def modules() -> list[str]:
            async with browser.get(address) as page:
                return re.findall(r'="/([0-9a-f]{16}/app/[a-z_/]+\.js)"', await page.text())

        named = await modules()
        assert len(set(named)) == len(named)
        for name in ("model/observable.js", "views/map_layers.js"):  # imported by the imported
            async with browser.get(f"{address}{named[0][:16]}/app/{name}") as file:
                assert "immutable" in file.headers["Cache-Control"]
                code = await file.text()
            source = (pages / "app" / name).read_text(encoding="utf-8")
            assert len(code) < len(source)
            assert code.count("\n") == source.count("\n")
            assert "/**" not in code
            assert f"{named[0][:16]}/app/{name}" in named
        async with browser.get(f"{address}{named[0][:16]}/app/..%2f..%2fservice.py") as outside:
            assert outside.status == 404
        (pages / "app" / "dom.js").write_text("", encoding="utf-8")
        assert not set(named) & set(await modules())


class Loaded:
    """Requests of a page in their order, and the octets that it received."""

    def __init__(self, network: CDPSession) -> None:
        self.paths: list[str] = []
        self.octets = 0
        network.on("Network.requestWillBeSent", self._on_request)
        network.on("Network.dataReceived", self._on_data)

    def _on_request(self, event: dict[str, Any]) -> None:
        self.paths.append(event["request"]["url"].partition("?")[0])

    def _on_data(self, event: dict[str, Any]) -> None:
        self.octets += event["encodedDataLength"]

    def index(self, name: str) -> int:
        """Return the index of the request of a file."""
        return next(index for index, path in enumerate(self.paths) if path.endswith(name))


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium")
async def test_stop_and_operations_work_by_a_weak_link_before_open_mct(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    errors: list[str] = []
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    async with (
        at_console(tmp_path, rover.uri, "anna") as (anna,),
        open_browser() as browser,
    ):
        await anna.page.is_up()
        page = await browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("pageerror", lambda error: errors.append(str(error)))
        network = await page.context.new_cdp_session(page)
        await network.send("Network.enable")
        await network.send(EMULATION, {"offline": False} | WEAK)
        loaded = Loaded(network)
        may_load = asyncio.Event()  # a download that has begun stays as slow as it began

        async def late(route: Route) -> None:
            await may_load.wait()
            await route.continue_()

        await page.route("**/openmct.js", late)
        await page.goto(anna.address, wait_until="commit")
        await page.get_by_test_id("stop").click()
        await anna.page.until(lambda message: message.get("mode") == "STOPPED")
        assert loaded.octets < 100_000
        await use_operations(page)
        assert loaded.octets < 400_000
        await page.screenshot(path=ARTIFACTS / "console-weak-link.png")
        assert loaded.index("views/status_bar.js") < loaded.index("views/map.js")
        assert loaded.index("views/command_form.js") < loaded.index("openmct.js")
        await network.send(EMULATION, {"offline": False} | UNLIMITED)
        may_load.set()
        await page.get_by_role("button", name="show the full console").click()
        await expect(page.locator("#operations")).to_have_count(0)
        await expect(page.get_by_label("x", exact=True)).to_have_value("3")
    assert errors == []


async def use_operations(page: Page) -> None:
    """Use mode, alarms, commands and the form."""
    await expect(page.get_by_test_id("mode")).to_have_text("STOPPED")
    await expect(page.locator(".command[data-name=stop]")).to_be_visible()
    await page.get_by_test_id("alarms").click()
    await expect(page.locator(".alarms-view")).to_be_visible()
    await page.get_by_test_id("alarms").click()
    await page.get_by_label("command", exact=True).select_option("moveTo")
    await page.get_by_label("x", exact=True).fill("3")


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium")
async def test_a_small_window_is_offered_the_light_page_with_log_and_plans(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with (
        at_console(tmp_path, rover.uri, "anna") as (anna,),
        open_browser() as browser,
    ):
        page = await browser.new_page(viewport={"width": 390, "height": 844})
        await page.goto(anna.address)
        await page.get_by_role("link", name="Open the light page").click()
        await expect(page).to_have_url(re.compile("/lite$"))
        await anna.page.is_up()
        await anna.post("api/plans/jackal", id="p", plan_id="wait", content=PLAN)
        await asyncio.to_thread(rover.run, 0.2)
        await page.locator("summary").get_by_text("Log").click()
        await expect(page.locator(".log-view .text").first).to_contain_text("plan wait submitted")
        await page.locator("summary").get_by_text("Plans").click()
        plan = page.locator(".plans-view .aboard tr").filter(has_text="wait")
        for act, state in (("run", "executing"), ("suspend", "suspended"), ("resume", "executing")):
            await plan.get_by_role("button", name=act).click()
            async with asyncio.timeout(LIMIT_MS / 1e3):
                while state not in await plan.inner_text():
                    await asyncio.to_thread(rover.run, 0.2)
        await page.locator("summary").get_by_text("Camera").click()
        await expect(page.get_by_test_id("video")).to_be_visible()
        await page.screenshot(path=ARTIFACTS / "console-light-more.png", full_page=True)
        await page.goto(anna.address)
        await expect(page).to_have_url(re.compile("/lite$"))
        await page.get_by_role("link", name="full console").click()
        await expect(page.locator(".l-shell")).to_be_visible()
        await expect(page.get_by_role("link", name="Open the light page")).to_have_count(0)
