"""`ExecutiveMetrics` counts on the core's thread what another thread serves for Prometheus.

Reports are counted once they are committed. The other values are those of the housekeeping, and as
old (`snapshot_age_seconds`): nothing is measured for a request, so requests cost the core nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
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
    "EXEC_HEADING_UNCERTAINTY": "heading_uncertainty_radians",
    "EXEC_DISK_FREE": "disk_free_bytes",
}


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Values of one measurement of the housekeeping; None before the first."""

    at_s: float | None = None
    figures: Mapping[str, float | None] = field(default_factory=dict)
    ticks: TickStatistics | None = None
    mode: Mode | None = None
    faults: frozenset[str] = frozenset()
    commits: int | None = None
    silent_s: float | None = None


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
        self._latest = Snapshot()

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
        self._latest = Snapshot(
            OPERATING_SYSTEM.now_s(),
            figures,
            ticks or self._latest.ticks,
            executive.mode,
            frozenset(each.name for each in executive.safety.active),
            None if self._ledger is None else self._ledger.state.durable,
            executive.ground.silent_s,
        )

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
        now, scrape.labels = self._latest, {"asset": self._settings.asset}
        age_s = None if now.at_s is None else OPERATING_SYSTEM.now_s() - now.at_s
        scrape.add("snapshot_age_seconds", "Age of the measured values", age_s)
        durations, lateness = (
            (now.ticks.durations, now.ticks.lateness) if now.ticks else (None,) * 2
        )
        scrape.histogram("tick_duration", "Duration of a tick", durations)
        scrape.histogram("tick_lateness", "Lateness of a tick", lateness)
        scrape.table(_NAMES, EXECUTIVE_HOUSEKEEPING, now.figures)
        scrape.add("ledger_commits_total", "Commits of the ledger", now.commits)
        text = "Time since the last contact with the ground"
        scrape.add("ground_contact_age_seconds", text, now.silent_s)
        for mode in Mode:
            scrape.add("mode", "1 for the present mode", mode is now.mode, mode=mode.name)
        scrape.reports(self._reports)
        declared = {each.name for each, _ in self._settings.faults}
        scrape.faults(self._reports, declared)
        for name in declared | now.faults:
            scrape.add("fault_active", "1 for an active fault", name in now.faults, fault=name)
        scrape.traffic(self._link.traffic)
        scrape.store("ledger", now.figures.get("EXEC_LEDGER"))
        scrape.stores(self._data, "recordings", "files")


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
