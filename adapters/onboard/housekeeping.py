"""`ExecutiveHousekeeping`: measures the health figures of the process `rover-executive`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

from adapters.mrs.link import MrsLink
from adapters.mrs.spec import (
    EXECUTIVE,
    EXECUTIVE_HOUSEKEEPING,
    HousekeepingParameter,
    map_figures,
    uncertainty_figures,
    usage_figures,
)
from adapters.onboard.metrics import ExecutiveMetrics
from adapters.process import ResourceMonitor
from adapters.ros import TickStatistics
from executive.core.runner import Executive
from executive.settings import Settings


@runtime_checkable
class HousekeepingProvider(Protocol):
    """A rover class that also provides the health figures of the process that it uses."""

    def housekeeping(self) -> Mapping[str, float | None]:
        """Return the last received figures, by the names of `NXT_HOUSEKEEPING`."""


_LEDGER_FILES: Final = ("ledger.sqlite", "ledger.sqlite-wal")


class ExecutiveHousekeeping:
    """Measures figures that the core does not have; on the core's thread.

    Args:
        data: folder of the ledger.

    Attributes:
        publish: called with the figures.
        rover: the rover class, if it provides figures.
        metrics: stores each measurement, if metrics are served.
    """

    def __init__(
        self, data: Path, parameters: tuple[HousekeepingParameter, ...] = EXECUTIVE_HOUSEKEEPING
    ) -> None:
        self.parameters = parameters
        self.rover: HousekeepingProvider | None = None
        self.metrics: ExecutiveMetrics | None = None
        self.publish: Callable[[Mapping[str, float | None]], None] = lambda _: None
        self._data = data
        self._usage = ResourceMonitor(data)
        self._ticks: list[TickStatistics] = []

    def count(self, settings: Settings, link: MrsLink) -> ExecutiveMetrics:
        """Store each measurement for metrics from now on, and return these."""
        self.metrics = ExecutiveMetrics(settings, self._data, link)
        return self.metrics

    def note(self, ticks: TickStatistics) -> None:
        """Add the statistics of the ticks since the last call."""
        self._ticks.append(ticks)

    def measure(self, executive: Executive) -> dict[str, float | None]:
        """Return the figures since the last call, by the names of the parameters."""
        ticks, self._ticks = self._ticks, []
        max_tick_s = max((each.max_tick_s for each in ticks), default=None)
        unwritten, commit_wait_s = executive.commit_backlog
        figures = {
            "EXEC_TICK": max_tick_s,
            "EXEC_TICK_PERIOD": max((each.max_period_s for each in ticks), default=None),
            "EXEC_OVERRUNS": ticks[-1].overruns if ticks else None,
            "EXEC_QUEUED": executive.waiting,
            "EXEC_GOALS": executive.goal_count,
            "EXEC_LEDGER": self._ledger_octets(),
            "EXEC_UNWRITTEN": unwritten,
            "EXEC_COMMIT_WAIT": commit_wait_s,
            "EXEC_REPORTS": executive.last_sequence,
            **map_figures(executive.status.map_origin),
            **uncertainty_figures(executive.status.uncertainty.figures),
            **usage_figures(EXECUTIVE, self._usage.measure()),
        }
        if self.rover is not None:
            figures |= self.rover.housekeeping()
        self.publish(figures)
        if self.metrics is not None:
            self.metrics.note(executive, figures, ticks[-1] if ticks else None)
        return figures

    def _ledger_octets(self) -> int:
        files = (self._data / name for name in _LEDGER_FILES)
        return sum(file.stat().st_size for file in files if file.exists())
