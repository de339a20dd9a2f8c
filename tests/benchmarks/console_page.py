"""How soon a page of the console can be used, what it loads, how soon values and pictures show.

All between is real: simulation, executive, console and browser. Pictures come from a camera of our
own, which draws the number of each into its corner: the page's pixels tell which one is shown.
"""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from playwright.sync_api import Page

from executive.commands import SetStatusInterval
from executive.values.parameters import Parameter
from sim.processes import HOST
from sim.ros.video_stream import VideoStream
from sim.rover import scenery
from sim.rover.camera import encode_jpeg
from tests.benchmarks.console import VALUES_HZ
from tests.benchmarks.octets import Octets
from tests.console.site import Visitors, visitors
from tests.support.figures import Figure, Goal, quantile
from tests.support.ports import free_udp_ports
from tests.support.victims import Workplace, workplace

PAGES = {"whole": "", "light": "lite"}
CAMERA = "#/browse/rover:rovers/rover:jackal/rover:jackal~video?hideInspector=true&hideRecents=true"
USABLE = Goal(3.0)
WHOLE = Goal(1.3)
LOADED = Goal(1.3)
WEAK = {"offline": False, "latency": 600, "downloadThroughput": 32e3, "uploadThroughput": 32e3}
"""Milliseconds and octets/s of a weak link: 600 ms, 256 kbit/s."""
WEAK_STOP = Goal(4.0)
WEAK_USABLE = Goal(15.0)
VALUE = Goal(150.0)
PICTURE = Goal(20.0)
PICTURES_HZ = 15.0
WIDTH, HEIGHT = 640, 480
BITS, SQUARE = 16, 16
SETTLE_S = 1.0
"""After which a page that can be used has loaded all."""
LIMIT_S = 60.0

STOPS = "() => document.querySelector('[data-testid=stop]')?.disabled === false"
IS_WHOLE = "() => document.querySelector('.l-shell') && !document.querySelector('#operations')"
IS_USABLE = r"""() => document.querySelector('.form-view select')?.options.length > 1
    && /\d/.test(document.querySelector('[data-testid=value-POS_X]')?.textContent ?? '')"""
VALUES = """async ([count, limit_ms]) => {
    const cell = document.querySelector('[data-testid=value-POS_X]')
    const delays = []
    await new Promise(done => {
        setTimeout(done, limit_ms)
        new MutationObserver(() => {
            const day = new Date().toISOString().slice(0, 11)
            const sampled = Date.parse(`${day}${cell.title.split(' ')[0]}Z`)
            requestAnimationFrame(() => requestAnimationFrame(() => {
                delays.push(Date.now() - sampled)
                if (delays.length === count) done()
            }))
        }).observe(cell, {attributes: true, attributeFilter: ['title']})
    })
    return delays
}"""
"""When a value was sampled, its title tells; with the second frame after the change it is drawn."""
NUMBERS = """async ([count, limit_ms, bits, square]) => {
    const canvas = document.querySelector('[data-testid=video]')
    const drawn = []
    await new Promise(done => {
        setTimeout(done, limit_ms)
        new MutationObserver(() => {
            const context = canvas.getContext('2d')
            const pixels = context.getImageData(0, square / 2, bits * square, 1).data
            let number = 0
            for (let bit = 0; bit < bits; bit++)
                if (pixels[4 * (bit + 0.5) * square] > 127) number += 2 ** bit
            drawn.push([number, Date.now()])
            if (drawn.length === count) done()
        }).observe(canvas, {attributes: true, attributeFilter: ['data-frames']})
    })
    return drawn
}"""


def measure(loads: int, samples: int, log: Callable[[str], None]) -> list[Figure]:
    """Load each page so often without a cache, and watch so many values, and pictures, on it."""
    with workplace() as workspace:
        camera, ground = free_udp_ports(2)
        url = _console(workspace, camera, ground)
        with visitors() as people, _pictures(camera) as taken_s:
            log(f"console page: {loads} loads of each, {samples} values and pictures ...")
            loaded = {name: _loads(people, f"{url}{path}", loads) for name, path in PAGES.items()}
            whole_s = [_whole(people.visit("about:blank", "bench"), url) for _ in range(loads)]
            stops_s, weak_s = _weak(people.visit("about:blank", "bench"), url)
            delays_ms = {
                name: _values(people, f"{url}{path}", samples) for name, path in PAGES.items()
            }
            drawn = _drawn(people, f"{url}{CAMERA}", samples)
        workspace.check()
    weak = "256 kbit/s, 600 ms, an empty cache"
    figures = [
        Figure("whole page: Open MCT, p50", quantile(whole_s, 0.5), "s", "an empty cache", WHOLE),
        Figure("whole page, weak link: STOP", stops_s, "s", weak, WEAK_STOP),
        Figure("whole page, weak link: usable", weak_s, "s", weak, WEAK_USABLE),
    ]
    for name in PAGES:
        usable_s, loaded_mb = (quantile(each, 0.5) for each in zip(*loaded[name], strict=True))
        figures += [
            Figure(f"{name} page: usable, p50", usable_s, "s", "an empty cache", USABLE),
            Figure(f"{name} page: loads", loaded_mb, "MB", "compressed", LOADED),
        ]
        on = f"sampled aboard to the frame that shows it, {VALUES_HZ}/s"
        for label, ratio, goal in (("p50", 0.5, VALUE), ("p95", 0.95, None)):
            delay_ms = quantile(delays_ms[name], ratio)
            figures.append(Figure(f"{name} page: value, {label}", delay_ms, "ms", on, goal))
    lags_ms = [at_ms - 1e3 * taken_s[number] for number, at_ms in drawn]
    on = f"before it is compressed to the canvas, {PICTURES_HZ:g}/s"
    took_s = (drawn[-1][1] - drawn[0][1]) / 1e3
    return [
        *figures,
        Figure("picture, p50", quantile(lags_ms, 0.5), "ms", on, PICTURE),
        Figure("picture, p95", quantile(lags_ms, 0.95), "ms", on),
        Figure("pictures", (len(drawn) - 1) / took_s, "/s", on),
    ]


