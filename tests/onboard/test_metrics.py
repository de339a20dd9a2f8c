"""The metrics of an executive: what commands and faults change in them, and who requests them."""

import select
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path

import pytest
from click.testing import CliRunner

from adapters.metrics import exposition
from adapters.metrics.exposition import (
    MAX_CONNECTIONS,
    MAX_HEAD_OCTETS,
    Exposition,
    MetricsServer,
    Scrape,
)
from adapters.mrs.link import MrsLink
from adapters.onboard.housekeeping import ExecutiveHousekeeping
from adapters.onboard.metrics import ExecutiveMetrics
from adapters.onboard.process import main
from executive.commands import MoveForward, Resume, RotateBy, SetTravelSpeed, Stop
from executive.values.ports import Downlink
from tests.core.test_pose_uncertainty import moved
from tests.support.ground import carry_out
from tests.support.kinematic import Bench
from tests.support.metrics import (
    Page,
    check_documented,
    connect,
    exchange,
    scrape,
    scrape_until,
)
from tests.support.ports import HOST
from tests.support.processes import Running, executive

REASONS = "rover_executive_command_reasons_total"
COMMANDS = "rover_executive_commands_total"
REPORTS = "rover_executive_reports_total"
TICKS = "rover_executive_tick_duration_seconds_count"


@contextmanager
def measured(folder: Path, *arguments: str) -> Iterator[tuple[Running, str, str]]:
    """Run an executive without a rover; give the process, and the addresses of both servers."""
    with executive(folder, "--metrics", "0", *arguments) as (process, uri):
        yield process, uri, process.output(r"metrics at (http://\S+)")


def ended(page: Page) -> dict[tuple[str, str], float]:
    """Return the numbers of ended commands by command and state, and of reasons, without 0."""
    labels = {COMMANDS: ("command", "state"), REASONS: ("reason", "code")}
    return {
        (each.labels[first], each.labels[second]): each.value
        for each in page.samples
        if each.value
        for first, second in [labels.get(each.name, ("", ""))]
        if first
    }


