"""Heap, elements and CPU of a page of the console that stays open, at first and at last."""

import asyncio
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from aiohttp import ClientSession
from playwright.async_api import CDPSession, Page, async_playwright

from tests.benchmarks.console import address_of, console_of
from tests.benchmarks.console_fleet import IS_USABLE, rovers_of
from tests.console.site import OPTIONS
from tests.support.browser import BROWSER
from tests.support.figures import Figure, Goal

SIZE = (1280, 800)
LIMIT_MS = 120e3
SETTLE_S = 10.0
PARTS = 4
"""Parts of the time; the figures of the first and of the last part are compared."""
CPU = Goal(10.0)
GROWTH = Goal(1.25)
"""Of heap and elements from the half to the end, if the list of commands is full at the half."""
FULL = 200
"""Commands that fill the list in half of the time."""


@dataclass(frozen=True, slots=True)
class Load:
    """State of a page: heap after a garbage collection, elements, and CPU time since its start."""

    heap_mb: float
    elements: float
    listeners: float
    worked_s: float
    at_s: float


def measure(
    values_hz: float, commands: int, duration_s: float, progress: Callable[[str], None]
) -> list[Figure]:
    """Measure a visible page of a rover with a rate of values and a number of commands."""
    with tempfile.TemporaryDirectory() as name, rovers_of(Path(name), 1, values_hz) as uri:
        progress(f"console: a page for {duration_s:g} s, {values_hz:g} values/s ...")
        with console_of(uri, Path(name)) as (log, _):
            return asyncio.run(_measure(log, values_hz, commands, duration_s))


async def _measure(log: Path, values_hz: float, commands: int, duration_s: float) -> list[Figure]:
    address = await address_of(log)
    headers = {"X-Rover-Operator": "bench"}
    async with async_playwright() as playwright, ClientSession(headers=headers) as session:
        browser = await playwright.chromium.launch(executable_path=BROWSER, args=list(OPTIONS))
        page = await browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        await page.goto(address)
        await page.wait_for_function(IS_USABLE, arg=1, timeout=LIMIT_MS)
        await asyncio.sleep(SETTLE_S)
        protocol = await page.context.new_cdp_session(page)
        await protocol.send("Performance.enable", {"timeDomain": "threadTicks"})
        sending = asyncio.create_task(_send(session, address, commands, duration_s))
        loads = [await _load(protocol)]
        for _ in range(PARTS):
            await asyncio.sleep(duration_s / PARTS)
            loads.append(await _load(protocol))
        await sending
        await _check(page)
        await browser.close()
    first, half, last = loads[0], loads[PARTS // 2], loads[-1]
    bounded = GROWTH if commands >= FULL else None
    on = f"{values_hz:g} values/s, {commands} commands in {duration_s:g} s"
    return [
        Figure("soak: heap at first", first.heap_mb, "MB", "after a garbage collection"),
        Figure("soak: heap at last", last.heap_mb, "MB", on),
        Figure("soak: heap, growth", last.heap_mb / half.heap_mb, "", "from the half on", bounded),
        Figure("soak: elements at first", first.elements, "", "nodes of the document"),
        Figure("soak: elements at last", last.elements, "", on),
        Figure(
            "soak: elements, growth", last.elements / half.elements, "", "from the half on", bounded
        ),
        Figure("soak: listeners at last", last.listeners, "", on),
        Figure("soak: CPU at first", _share(*loads[:2]), "% of a core", "of its thread", CPU),
        Figure("soak: CPU at last", _share(*loads[-2:]), "% of a core", "of its thread", CPU),
    ]


async def _send(session: ClientSession, address: str, count: int, duration_s: float) -> None:
    """Send a number of commands, evenly over the time."""
    began_s = time.monotonic()
    for number in range(count):
        await asyncio.sleep(began_s + number * duration_s / count - time.monotonic())
        body: dict[str, object] = {"id": f"soak-{number}", "asset": "rover00"}
        body |= {"name": "moveForward", "args": {"distance": -0.1 if number % 2 else 0.1}}
        async with session.post(f"{address}api/commands", json=body) as answer:
            answer.raise_for_status()


async def _load(protocol: CDPSession) -> Load:
    await protocol.send("HeapProfiler.collectGarbage")
    metrics = (await protocol.send("Performance.getMetrics"))["metrics"]
    found = {each["name"]: float(each["value"]) for each in metrics}
    return Load(
        found["JSHeapUsedSize"] / 1e6,
        found["Nodes"],
        found["JSEventListeners"],
        found["TaskDuration"],
        time.monotonic(),
    )


def _share(before: Load, after: Load) -> float:
    """Return the CPU share of the page's thread between two loads, %."""
    return 100 * (after.worked_s - before.worked_s) / (after.at_s - before.at_s)


async def _check(page: Page) -> None:
    """Raise AssertionError unless the page still shows the last command."""
    shown = await page.locator(".command[data-name=moveForward]").count()
    assert shown > 0
    assert await page.evaluate("document.visibilityState") == "visible"
