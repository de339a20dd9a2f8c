"""A simulated rover, its executive and a console, as processes; and browsers that look at it."""

import re
import shutil
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Final

from playwright import async_api
from playwright.sync_api import Browser, ConsoleMessage, Page, Request, sync_playwright

from tests.support.browser import BROWSER
from tests.support.processes import Running, executive, running, simulation

SIZE: Final = (1600, 1000)
LIMIT_MS: Final = 60_000
"""How long a browser may take to show something, on a machine that has much to do."""
OPTIONS: Final = (
    "--headless",
    "--no-sandbox",  # it does not start as root otherwise
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
_SHARED_OPTIONS: Final = (
    *OPTIONS,
    # As Playwright starts a browser: pages that are not in front are as fast as the one that is.
    "--disable-background-timer-throttling",
    "--disable-backgrounding-occluded-windows",
    "--disable-renderer-backgrounding",
    "--disable-back-forward-cache",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--disable-hang-monitor",
    "--disable-ipc-flooding-protection",
    "--disable-popup-blocking",
    "--force-color-profile=srgb",
    "--hide-scrollbars",
    "--mute-audio",
    "--remote-debugging-port=0",
)
_ENDS_WITH_TESTS: Final = ("setpriv", "--pdeathsig", "TERM")
"""Of util-linux: a browser is terminated with its parent, even if that is killed."""
SLOW: Final = """const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (callback) => setTimeout(() => draw(callback), 100);
"""
"""A busy browser: it draws ten times a second."""
_SHOWN_BY_THE_PAGE: Final = r"net::ERR_|status of (403|409|412|422|503)"
"""A server that is away, or what it refused: a browser writes both to its console as well."""
_NAMED: Final = (  # the empty page that a browser begins with keeps nothing
    "if (origin !== 'null') sessionStorage.setItem('rover-console-operator', {name!r})"
)


@dataclass(frozen=True, slots=True)
class Site:
    """A console that runs.

    Attributes:
        to: the rover.
        video: the UDP port at which its video arrives.
    """

    folder: Path
    port: int
    to: str
    video: int | None = None

    @property
    def url(self) -> str:
        """Where it is."""
        return f"http://127.0.0.1:{self.port}/"

    @contextmanager
    def console(self) -> Iterator[Running]:
        """Run it for the time of the with."""
        arguments = ["--port", str(self.port), "--to", self.to, "--data", str(self.folder / "data")]
        if self.video is not None:
            arguments += ["--video", f"jackal=127.0.0.1:{self.video}"]
        number = len(list(self.folder.glob("console-*.log")))
        with running(self.folder / f"console-{number}.log", "rover-console", *arguments) as process:
            process.output(re.escape(self.url))
            yield process


@contextmanager
def rover(folder: Path, camera: int, ground: int) -> Iterator[str]:
    """Run a simulated rover and its executive; give the address of its link.

    Args:
        folder: of their files.
        camera, ground: the UDP ports to which its camera sends, and from there the executive.
    """
    aboard, far = f"127.0.0.1:{camera}", f"127.0.0.1:{ground}"
    video = ("--video-from", aboard, "--video-to", far)
    with simulation(folder, "--video-to", aboard), executive(folder, *video) as (_, uri):
        yield uri


@dataclass(slots=True)
class Visitors:
    """People with a browser each; what went wrong on their pages is kept.

    Attributes:
        errors: of scripts, and what the pages wrote to their console as errors.
        requests: what was asked for elsewhere than at the console.
    """

    browser: Browser
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def visit(self, url: str, operator: str, size: tuple[int, int] = SIZE) -> Page:
        """Open a page under a name, in a browser profile of its own; wait for Open MCT on it."""
        context = self.browser.new_context(viewport={"width": size[0], "height": size[1]})
        context.set_default_timeout(LIMIT_MS)
        context.add_init_script(_NAMED.format(name=operator))
        page = context.new_page()
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda message: self._receive(message))
        page.on("request", lambda request: self._note(request))
        page.goto(url)
        if url.startswith("http") and not url.endswith("/lite"):
            page.locator(".l-shell").wait_for()  # of Open MCT
            page.locator("#operations").wait_for(state="detached")
        return page

    def _receive(self, message: ConsoleMessage) -> None:
        if message.type == "error" and not re.search(_SHOWN_BY_THE_PAGE, message.text):
            self.errors.append(f"{message.text} {message.location['url']}")

    def _note(self, request: Request) -> None:
        if not re.match(r"(https?|wss?)://127\.0\.0\.1:|data:|blob:", request.url):
            self.requests.append(request.url)


@cache
def _shared_browser() -> tuple[Running, str]:
    """Start the browser that the tests of this process share; return it with its address."""
    assert BROWSER is not None
    folder = Path(tempfile.mkdtemp(prefix="chromium-"))
    profile = f"--user-data-dir={folder / 'profile'}"
    command = (*_ENDS_WITH_TESTS, BROWSER, *_SHARED_OPTIONS, profile, "about:blank")
    process = Running(folder / "log", *command)
    try:
        return process, process.output(r"DevTools listening on (ws://\S+)")
    except BaseException:
        process.clean_up()
        raise


def close_shared_browser() -> None:
    """End the browser that `open_browser` has started, if it has."""
    if _shared_browser.cache_info().currsize:
        process, _ = _shared_browser()
        process.end()
        shutil.rmtree(process.log.parent, ignore_errors=True)
        _shared_browser.cache_clear()


@asynccontextmanager
async def open_browser() -> AsyncIterator[async_api.Browser]:
    """Give a browser for the time of the with; its process outlasts it, and no page does.

    A browser that has died is replaced: it fails one test, not all that follow.
    """
    if _shared_browser.cache_info().currsize and not _shared_browser()[0].is_running:
        close_shared_browser()
    _, address = _shared_browser()
    async with async_api.async_playwright() as playwright:
        browser = await playwright.chromium.connect_over_cdp(address)
        yield browser
        await browser.close()


async def open_whole(page: async_api.Page, address: str) -> None:
    """Open a full console; wait for Open MCT, which replaces the light page of operations."""
    await page.goto(address)
    await page.locator(".l-shell").wait_for()
    await page.locator("#operations").wait_for(state="detached")


@contextmanager
def visitors() -> Iterator[Visitors]:
    """Give people a browser for the time of the with."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=list(OPTIONS))
        try:
            yield Visitors(browser)
        finally:
            browser.close()
