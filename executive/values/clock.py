"""`Clock`, the only source of time of the core, with real, latched and manual implementations."""

import time
from typing import Final, Protocol


class Clock(Protocol):
    """Source of time. Nothing in the core reads another clock."""

    def now_s(self) -> float:
        """Return monotonic seconds, for deadlines, ages and profiles."""

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC, for stamps and command lifetimes."""


def round_for_recording_s(time_s: float) -> float:
    """Round a time to 0.1 ms. Finer digits would only enlarge recordings."""
    return round(time_s, 4)


class SystemClock:
    """Real time of this machine."""

    def now_s(self) -> float:
        """Return seconds since boot, including the time suspended."""
        return round_for_recording_s(time.clock_gettime(time.CLOCK_BOOTTIME))

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC."""
        return round_for_recording_s(time.time())


class LatchedClock:
    """Wraps a clock; returns the same reading between `begin` and `end`.

    A new instance is latched. Latches nest: inner ones keep the reading of the outermost.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._depth = 0
        self.begin()

    @property
    def latched(self) -> bool:
        """Whether the reading is latched."""
        return self._depth > 0

    def begin(self) -> None:
        """Latch the reading until the matching `end`."""
        if self._depth == 0:
            self._now_s, self._utc_s = self._clock.now_s(), self._clock.utc_s()
        self._depth += 1

    def end(self) -> None:
        """Release the latch, if this ends the outermost `begin`."""
        self._depth -= 1

    def __enter__(self) -> None:
        self.begin()

    def __exit__(self, *_: object) -> None:
        self.end()

    def now_s(self) -> float:
        """Return monotonic seconds."""
        return self._now_s if self._depth else self._clock.now_s()

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC."""
        return self._utc_s if self._depth else self._clock.utc_s()


START_UTC_S: Final = 1_800_000_000.0


class ManualClock:
    """Clock that is set by its owner, from a day in 2027: for lock step and tests."""

    def __init__(self, start_utc_s: float = START_UTC_S) -> None:
        self._start_utc_s = start_utc_s
        self._now_s = 0.0

    def now_s(self) -> float:
        """Return seconds since the start."""
        return self._now_s

    def utc_s(self) -> float:
        """Return the UTC time of the start plus the seconds since."""
        return self._start_utc_s + self._now_s

    def set(self, now_s: float) -> None:
        """Set the time.

        Raises:
            ValueError: the time is before the present one.
        """
        if now_s < self._now_s:
            raise ValueError(f"clock is at {self._now_s} s: cannot set it back to {now_s} s")
        self._now_s = now_s

    def advance(self, step_s: float) -> None:
        """Advance the time by a step."""
        self.set(self._now_s + step_s)
