"""`diagnostic_array`: the health of a node or executive, with tick statistics, for /diagnostics."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter
from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from adapters.metrics import Histogram
from executive.commands import Mode
from executive.faults import summary
from executive.safety import unmonitored
from trees import NodeStatus, TreeSnapshot

if TYPE_CHECKING:
    from executive.core.runner import Executive


@dataclass(slots=True)
class TickStatistics:
    """Statistics of the ticks since the last diagnosis.

    Attributes:
        periods, elapsed_s: number of intervals between ticks, and their sum.
        overruns: ticks since the start that were late by half a period or lasted more than one.
        durations, lateness: of all ticks since the start; these objects change.
    """

    ticks: int = 0
    periods: int = 0
    elapsed_s: float = 0.0
    max_period_s: float = 0.0
    max_tick_s: float = 0.0
    overruns: int = 0
    durations: Histogram = field(default_factory=Histogram)
    lateness: Histogram = field(default_factory=Histogram)

    @property
    def period_s(self) -> float | None:
        """Mean time between ticks, s; None with fewer than two."""
        return self.elapsed_s / self.periods if self.periods else None


class TickMonitor:
    """Measures ticks: their duration in real time, the time between them by a clock.

    Args:
        period_s: nominal period by the clock.
        now_s: clock that triggers the ticks; simulated, if theirs is.

    Attributes:
        statistics: statistics since the last call of `pop_statistics`.
    """

    def __init__(self, period_s: float, now_s: Callable[[], float] = perf_counter) -> None:
        self._period_s = period_s
        self._now_s = now_s
        self._last_s: float | None = None
        self.statistics = TickStatistics()

    @contextmanager
    def tick(self) -> Iterator[None]:
        """Measure the tick that happens inside."""
        now_s, began_s, now, late = self._now_s(), perf_counter(), self.statistics, False
        if self._last_s is not None:
            period_s = now_s - self._last_s
            now.periods += 1
            now.elapsed_s += period_s
            now.max_period_s = max(now.max_period_s, period_s)
            now.lateness.observe(max(0.0, period_s - self._period_s))
            late = period_s > 1.5 * self._period_s
        self._last_s = now_s
        now.ticks += 1
        try:
            yield
        finally:
            took_s = perf_counter() - began_s
            now.max_tick_s = max(now.max_tick_s, took_s)
            now.durations.observe(took_s)
            now.overruns += late or took_s > self._period_s

    def pop_statistics(self) -> TickStatistics:
        """Return the statistics since the last call."""
        taken = self.statistics
        self.statistics = TickStatistics(
            overruns=taken.overruns, durations=taken.durations, lateness=taken.lateness
        )
        return taken


def diagnose(
    executive: "Executive",
    snapshot: TreeSnapshot,
    ticks: TickStatistics,
    rejected: int,
    name: str,
    stamp: Time,
) -> DiagnosticArray:
    """Return three statuses: of the executive, its tree and its active faults.

    The first is ERROR in SAFE, WARN for late ticks, missing odometry or bad messages. The second
    has the nodes of the last tick. The third is WARN if a fault is active.

    Args:
        executive: the diagnosed executive.
        snapshot: snapshot of its tree.
        ticks: statistics since the last diagnosis.
        rejected: number of messages rejected since the last diagnosis.
        name: full name of the node.
        stamp: time on the node's clock.
    """
    status = executive.status
    late = ticks.ticks == 0 or ticks.max_tick_s > executive.settings.tick_s
    if executive.mode is Mode.SAFE:
        level, text = DiagnosticStatus.ERROR, executive.why
    elif late:
        level, text = DiagnosticStatus.WARN, "the tick is late"
    elif not status.odometry_fresh:
        level, text = DiagnosticStatus.WARN, "no odometry"
    elif rejected:
        level, text = DiagnosticStatus.WARN, "messages were refused"
    else:
        level, text = DiagnosticStatus.OK, executive.why
    values = {
        "mode": executive.mode.name,
        "why": executive.why,
        "tick period [s]": "none" if ticks.period_s is None else f"{ticks.period_s:.4f}",
        "longest tick period [s]": f"{ticks.max_period_s:.4f}",
        "longest tick [s]": f"{ticks.max_tick_s:.4f}",
        "overruns": str(ticks.overruns),
        "odometry age [s]": f"{status.odometry_age_s:.3f}",
        "goals": str(executive.goal_count),
        "ledger sequence": str(executive.last_sequence),
        "ledger commits waiting": str(executive.commit_backlog[0]),
        "messages refused": str(rejected),
        "faults": ", ".join(fault.name for fault in executive.safety.active) or "none",
        "not monitored": summary(unmonitored(executive.settings, executive.safety.history)),
    }
    asset, faults = executive.settings.asset, executive.safety.active
    message = diagnostic_array(f"{name}: executive", asset, level, text, values, stamp)
    ticked = [each for each in snapshot.nodes if each.status is not NodeStatus.IDLE]
    running = [each.name for each in ticked if each.status is NodeStatus.RUNNING]
    message.status += [
        diagnostic_status(
            f"{name}: tree",
            asset,
            DiagnosticStatus.OK,
            " / ".join(running) or "nothing runs",
            {each.path: f"{each.status.name} {each.message}".rstrip() for each in ticked},
        ),
        diagnostic_status(
            f"{name}: faults",
            asset,
            DiagnosticStatus.WARN if faults else DiagnosticStatus.OK,
            ", ".join(fault.name for fault in faults) or "none",
            {fault.name: str(fault) for fault in faults},
        ),
    ]
    return message


def diagnostic_array(
    name: str, hardware_id: str, level: bytes, text: str, values: Mapping[str, object], stamp: Time
) -> DiagnosticArray:
    """Return one status as a message for /diagnostics.

    Args:
        name: full name of the node, and the subject of the status.
        hardware_id: name of the asset or device.
        level: constant of `DiagnosticStatus`.
        text: summary.
        values: further figures.
        stamp: time on the node's clock.
    """
    message = DiagnosticArray()
    message.header.stamp = stamp
    message.status = [diagnostic_status(name, hardware_id, level, text, values)]
    return message


def diagnostic_status(
    name: str, hardware_id: str, level: bytes, text: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """Return a status; the arguments are those of `diagnostic_array`."""
    return DiagnosticStatus(
        level=level,
        name=name,
        hardware_id=hardware_id,
        message=text,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
