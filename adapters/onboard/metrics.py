"""`ExecutiveMetrics` counts on the core's thread what another thread serves for Prometheus.

Reports are counted once they are committed. The other values are those of the housekeeping, and as
old (`snapshot_age_seconds`): nothing is measured for a request, so requests cost the core nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from adapters.metrics import ReportCounter
from adapters.mrs.link import MrsLink
from adapters.mrs.spec import EXECUTIVE_HOUSEKEEPING
from adapters.process import StartError
from adapters.ros import TickStatistics
from adapters.system import OPERATING_SYSTEM
from executive.commands import Mode
from executive.core.runner import Executive
from executive.record import Ledger
from executive.settings import Settings
from executive.values.parameters import ParameterValue
from executive.values.reports import FileEvent, PlanUpdate, Report

if TYPE_CHECKING:
    from adapters.metrics.exposition import Scrape

_NAMES: Final = {
    "EXEC_OVERRUNS": "late_ticks_total",
    "EXEC_QUEUED": "inbox_queued",
    "EXEC_GOALS": "goals",
    "EXEC_UNWRITTEN": "ledger_unwritten_commits",
    "EXEC_COMMIT_WAIT": "ledger_commit_wait_seconds",
    "EXEC_REPORTS": "reports_total",
    "EXEC_POSITION_UNCERTAINTY": "position_uncertainty_meters",
    "EXEC_DISK_FREE": "disk_free_bytes",
}
_TEXTS: Final = {each.name: each.description for each in EXECUTIVE_HOUSEKEEPING}
_LINK: Final = {
    "connections": ("link_connections", "Open connections of clients"),
    "received_messages": ("link_received_messages_total", "Messages received from clients"),
    "received_octets": ("link_received_bytes_total", "Octets received from clients"),
    "sent_messages": ("link_sent_messages_total", "Messages sent to clients"),
    "sent_octets": ("link_sent_bytes_total", "Octets sent to clients"),
}


class ExecutiveMetrics:
    """Collects the metrics of an executive; implements `executive.values.ports.Downlink`.

    Args:
        data: folder of the ledger, recordings and files.
        link: its direct link.
    """

    def __init__(self, settings: Settings, data: Path, link: MrsLink) -> None:
        self._settings, self._data, self._link = settings, data, link
        self._ledger: Ledger | None = None
        self._reports = ReportCounter()
        self._measured_s, self._ticks = OPERATING_SYSTEM.now_s(), TickStatistics()
        self._figures: Mapping[str, float | None] = {}
        self._mode: Mode | None = None
        self._faults = set[str]()
        self._silent_s: float | None = None

    def attach(self, ledger: Ledger) -> None:
        """Count the reports that are added to a ledger from now on."""
        self._ledger = ledger
        self._reports.resume(ledger.last_sequence, (command for command, _ in ledger.unfinished()))

    def note(
        self,
        executive: Executive,
        figures: Mapping[str, float | None],
        ticks: TickStatistics | None,
    ) -> None:
        """Store the values of a measurement; on the core's thread."""
        self._measured_s, self._figures = OPERATING_SYSTEM.now_s(), figures
        self._ticks, self._mode = ticks or self._ticks, executive.mode
        self._faults = {each.name for each in executive.safety.active}
        self._silent_s = executive.ground.silent_s

    def send_reports(self, reports: Sequence[Report]) -> None:
        """Count committed reports."""
        for report in reports:
            self._reports.note(report, report.sequence)

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Ignored."""

    def send_file_event(self, event: FileEvent) -> None:
        """Ignored."""

    def send_plan_update(self, update: PlanUpdate) -> None:
        """Ignored."""

    def collect(self, scrape: "Scrape") -> None:
        """Add the metrics to a page; on the thread that serves it."""
        scrape.labels = {"asset": self._settings.asset}
        age_s = OPERATING_SYSTEM.now_s() - self._measured_s
        scrape.add("snapshot_age_seconds", "Age of the measured values", age_s)
        scrape.histogram("tick_duration_seconds", "Duration of a tick", self._ticks.durations)
        scrape.histogram("tick_lateness_seconds", "Lateness of a tick", self._ticks.lateness)
        scrape.table(_NAMES, _TEXTS, self._figures)
        commits = None if self._ledger is None else self._ledger.state.durable
        scrape.add("ledger_commits_total", "Commits of the ledger", commits)
        text = "Time since the last contact with the ground"
        scrape.add("ground_contact_age_seconds", text, self._silent_s)
        for mode in Mode:
            scrape.add("mode", "1 for the present mode", mode is self._mode, mode=mode.name)
        faults, active = {each.name for each, _ in self._settings.faults}, self._faults
        scrape.reports(self._reports, faults)
        for name in faults | active:
            scrape.add("fault_active", "1 for an active fault", name in active, fault=name)
        for name, (metric, text) in _LINK.items():
            scrape.add(metric, text, getattr(self._link.traffic, name, None))
        scrape.stores(self._data, "ledger", "recordings", "files")


@contextmanager
def served(metrics: ExecutiveMetrics, address: tuple[str, int]) -> Iterator[None]:
    """Serve the metrics within the context, and print their URL.

    Raises:
        StartError: the address cannot be served.
    """
    from adapters.metrics.exposition import Exposition, MetricsServer

    try:
        server = MetricsServer(Exposition("executive", metrics.collect).page, address)
    except OSError as error:
        raise StartError(str(error)) from error
    with closing(server):
        print(f"metrics at {server.url}", flush=True)
        yield
