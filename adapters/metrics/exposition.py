"""`Exposition` makes the page of metrics, `serving` serves it by HTTP, without a command in it.

A page is made at most once in `MIN_AGE_S`, so that requests in any number cost little. A client has
`TIMEOUT_S` for its request and for reading the page; one connection above the maximum aborts the
first.
"""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import asynccontextmanager, contextmanager, suppress
from importlib.metadata import version
from itertools import accumulate
from pathlib import Path
from threading import Thread
from typing import Any, Final, Protocol

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    PlatformCollector,
    ProcessCollector,
    generate_latest,
)
from prometheus_client.core import Metric

from adapters.metrics.counts import BUCKETS_S, Histogram, ReportCounter
from adapters.system import OPERATING_SYSTEM, System

CONTENT_TYPE: Final = CONTENT_TYPE_LATEST
PATH: Final = "/metrics"
MIN_AGE_S: Final = 2.0
TIMEOUT_S: Final = 5.0
MAX_CONNECTIONS: Final = 8
MAX_HEAD_OCTETS: Final = 8192
_TOTAL: Final = "_total"
_LINK: Final = {
    "connections": ("link_connections", "Open connections of clients"),
    "received_messages": ("link_received_messages_total", "Messages received from clients"),
    "received_octets": ("link_received_bytes_total", "Octets received from clients"),
    "sent_messages": ("link_sent_messages_total", "Messages sent to clients"),
    "sent_octets": ("link_sent_bytes_total", "Octets sent to clients"),
}


class Described(Protocol):
    """A parameter of the MRS: its name and its description."""

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def description(self) -> str: ...  # noqa: D102


class Scrape:
    """The metrics of one page, which all have a prefix.

    Args:
        prefix: such as `rover_executive_`.

    Attributes:
        metrics: by name.
        labels: labels of all samples that are added from now on.
    """

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self.metrics: dict[str, Metric] = {}
        self.labels: dict[str, str] = {}

    def add(self, name: str, text: str, value: float | None, **labels: str) -> None:
        """Add a gauge, or a counter if the name ends in `_total`; None declares it only."""
        kind = "counter" if name.endswith(_TOTAL) else "gauge"
        metric = self._metric(name, text, kind)
        if value is not None:
            metric.add_sample(self._prefix + name, self.labels | labels, value)

    def table(
        self,
        names: Mapping[str, str],
        parameters: Iterable[Described],
        figures: Mapping[str, float | None],
    ) -> None:
        """Add figures of parameters that have the name of a metric."""
        for each in parameters:
            if each.name in names:
                self.add(names[each.name], each.description, figures.get(each.name))

    def histogram(self, name: str, text: str, found: Histogram | None) -> None:
        """Add a histogram, and its maximum as a gauge."""
        metric = self._metric(f"{name}_seconds", text, "histogram")
        max_s = None if found is None else found.max_s
        self.add(f"{name}_max_seconds", f"{text}: maximum since the start", max_s)
        if found is None:
            return
        full, sums = f"{self._prefix}{name}_seconds", list(accumulate(found.counts))
        for bound, number in zip((*map(str, BUCKETS_S), "+Inf"), sums, strict=True):
            metric.add_sample(f"{full}_bucket", {**self.labels, "le": bound}, number)
        metric.add_sample(f"{full}_count", self.labels, sums[-1])
        metric.add_sample(f"{full}_sum", self.labels, found.sum_s)

    def reports(self, counter: ReportCounter) -> None:
        """Add the ends of commands."""
        text = "Commands that have ended, by terminal state"
        for (command, state), number in dict(counter.commands).items():
            self.add("commands_total", text, number, command=command, state=state)
        text = "Commands that have ended with a reason: rejected, failed, cancelled"
        for (reason, code), number in dict(counter.reasons).items():
            self.add("command_reasons_total", text, number, reason=reason, code=code)

    def faults(self, counter: ReportCounter, names: Iterable[str] = ()) -> None:
        """Add the numbers of faults, with 0 for those of `names` that have not begun."""
        text = "Faults that have begun, by name"
        self.add("faults_total", text, None)
        for name, number in (dict.fromkeys(names, 0) | counter.faults).items():
            self.add("faults_total", text, number, fault=name)

    def traffic(self, traffic: object) -> None:
        """Add the traffic of a provider's clients (`adapters.mal.LinkTraffic`)."""
        for name, (metric, text) in _LINK.items():
            self.add(metric, text, getattr(traffic, name, None))

    def store(self, name: str, octets: float | None) -> None:
        """Add the size of a store."""
        self.add("store_bytes", "Size of a store on the disk", octets, store=name)

    def stores(self, folder: Path, *names: str) -> None:
        """Add the sizes of subfolders, and of databases `NAME.sqlite` with their logs."""
        for name in names:
            path = folder / name
            files = path.rglob("*") if path.is_dir() else folder.glob(f"{name}.sqlite*")
            octets = 0
            for file in files:
                with suppress(OSError):  # deleted by another thread
                    octets += file.stat().st_size if file.is_file() else 0
            self.store(name, octets)

    def _metric(self, name: str, text: str, kind: str) -> Metric:
        full = self._prefix + name.removesuffix(_TOTAL)
        return self.metrics.setdefault(full, Metric(full, text, kind))


