"""Health as a DiagnosticArray: of any node, and of the executive with how regularly it ticks."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from executive.commands import Mode

if TYPE_CHECKING:
    from executive.runner import Executive


@dataclass(frozen=True, slots=True)
class TickStatistics:
    """The ticks since the last diagnosis.

    Attributes:
        ticks: how many.
        period_s: mean time from one to the next; None with fewer than two.
        longest_period_s, longest_tick_s: the worst of them, 0 without any.
        overruns: ticks since the start that came late by half a period or took a whole one.
    """

    ticks: int
    period_s: float | None
    longest_period_s: float
    longest_tick_s: float
    overruns: int


class TickMonitor:
    """Measures ticks in real time.

    Args:
        period_s: what the period should be, in real time.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._overruns = 0
        self._last_s: float | None = None
        self._ticks = 0
        self._periods = 0
        self._elapsed_s = 0.0
        self._longest_period_s = 0.0
        self._longest_tick_s = 0.0

    @contextmanager
    def tick(self) -> Iterator[None]:
        """Measure the tick that happens inside."""
        began_s = perf_counter()
        late = False
        if self._last_s is not None:
            period_s = began_s - self._last_s
            self._periods += 1
            self._elapsed_s += period_s
            self._longest_period_s = max(self._longest_period_s, period_s)
            late = period_s > 1.5 * self._period_s
        self._last_s = began_s
        self._ticks += 1
        try:
            yield
        finally:
            took_s = perf_counter() - began_s
            self._longest_tick_s = max(self._longest_tick_s, took_s)
            self._overruns += late or took_s > self._period_s

    def take(self) -> TickStatistics:
        """Return what was measured since the last call."""
        ticks = TickStatistics(
            self._ticks,
            self._elapsed_s / self._periods if self._periods else None,
            self._longest_period_s,
            self._longest_tick_s,
            self._overruns,
        )
        self._ticks = self._periods = 0
        self._elapsed_s = self._longest_period_s = self._longest_tick_s = 0.0
        return ticks


def diagnose(
    executive: "Executive", ticks: TickStatistics, rejected: int, name: str, stamp: Time
) -> DiagnosticArray:
    """Return one status: ERROR when SAFE, WARN for late ticks, no odometry or bad messages.

    Args:
        executive: who is diagnosed.
        ticks: those since the last diagnosis.
        rejected: messages refused since the last diagnosis.
        name: the node's full name.
        stamp: when, on the node's clock.
    """
    status = executive.status
    late = ticks.ticks == 0 or ticks.longest_tick_s > executive.settings.tick_s
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
        "longest tick period [s]": f"{ticks.longest_period_s:.4f}",
        "longest tick [s]": f"{ticks.longest_tick_s:.4f}",
        "overruns": str(ticks.overruns),
        "odometry age [s]": f"{status.odometry_age_s:.3f}",
        "goals": str(executive.goal_count),
        "ledger sequence": str(executive.last_sequence),
        "messages refused": str(rejected),
    }
    return diagnostic_array(
        f"{name}: executive", executive.settings.asset, level, text, values, stamp
    )


def diagnostic_array(
    name: str, hardware_id: str, level: bytes, text: str, values: Mapping[str, object], stamp: Time
) -> DiagnosticArray:
    """Return one status as it goes to /diagnostics.

    Args:
        name: the node's full name, and what of it the status is of.
        hardware_id: the asset or device.
        level: of `DiagnosticStatus`.
        text: why.
        values: what else is known.
        stamp: when, on the node's clock.
    """
    message = DiagnosticArray()
    message.header.stamp = stamp
    message.status = [
        DiagnosticStatus(
            level=level,
            name=name,
            hardware_id=hardware_id,
            message=text,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
    ]
    return message