def _console(workspace: Workplace, camera: int, ground: int) -> str:
    """Start a rover, and a console of it; return the address of that."""
    workspace.start("simulation", "sim.ros.process", "--world", "flat", "--camera", "off")
    executive = workspace.start(
        "executive", "adapters.onboard.process",
        "--port", 0, "--data", workspace.folder / "executive",
        "--video-from", f"{HOST}:{camera}", "--video-to", f"{HOST}:{ground}",
    )  # fmt: skip
    with Octets(executive.port()) as commands:
        commands.request(SetStatusInterval(len(Parameter) / VALUES_HZ))
    console = workspace.start(
        "console", "adapters.console.process",
        "--to", f"{HOST}:{executive.port()}", "--video", f"jackal={HOST}:{ground}",
        "--port", 0, "--data", workspace.folder / "console",
        up=r"(?m)^(http://\S+)$",
    )  # fmt: skip
    return console.wait()[1]


@contextmanager
def _pictures(port: int) -> Iterator[list[float]]:
    """Send pictures to a port aboard; gives when each was taken, seconds since 1970 UTC."""
    taken_s: list[float] = []
    ended = threading.Event()

    def work() -> None:
        stream = VideoStream(HOST, port, WIDTH, HEIGHT)
        soil = scenery.soil_texture(WIDTH)[:HEIGHT].copy()
        began_s = time.monotonic()
        while not ended.wait(began_s + len(taken_s) / PICTURES_HZ - time.monotonic()):
            number = len(taken_s)
            taken_s.append(time.time())
            for bit in range(BITS):
                lit = number >> bit & 1
                soil[:SQUARE, bit * SQUARE : (bit + 1) * SQUARE] = 255 * lit
            stream.send(encode_jpeg(soil), number / PICTURES_HZ)
        stream.close()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield taken_s
    finally:
        ended.set()
        thread.join()


def _loads(people: Visitors, url: str, loads: int) -> list[tuple[float, float]]:
    """Return after how many seconds a page can be used, and how many MB it loads, each time."""
    return [_load(people.visit("about:blank", "bench"), url) for _ in range(loads)]


def _load(page: Page, url: str) -> tuple[float, float]:
    octets = 0.0

    def add(event: dict[str, float]) -> None:
        nonlocal octets
        octets += event["encodedDataLength"]

    network = page.context.new_cdp_session(page)
    network.on("Network.loadingFinished", add)
    network.send("Network.enable")
    began_s = time.monotonic()
    page.goto(url, wait_until="commit")
    page.wait_for_function(IS_USABLE)
    usable_s = time.monotonic() - began_s
    page.wait_for_timeout(1e3 * SETTLE_S)
    page.context.close()
    return usable_s, octets / 1e6


def _whole(page: Page, url: str) -> float:
    """Return after how many seconds Open MCT is shown."""
    began_s = time.monotonic()
    page.goto(url, wait_until="commit")
    page.wait_for_function(IS_WHOLE)
    whole_s = time.monotonic() - began_s
    page.context.close()
    return whole_s


def _weak(page: Page, url: str) -> tuple[float, float]:
    """Return after how many seconds by a weak link STOP and the operations can be used."""
    network = page.context.new_cdp_session(page)
    network.send("Network.enable")
    network.send("Network.emulateNetworkConditions", WEAK)
    began_s = time.monotonic()
    page.goto(url, wait_until="commit")
    page.wait_for_function(STOPS)
    stops_s = time.monotonic() - began_s
    page.wait_for_function(IS_USABLE)
    usable_s = time.monotonic() - began_s
    page.context.close()
    return stops_s, usable_s


def _values(people: Visitors, url: str, samples: int) -> list[float]:
    """Return how many milliseconds after they were sampled aboard values are on a page."""
    page = people.visit(url, "bench")
    page.wait_for_function(IS_USABLE)
    found: list[float] = _watch(page, VALUES, samples)
    page.context.close()
    return found


def _drawn(people: Visitors, url: str, samples: int) -> list[tuple[int, float]]:
    """Return the numbers of pictures, each with when it was on a page, ms since 1970 UTC."""
    page = people.visit(url, "bench")
    page.get_by_role("button", name="video on").click()
    page.locator("[data-testid=video][data-frames]").wait_for()
    found: list[tuple[int, float]] = _watch(page, NUMBERS, samples, BITS, SQUARE)
    page.context.close()
    return found


def _watch(page: Page, script: str, samples: int, *arguments: int) -> Any:
    found: Sequence[Any] = page.evaluate(script, [samples, 1e3 * LIMIT_S, *arguments])
    if len(found) < samples:
        raise TimeoutError(f"{len(found)} of {samples} came to the page within {LIMIT_S:g} s")
    return found