class Exposition:
    """Makes the page of a process; on one thread.

    Args:
        component: `executive`, `orbiter` or `console`.
        collect: adds the metrics of the process.
        system: its clock.
    """

    def __init__(
        self, component: str, collect: Callable[[Scrape], None], system: System = OPERATING_SYSTEM
    ) -> None:
        self._component, self._collect, self._now_s = component, collect, system.now_s
        self._page, self._made_s = b"", -MIN_AGE_S
        self._registry = CollectorRegistry()
        ProcessCollector(registry=self._registry)
        PlatformCollector(registry=self._registry)
        self._registry.register(self)

    def collect(self) -> Iterator[Metric]:
        """Yield the metrics; called by the registry."""
        build = Scrape("rover_")
        labels = {"component": self._component, "version": version("rover-executive")}
        build.add("build_info", "Version of this process", 1.0, **labels)
        scrape = Scrape(f"rover_{self._component}_")
        self._collect(scrape)
        yield from (*build.metrics.values(), *scrape.metrics.values())

    def page(self) -> bytes:
        """Return the page, at most `MIN_AGE_S` old."""
        now_s = self._now_s()
        if now_s - self._made_s >= MIN_AGE_S:
            self._page, self._made_s = generate_latest(self._registry), now_s
        return self._page


@asynccontextmanager
async def serving(
    exposition: Exposition, address: tuple[str, int], system: System = OPERATING_SYSTEM
) -> AsyncIterator[str]:
    """Serve the page within the context; yields its URL.

    Raises:
        OSError: the address cannot be served; the text names the remedy.
    """
    connections: dict[asyncio.StreamWriter, None] = {}

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(connections) >= MAX_CONNECTIONS:
            first = next(iter(connections))
            del connections[first]
            first.transport.abort()
        connections[writer] = None
        try:
            async with asyncio.timeout(TIMEOUT_S):
                writer.write(_response(await reader.readuntil(b"\r\n\r\n"), exposition))
                writer.close()
                await writer.wait_closed()
        except (OSError, EOFError, asyncio.LimitOverrunError):  # a TimeoutError is an OSError
            pass
        finally:
            connections.pop(writer, None)
            writer.transport.abort()

    host, port = address
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listener = system.listen(address, family)
    except OSError as error:
        text = f"metrics cannot be served at {host}:{port} ({error.strerror})"
        raise OSError(f"{text}: choose another address with --metrics") from error
    server = await asyncio.start_server(answer, sock=listener, limit=MAX_HEAD_OCTETS)
    shown = f"[{host}]" if ":" in host else host
    try:
        yield f"http://{shown}:{listener.getsockname()[1]}{PATH}"
    finally:
        server.close()
        for writer in connections:
            writer.transport.abort()


@contextmanager
def serving_on_thread(exposition: Exposition, address: tuple[str, int]) -> Iterator[str]:
    """Serve the page on a thread of its own within the context, as `serving`."""
    started: Future[tuple[str, Callable[[], Any]]] = Future()

    async def serve() -> None:
        over, loop = asyncio.Event(), asyncio.get_running_loop()
        async with serving(exposition, address) as url:
            started.set_result((url, lambda: loop.call_soon_threadsafe(over.set)))
            await over.wait()

    def run() -> None:
        try:
            asyncio.run(serve())
        except OSError as error:
            started.set_exception(error)

    thread = Thread(target=run, name="metrics", daemon=True)
    thread.start()
    url, end = started.result()
    try:
        yield url
    finally:
        end()
        thread.join()


def _response(head: bytes, exposition: Exposition) -> bytes:
    """Return the response to the head of a request."""
    method, target, *_ = (*head.split(b" ", 2), b"")
    kind = "text/plain; charset=utf-8"
    if method not in (b"GET", b"HEAD"):
        status, body = "405 Method Not Allowed", b"only GET\n"
    elif target.partition(b"?")[0] != PATH.encode():
        status, body = "404 Not Found", f"see {PATH}\n".encode()
    else:
        status, body, kind = "200 OK", exposition.page(), CONTENT_TYPE
    lines = (f"HTTP/1.1 {status}", f"Content-Type: {kind}", f"Content-Length: {len(body)}")
    head = "\r\n".join((*lines, "Connection: close", "", "")).encode()
    return head if method == b"HEAD" else head + body
