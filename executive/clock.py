"""Time as the core sees it, and the clocks that it can run on."""

import time
from typing import Protocol


class Clock(Protocol):
    """Time. Nothing in the core reads another clock."""

    def now_s(self) -> float:
        """Return seconds that never step back: deadlines, ages and profiles use these."""

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC, for stamps and command lifetimes."""


class SystemClock:
    """Real time of this machine."""

    def now_s(self) -> float:
        """Return monotonic seconds."""
        return time.monotonic()

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC."""
        return time.time()


class ManualClock:
    """Time that moves when told to: for lock step and tests.

    Args:
        utc_s: UTC at the start, in seconds since 1970-01-01.
    """

    def __init__(self, utc_s: float = 1_800_000_000.0) -> None:
        self._now_s = 0.0
        self._start_utc_s = utc_s

    def now_s(self) -> float:
        """Return seconds since the start."""
        return self._now_s

    def utc_s(self) -> float:
        """Return the start's UTC plus the seconds since."""
        return self._start_utc_s + self._now_s

    def set(self, now_s: float) -> None:
        """Move to a time that is not before the present one.

        Raises:
            ValueError: the time is in the past.
        """
        if now_s < self._now_s:
            raise ValueError(f"the clock stands at {self._now_s} s and cannot go to {now_s} s")
        self._now_s = now_s

    def advance(self, step_s: float) -> None:
        """Move on by a step."""
        self.set(self._now_s + step_s)
