"""What a console of many rovers costs, which it finds by the service layer of one of them."""

import asyncio
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack, ExitStack, contextmanager
from pathlib import Path

import psutil
from aiohttp import ClientSession, ClientWebSocketResponse
from playwright.async_api import CDPSession, async_playwright

from tests.benchmarks.console import address_of, console_of
from tests.console.consoles import ALL
from tests.console.site import OPTIONS, SIZE
from tests.support.browser import BROWSER
from tests.support.figures import Figure, Goal, quantile
from tests.support.processes import Running

PROCESSES = 2
LIMIT_S = 120.0
SETTLE_S = 2.0
CPU = Goal(25.0)
FOUND = Goal(10.0)
USABLE = Goal(3.0)
TOPICS = (*ALL, "tm", "tree")
IS_USABLE = r"""count => document.querySelector('select[aria-label=rover]')?.options.length >= count
    && /\d/.test(document.querySelector('[data-testid=value-POS_X]')?.textContent ?? '')"""
IS_OTHER = r"""name => document.querySelector('.form-view, .map-view') !== null
    && location.hash.includes(name)
    && /\d/.test(document.querySelector('[data-testid=value-POS_X]')?.textContent ?? '')"""
FRAMES = """async ms => {
    const gaps = []
    let before = performance.now()
    const end = before + ms
    await new Promise(done => {
        const frame = now => {
            gaps.push(now - before)
            before = now
            if (now < end) requestAnimationFrame(frame)
            else done()
        }
        requestAnimationFrame(frame)
    })
    return gaps
}"""


def measure(
    rovers: int, values_hz: float, pages: int, duration_s: float, progress: Callable[[str], None]
) -> list[Figure]:
    """Measure a console of so many rovers, with some pages, each of which hears all."""
    with tempfile.TemporaryDirectory() as folder, rovers_of(Path(folder), rovers, values_hz) as uri:
        progress(f"console: {rovers} rovers, {pages} pages, {duration_s:g} s ...")
        began_s = time.monotonic()
        with console_of(uri, Path(folder)) as (log, pid):
            return asyncio.run(_measure(log, pid, began_s, rovers, pages, duration_s))


@contextmanager
def rovers_of(folder: Path, rovers: int, values_hz: float) -> Iterator[str]:
    """Run rovers in a few processes; gives the address of the first, where all register."""
    shares = [len(range(each, rovers, PROCESSES)) for each in range(PROCESSES)]
    with ExitStack() as processes:
        at: list[str] = []
        first = 0
        for share in filter(None, shares):
            command = [sys.executable, "-m", "tests.benchmarks.fleet_rovers", str(folder)]
            command += [str(first), str(share), str(values_hz), *at[:1]]
            process = Running(folder / f"rovers-{first}.log", *command)
            processes.callback(process.clean_up)
            at.append(process.output(r"maltcp://\S+"))
            first += share
        yield at[0]


async def _measure(
    log: Path, pid: int, began_s: float, rovers: int, pages: int, duration_s: float
) -> list[Figure]:
    process = psutil.Process(pid)
    async with AsyncExitStack() as opened:
        address = await address_of(log)
        session = await opened.enter_async_context(ClientSession())
        sockets = []
        for number in range(pages):
            socket = await opened.enter_async_context(session.ws_connect(f"{address}ws"))
            hello = {"op": "hello", "console": str(number), "topics": TOPICS}
            await socket.send_json(hello)
            sockets.append(socket)
        await asyncio.gather(*(_until_up(socket, rovers) for socket in sockets))
        found_s = time.monotonic() - began_s
        counts = [[0] for _ in sockets]
        tasks = [
            asyncio.create_task(_count(socket, count))
            for socket, count in zip(sockets, counts, strict=True)
        ]
        await asyncio.sleep(SETTLE_S)
        alone = await _cost(process, duration_s, counts)
        shown = [] if BROWSER is None else await _show(address, rovers, duration_s)
        for task in tasks:
            task.cancel()
    on = f"{rovers} rovers, {pages} pages"
    cpu, values_hz = alone
    return [
        Figure("fleet: all found", found_s, "s", "from the console's start", FOUND),
        Figure("fleet: CPU", cpu, "% of a core", on, CPU),
        Figure("fleet: values", values_hz, "/s", "to each page"),
        Figure("fleet: memory", process.memory_info().rss / 1e6, "MB", on),
        *shown,
    ]


async def _cost(
    process: psutil.Process, duration_s: float, counts: list[list[int]]
) -> tuple[float, float]:
    """Return the console's CPU, % of a core, and how many values a second a page gets."""
    for count in counts:
        count[0] = 0
    began_s, before = time.monotonic(), process.cpu_times()
    await asyncio.sleep(duration_s)
    took_s, after = time.monotonic() - began_s, process.cpu_times()
    used_s = after.user + after.system - before.user - before.system
    return 100 * used_s / took_s, sum(count[0] for count in counts) / len(counts) / took_s


async def _until_up(socket: ClientWebSocketResponse, rovers: int) -> None:
    up: set[str] = set()
    async with asyncio.timeout(LIMIT_S):
        while len(up) < rovers:
            for message in json.loads(await socket.receive_str()):
                if message["ty"] == "link" and message["state"] == "up":
                    up.add(message["asset"])


async def _count(socket: ClientWebSocketResponse, count: list[int]) -> None:
    while True:
        batch = json.loads(await socket.receive_str())
        count[0] += sum(message["ty"] == "tm" for message in batch)


async def _show(address: str, rovers: int, duration_s: float) -> list[Figure]:
    """Open a page in a browser, and choose another rover there."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=BROWSER, args=list(OPTIONS))
        page = await browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        began_s = time.monotonic()
        await page.goto(address, wait_until="commit")
        await page.wait_for_function(IS_USABLE, arg=rovers, timeout=1e3 * LIMIT_S)
        usable_s = time.monotonic() - began_s
        began_s = time.monotonic()
        name = f"rover{rovers - 1:02}"
        await page.get_by_label("rover", exact=True).first.select_option(name)
        await page.wait_for_function(IS_OTHER, arg=name, timeout=1e3 * LIMIT_S)
        other_s = time.monotonic() - began_s
        await page.wait_for_timeout(1e3 * SETTLE_S)
        session = await page.context.new_cdp_session(page)
        await session.send("Performance.enable")
        before_s = await _worked_s(session)
        gaps_ms: list[float] = await page.evaluate(FRAMES, 1e3 * duration_s)
        used_s = await _worked_s(session) - before_s
        metrics = await page.evaluate("performance.memory.usedJSHeapSize")
        await browser.close()
    return [
        Figure("fleet page: usable", usable_s, "s", f"{rovers} rovers, an empty cache", USABLE),
        Figure("fleet page: another rover", other_s, "s", "from the choice to its values"),
        Figure("fleet page: CPU", 100 * used_s / duration_s, "% of a core", "of its thread"),
        Figure("fleet page: gap of frames, p99", quantile(gaps_ms, 0.99), "ms", "16.7 at best"),
        Figure("fleet page: heap", metrics / 1e6, "MB", "of scripts"),
    ]


async def _worked_s(session: CDPSession) -> float:
    """Return the seconds that the page's thread worked."""
    metrics = (await session.send("Performance.getMetrics"))["metrics"]
    return next(float(each["value"]) for each in metrics if each["name"] == "TaskDuration")
