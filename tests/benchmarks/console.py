"""What the console costs for its pages, and how soon a value is there."""

import asyncio
import json
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack, closing, contextmanager
from pathlib import Path
from subprocess import DEVNULL, Popen

import psutil
from aiohttp import ClientSession, ClientWebSocketResponse

from executive.values.parameters import Parameter, ParameterValue
from tests.mrs.aboard import Aboard
from tests.support.figures import Figure, Goal, quantile

VALUES_HZ = 85
PARAMETERS = tuple(Parameter)
SETTLE_S = 2.0
START_S = 60.0
CPU = Goal(10.0)


def measure(pages: int, duration_s: float, progress: Callable[[str], None]) -> list[Figure]:
    """Measure a console with some pages, each of which gets all values."""
    with tempfile.TemporaryDirectory() as folder, closing(Aboard(Path(folder) / "rover")) as rover:
        progress(f"console: {pages} pages, {VALUES_HZ} values/s, {duration_s:g} s ...")
        with console_of(rover.uri, Path(folder)) as (log, pid):
            return asyncio.run(_measure(rover, log, pid, pages, duration_s))


@contextmanager
def console_of(uri: str, folder: Path) -> Iterator[tuple[Path, int]]:
    """Run a console of a rover; gives the file in which its address will be, and its process."""
    log = folder / "log"
    command = [sys.executable, "-m", "adapters.console.process", "--to", uri]
    command += ["--port", "0", "--data", f"{folder}/console"]
    with log.open("wb") as output, Popen(command, stdout=output, stderr=DEVNULL) as process:
        try:
            yield log, process.pid
        finally:
            process.terminate()


async def _measure(
    rover: Aboard, log: Path, pid: int, pages: int, duration_s: float
) -> list[Figure]:
    address = await address_of(log)
    process = psutil.Process(pid)
    async with AsyncExitStack() as opened:
        session = await opened.enter_async_context(ClientSession())
        sockets = []
        for number in range(pages):
            socket = await opened.enter_async_context(session.ws_connect(f"{address}ws"))
            hello = {"op": "hello", "console": str(number), "topics": ["tm", "link"]}
            await socket.send_json(hello)
            sockets.append(socket)
        await _until_up(sockets)
        delays_s: list[list[float]] = [[] for _ in sockets]
        received = [
            asyncio.create_task(_receive(socket, delays))
            for socket, delays in zip(sockets, delays_s, strict=True)
        ]
        source = asyncio.create_task(_publish_values(rover))
        await asyncio.sleep(SETTLE_S)
        for delays in delays_s:
            delays.clear()
        began_s, before = time.monotonic(), process.cpu_times()
        await asyncio.sleep(duration_s)
        took_s, after = time.monotonic() - began_s, process.cpu_times()
        for task in (source, *received):
            task.cancel()
    used_s = after.user + after.system - before.user - before.system
    every = [delay for delays in delays_s for delay in delays]
    on = f"{pages} pages, {VALUES_HZ} values/s each"
    return [
        Figure("console: CPU", 100 * used_s / took_s, "% of a core", on, CPU),
        Figure("console: values sent", len(every) / took_s, "/s", on),
        Figure(
            "console: value to page, p50",
            1e3 * quantile(every, 0.5),
            "ms",
            "at most a batch in 50 ms",
        ),
        Figure("console: value to page, p99", 1e3 * quantile(every, 0.99), "ms", "the same"),
        Figure("console: memory", process.memory_info().rss / 1e6, "MB", on),
    ]


async def address_of(log: Path) -> str:
    """Return where a console is served, once it is."""
    async with asyncio.timeout(START_S):
        while (found := re.search(r"http://\S+", log.read_text())) is None:
            await asyncio.sleep(0.05)
    return found[0]


async def _until_up(sockets: list[ClientWebSocketResponse]) -> None:
    async with asyncio.timeout(START_S):
        for socket in sockets:
            while '"state":"up"' not in await socket.receive_str():
                pass


async def _publish_values(rover: Aboard) -> None:
    """Have the rover send so many values a second, each with the time at which it is sent."""
    while True:
        now_s = time.time()
        values = [ParameterValue(each, now_s, now_s % 1.0) for each in PARAMETERS]
        await asyncio.to_thread(rover.do, lambda bench, new=values: bench.link.send_telemetry(new))
        await asyncio.sleep(len(PARAMETERS) / VALUES_HZ - (time.time() - now_s))


async def _receive(socket: ClientWebSocketResponse, delays_s: list[float]) -> None:
    while True:
        batch = json.loads(await socket.receive_str())
        now_s = time.time()
        delays_s += [now_s - message["utc"] for message in batch if message["ty"] == "tm"]
