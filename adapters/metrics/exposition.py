"""`Exposition` makes the page of metrics, `MetricsServer` serves it by HTTP.

A page is made at most once in `MIN_AGE_S`, so that requests in any number cost little. A client has
`TIMEOUT_S` for its request and for reading the page; one connection above the maximum aborts the
first.
"""

import logging
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from importlib.metadata import version
from itertools import accumulate
from pathlib import Path
from socketserver import BaseRequestHandler, ThreadingTCPServer
from threading import Lock, Thread
from typing import Any, Final

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    PlatformCollector,
    ProcessCollector,
    generate_latest,
)
from prometheus_client.core import HistogramMetricFamily, Metric

from adapters.metrics.counts import BUCKETS_S, Histogram, ReportCounter
from adapters.system import OPERATING_SYSTEM, Socket, System

_LOG: Final = logging.getLogger(__name__)
CONTENT_TYPE: Final = CONTENT_TYPE_LATEST
PATH: Final = "/metrics"
MIN_AGE_S: Final = 2.0
TIMEOUT_S: Final = 5.0
MAX_CONNECTIONS: Final = 8
MAX_HEAD_OCTETS: Final = 8192
_POLL_S: Final = 0.2


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
        full, kind = self._prefix + name, "counter" if name.endswith("_total") else "gauge"
        metric = self.metrics.setdefault(full, Metric(full.removesuffix("_total"), text, kind))
        if value is not None:
            metric.add_sample(full, self.labels | labels, value)

    def table(
        self,
        names: Mapping[str, str],
        texts: Mapping[str, str],
        figures: Mapping[str, float | None],
    ) -> None:
        """Add figures by parameter; `names` has their metrics, `texts` their descriptions."""
        for parameter, name in names.items():
            self.add(name, texts[parameter], figures.get(parameter))

    def histogram(self, name: str, text: str, found: Histogram) -> None:
        """Add a histogram."""
        metric = HistogramMetricFamily(self._prefix + name, text, labels=tuple(self.labels))
        bounds = (*map(str, BUCKETS_S), "+Inf")
        buckets = list(zip(bounds, accumulate(found.counts), strict=True))
        metric.add_metric(tuple(self.labels.values()), buckets, found.sum_s)
        self.metrics[metric.name] = metric

    def reports(self, counter: ReportCounter, faults: Iterable[str] = ()) -> None:
        """Add the ends of commands, and the faults, with 0 for those that have not begun."""
        text = "Commands that have ended, by terminal state"
        for (command, state), number in dict(counter.commands).items():
            self.add("commands_total", text, number, command=command, state=state)
        text = "Commands that have ended with a reason: rejected, failed, cancelled"
        for (reason, code), number in dict(counter.reasons).items():
            self.add("command_reasons_total", text, number, reason=reason, code=code)
        text = "Faults that have begun, by name"
        self.add("faults_total", text, None)
        for fault, number in (dict.fromkeys(faults, 0) | counter.faults).items():
            self.add("faults_total", text, number, fault=fault)

    def stores(self, folder: Path, *names: str) -> None:
        """Add the sizes of subfolders, and of databases `NAME.sqlite` with their logs."""
        for name in names:
            path, octets = folder / name, 0
            with suppress(OSError):  # deleted by another thread; the next page is complete
                files = path.rglob("*") if path.is_dir() else folder.glob(f"{name}.sqlite*")
                octets = sum(file.stat().st_size for file in files if file.is_file())
            self.add("store_bytes", "Size of a store on the disk", octets, store=name)


class Exposition:
    """Makes the page of a process.

    Args:
        component: `executive`, `orbiter` or `console`.
        collect: adds the metrics of the process.
        system: its clock.
    """

    def __init__(
        self, component: str, collect: Callable[[Scrape], None], system: System = OPERATING_SYSTEM
    ) -> None:
        self._component, self._collect, self._now_s = component, collect, system.now_s
        self._page, self._made_s, self._lock = b"", -MIN_AGE_S, Lock()
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
        with self._lock:
            now_s = self._now_s()
            if now_s - self._made_s >= MIN_AGE_S:
                self._page, self._made_s = generate_latest(self._registry), now_s
            return self._page


class MetricsServer(ThreadingTCPServer):
    """Serves the page by HTTP from its making until `close`, on threads of its own.

    Args:
        page: makes the page.
        address: host and port; port 0 takes a free one.

    Attributes:
        url: address of the page.

    Raises:
        OSError: the address cannot be served; the text names the remedy.
    """

    allow_reuse_address = daemon_threads = True
    request_queue_size = 64

    def __init__(self, page: Callable[[], bytes], address: tuple[str, int]) -> None:
        self._page = page
        self._open: list[Socket] = []
        host = f"[{address[0]}]" if ":" in address[0] else address[0]
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        try:
            super().__init__(address, BaseRequestHandler)
        except (OSError, UnicodeError) as error:  # an impossible name of a host is no OSError
            why = getattr(error, "strerror", None) or error
            text = f"metrics cannot be served at {host}:{address[1]} ({why})"
            raise OSError(f"{text}: choose another address with --metrics") from error
        self.url = f"http://{host}:{self.server_address[1]}{PATH}"
        Thread(target=self.serve_forever, args=(_POLL_S,), name="metrics", daemon=True).start()

    def close(self) -> None:
        """Stop serving."""
        self.shutdown()
        self.server_close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start the thread of a connection; one above the maximum ends the first."""
        self._open = [each for each in self._open if each.fileno() >= 0]
        for first in self._open[: 1 - MAX_CONNECTIONS]:
            with suppress(OSError):
                first.shutdown(socket.SHUT_RDWR)  # its thread then reads the end, and closes it
        self._open.append(request)
        super().process_request(request, client_address)

    def finish_request(self, request: Any, client_address: Any) -> None:
        """Answer a request, on the thread of its connection."""
        end_s, head = OPERATING_SYSTEM.now_s() + TIMEOUT_S, b""
        while b"\r\n\r\n" not in head:
            request.settimeout(max(0.001, end_s - OPERATING_SYSTEM.now_s()))
            received = request.recv(MAX_HEAD_OCTETS)
            if not received or len(head) > MAX_HEAD_OCTETS:
                return
            head += received
        request.sendall(self._response(head))

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignored: a client disconnected, or was too slow."""

    def _response(self, head: bytes) -> bytes:
        method, target, *_ = (*head.split(b" ", 2), b"")
        kind = "text/plain; charset=utf-8"
        if method not in (b"GET", b"HEAD"):
            status, body = "405 Method Not Allowed", b"only GET\n"
        elif target.partition(b"?")[0] != PATH.encode():
            status, body = "404 Not Found", f"see {PATH}\n".encode()
        else:
            try:
                status, body, kind = "200 OK", self._page(), CONTENT_TYPE
            except Exception as error:
                _LOG.error("the page of metrics cannot be made: %r", error)
                status, body = "500 Internal Server Error", b"see the log\n"
        lines = (f"HTTP/1.1 {status}", f"Content-Type: {kind}", f"Content-Length: {len(body)}")
        head = "\r\n".join((*lines, "Connection: close", "", "")).encode()
        return head if method == b"HEAD" else head + body
