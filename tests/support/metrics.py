"""What Prometheus would read: a page of metrics over a socket, parsed, with its names checked."""

import re
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from urllib.parse import urlsplit

from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.samples import Sample

from tests.suite import CHECKOUT
from tests.support.ports import HOST

LIMIT_S = 60.0
DOCUMENTED = CHECKOUT / "docs" / "metrics.md"
BASE_UNITS = {"seconds", "bytes", "meters", "radians"}
OTHER_UNITS = {
    *("ms", "milliseconds", "s", "minutes", "hours", "octets", "mb", "kb", "percent", "m", "rad"),
    *("degrees", "hz"),
}
_ROW = re.compile(r"^\| `(\w+)` \| (\w+) \| ([\w`, ]*) \| (.+) \|$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Described:
    """A metric as a page of metrics, or of the documentation, describes it."""

    name: str
    kind: str
    labels: tuple[str, ...]
    text: str


@dataclass(frozen=True, slots=True)
class Page:
    """A page of metrics."""

    text: str

    @property
    def samples(self) -> Iterator[Sample]:
        for family in text_string_to_metric_families(self.text):
            yield from family.samples

    def value(self, name: str, **labels: str) -> float | None:
        """Return the sum of the samples of a name that have some labels; None without any."""
        found = [
            each.value
            for each in self.samples
            if each.name == name and labels.items() <= each.labels.items()
        ]
        return sum(found) if found else None

    def described(self) -> dict[str, Described]:
        """Return what the page says of each metric of a rover, by its name in queries."""
        found = {}
        for family in text_string_to_metric_families(self.text):
            if family.name.startswith("rover_") and family.name != "rover_build_info":
                name = f"{family.name}_total" if family.type == "counter" else family.name
                labels = {label for each in family.samples for label in each.labels} - {"le"}
                text = family.documentation
                found[name] = Described(name, family.type, tuple(sorted(labels)), text)
        return found

    def check_names(self) -> None:
        """Check the rules of https://prometheus.io/docs/practices/naming, as promtool does."""
        for family in text_string_to_metric_families(self.text):
            if not family.name.startswith("rover_") or family.name == "rover_build_info":
                continue
            name, parts = family.name, family.name.split("_")
            assert re.fullmatch(r"[a-z][a-z0-9_]*", name), name
            assert family.documentation, name
            assert not OTHER_UNITS & set(parts), name
            units = [word for word in parts if word in BASE_UNITS]
            assert not units or parts[-1] in units, f"{name}: the unit is last"
            assert not name.endswith(("_count", "_sum", "_bucket", "_total", "_info")), name
            assert family.type in {"gauge", "counter", "histogram"}, name
        for each in self.samples:
            assert all(re.fullmatch(r"[a-z]+", label) for label in each.labels), each
            assert all(value or label in {"reason", "code"} for label, value in each.labels.items())
        series = [(each.name, *sorted(each.labels.items())) for each in self.samples]
        assert len(set(series)) == len(series) < 600


def documented(component: str) -> dict[str, Described]:
    """Return what the documentation says of the metrics of a process, by name."""
    rows = _ROW.findall(DOCUMENTED.read_text(encoding="utf-8"))
    return {
        name: Described(name, kind, tuple(re.findall(r"\w+", labels)), text)
        for name, kind, labels, text in rows
        if name.startswith(f"rover_{component}_")
    }


def check_documented(page: Page, component: str) -> None:
    """Check that the documentation describes the metrics of a page, and no others."""
    shown, described = page.described(), documented(component)
    for name, each in shown.items():
        if not each.labels:  # without a sample until something happens
            shown[name] = Described(name, each.kind, described[name].labels, each.text)
    assert shown == described


def connect(url: str) -> socket.socket:
    return socket.create_connection((HOST, urlsplit(url).port or 0), LIMIT_S)


def exchange(url: str, request: bytes) -> bytes:
    """Send octets, and return all that is answered until the connection ends."""
    answer = b""
    with connect(url) as client:
        client.sendall(request)
        while received := client.recv(1 << 16):
            answer += received
    return answer


def scrape(url: str) -> Page:
    """Return the page, as Prometheus requests it."""
    answer = exchange(url, f"GET {urlsplit(url).path} HTTP/1.1\r\nHost: rover\r\n\r\n".encode())
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200 OK"), head
    assert f"Content-Length: {len(body)}".encode() in head
    return Page(body.decode())


def scrape_until(url: str, wanted: Callable[[Page], bool]) -> Page:
    """Return the first page that is as wanted; a page is a few seconds old."""
    end_s = time.monotonic() + LIMIT_S
    while not wanted(page := scrape(url)):
        assert time.monotonic() < end_s, page.text
        time.sleep(0.2)
    return page
