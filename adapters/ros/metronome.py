"""How regularly the tick comes, and how long it takes."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter


@dataclass(frozen=True, slots=True)
class Beat:
    """The ticks since the last look.

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


class Metronome:
    """Measures ticks in real time.

    Args:
        period_s: what the period should be, in real time.
    """

    def __init__(self, period_s: float) -> None:
        """Start without a tick."""
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

    def look(self) -> Beat:
        """Return what was measured since the last look."""
        beat = Beat(
            self._ticks,
            self._elapsed_s / self._periods if self._periods else None,
            self._longest_period_s,
            self._longest_tick_s,
            self._overruns,
        )
        self._ticks = self._periods = 0
        self._elapsed_s = self._longest_period_s = self._longest_tick_s = 0.0
        return beat