@pytest.mark.ros
@pytest.mark.slow
def test_ended_commands_are_counted_while_hostile_clients_connect(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain
    with measured(tmp_path) as (process, uri, url):
        before = scrape(url)
        assert ended(before) == {}
        assert before.value(COMMANDS, command="moveForward", state="FAILED") == 0.0
        assert before.value("rover_build_info", component="executive") == 1.0
        carry_out(uri, MoveForward(1.0), SetTravelSpeed(0.3), Stop(), MoveForward(1.0), Resume())
        expected = {
            ("moveForward", "REJECTED"): 2.0,
            ("NO_ODOMETRY", "203"): 1.0,
            ("WRONG_MODE", "201"): 1.0,
            ("setTravelSpeed", "EXECUTED"): 1.0,
            ("stop", "FAILED"): 1.0,
            ("STOP_DEADLINE", "721"): 1.0,
            ("resume", "EXECUTED"): 1.0,
        }
        page = scrape_until(url, lambda page: len(ended(page)) == len(expected))
        assert ended(page) == expected
        hostile_clients_are_harmless(uri, url)
        page = scrape_until(
            url, lambda page: page.value("rover_executive_mode", mode="IDLE") == 1.0
        )
        page.check_names()
        check_documented(page, "executive")
        assert page.value("rover_executive_mode") == 1.0
        assert page.value("rover_executive_store_bytes", store="ledger") > 1000.0  # type: ignore[operator]
        assert page.value("rover_executive_link_received_messages_total") >= 6.0  # type: ignore[operator]
        assert page.value("process_resident_memory_bytes") > 1e7  # type: ignore[operator]
        assert process.end() == 0
        assert "Traceback" not in process.text


def hostile_clients_are_harmless(uri: str, url: str) -> None:
    """Let clients hang, flood and send nonsense, while the executive ticks and obeys."""
    with ExitStack() as open_clients:
        for _ in range(3 * MAX_CONNECTIONS):
            client = open_clients.enter_context(connect(url))
            client.sendall(b"GET /metrics HTTP/1.1\r\nX-Slow: ")
        ticks = scrape(url).value(TICKS) or 0.0
        (outcome,) = carry_out(uri, SetTravelSpeed(0.2))
        assert outcome.executed
        scrape_until(url, lambda page: (page.value(TICKS) or 0.0) > ticks)
    for request, status in (
        (b"POST /metrics HTTP/1.1\r\n\r\n", b"405"),
        (b"DELETE /metrics HTTP/1.1\r\n\r\n", b"405"),
        (b"GET / HTTP/1.1\r\n\r\n", b"404"),
        (b"GET /metrics/../etc/passwd HTTP/1.1\r\n\r\n", b"404"),
        (b"\r\n\r\n", b"405"),
        (b"\xff\x00 \xfe\r\n\r\n", b"405"),
    ):
        assert exchange(url, request).split(b" ")[1] == status, request
    assert exchange(url, b"HEAD /metrics?x=1 HTTP/1.0\r\n\r\n").endswith(b"\r\n\r\n")
    for flood in (b"x" * 3 * MAX_HEAD_OCTETS, b"GET /" + b"y" * 3 * MAX_HEAD_OCTETS + b"\r\n\r\n"):
        with suppress(ConnectionError):
            assert exchange(url, flood) == b""


class CountedBench(Bench):
    """A bench whose executive is counted."""

    metrics: ExecutiveMetrics

    def downlinks(self) -> list[Downlink]:
        self.metrics = ExecutiveMetrics(self.settings, self.folder, MrsLink(self.settings))
        self.metrics.attach(self.ledger)
        return [*super().downlinks(), self.metrics]

    def page(self) -> Page:
        """Measure, and return what is served then."""
        housekeeping = ExecutiveHousekeeping(self.folder)
        housekeeping.metrics = self.metrics
        housekeeping.measure(self.executive)
        page = Exposition("executive", self.metrics.collect).page
        with closing(MetricsServer(page, (HOST, 0))) as server:
            return scrape(server.url)


def test_a_fault_is_active_until_it_ends_and_is_counted_once(tmp_path: Path) -> None:
    fault = {"fault": "odometry_jumped"}

    def shown(bench: CountedBench) -> tuple[float | None, ...]:
        page = bench.page()
        return (
            page.value("rover_executive_fault_active", **fault),
            page.value("rover_executive_faults_total", **fault),
            page.value("rover_executive_mode", mode="SAFE"),
        )

    with CountedBench(tmp_path) as bench:
        bench.run(1.0)
        assert shown(bench) == (0.0, 0.0, 0.0)
        bench.rover.pose = moved(bench.rover.pose, x_m=0.5)
        bench.run(0.5)
        assert shown(bench) == (1.0, 1.0, 1.0)
        bench.submit(Resume(), 90)
        bench.run(0.5)
        assert shown(bench) == (0.0, 1.0, 0.0)


def test_a_command_that_a_crash_interrupts_is_counted_once_by_the_next_process(
    tmp_path: Path,
) -> None:
    with CountedBench(tmp_path) as bench:
        bench.run(1.0)
        bench.submit(RotateBy(1.0), 1)
        bench.run(0.5)
        before = bench.page()
        assert ended(before) == {}
    with CountedBench(tmp_path) as bench:
        bench.run(1.0)
        interrupted = {("rotateBy", "FAILED"): 1.0, ("INTERRUPTED", "803"): 1.0}
        after = bench.page()
        assert ended(after) == interrupted
        assert (after.value(REPORTS) or 0.0) > (before.value(REPORTS) or 0.0) > 0.0
        bench.submit(RotateBy(1.0), 1)
        bench.run(0.5)
        assert ended(bench.page()) == interrupted, "a repeat is answered, and not counted again"
    with CountedBench(tmp_path) as bench:
        assert ended(bench.page()) == {}, "counters begin anew, as Prometheus expects"


@pytest.mark.parametrize("address", ["x", "9464x", "127.0.0.1", "127.0.0.1:99999", ":", "-1"])
def test_a_wrong_address_is_a_usage_error(address: str) -> None:
    typed = CliRunner().invoke(main, ["--metrics", address])
    assert (typed.exit_code, "is not PORT or HOST:PORT" in typed.output) == (2, True)


def test_slow_and_surplus_clients_are_disconnected(monkeypatch: pytest.MonkeyPatch) -> None:
    page = Exposition("executive", lambda _: None).page
    monkeypatch.setattr(exposition, "TIMEOUT_S", 1e6)
    with closing(MetricsServer(page, (HOST, 0))) as server, ExitStack() as clients:
        url = server.url
        slow = [clients.enter_context(connect(url)) for _ in range(MAX_CONNECTIONS + 1)]
        for client in slow:
            client.sendall(b"GET /metrics HTTP/1.1\r\nX-Slow: ")
        with suppress(ConnectionResetError):
            assert slow[0].recv(1) == b"", "one more than the maximum ends the first"
        slow[-1].sendall(b"\r\n\r\n")
        assert slow[-1].recv(12) == b"HTTP/1.1 200"
        monkeypatch.setattr(exposition, "TIMEOUT_S", 0.05)
        dribbling = clients.enter_context(connect(url))
        with suppress(ConnectionError):
            while not select.select([dribbling], [], [], 0.01)[0]:
                dribbling.sendall(b"G")


def test_a_page_that_cannot_be_made_is_an_error_in_one_line(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def fail(_: Scrape) -> None:
        raise KeyError("of a defect")

    with closing(MetricsServer(Exposition("executive", fail).page, (HOST, 0))) as server:
        answer = exchange(server.url, b"GET /metrics HTTP/1.1\r\n\r\n")
    assert answer.startswith(b"HTTP/1.1 500 "), answer
    assert [each.getMessage() for each in caplog.records] == [
        "the page of metrics cannot be made: KeyError('of a defect')"
    ]


def test_an_address_that_cannot_be_served_names_the_remedy() -> None:
    for host in ("x" * 64, "192.0.2.1"):
        with pytest.raises(OSError, match=r"cannot be served at .*: choose another address"):
            MetricsServer(bytes, (host, 0))


def test_a_folder_that_is_deleted_while_it_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "files").mkdir()
    monkeypatch.setattr(Path, "rglob", lambda *_: (tmp_path / "gone").iterdir())
    found = Scrape("rover_executive_")
    found.stores(tmp_path, "files")
    (metric,) = found.metrics.values()
    assert [each.value for each in metric.samples] == [0]
