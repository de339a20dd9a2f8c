"""Time as the core sees it, and the clocks that it can run on."""

import time
from typing import Final, Protocol


class Clock(Protocol):
    """Time. Nothing in the core reads another clock."""

    def now_s(self) -> float:
        """Return seconds that never step back: deadlines, ages and profiles use these."""

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC, for stamps and command lifetimes."""


def kept_s(time_s: float) -> float:
    """Return a time to a tenth of a millisecond; what lies below would but fill a recording."""
    return round(time_s, 4)


class SystemClock:
    """Real time of this machine."""

    def now_s(self) -> float:
        """Return seconds since the computer started, those in which it was suspended included."""
        return kept_s(time.clock_gettime(time.CLOCK_BOOTTIME))

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC."""
        return kept_s(time.time())


class LatchedClock:
    """Another clock, of which one reading holds from `begin` to `end`; else it goes on.

    It begins when it is made. What begins within is a part of it, and sees the same time.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._depth = 0
        self.begin()

    @property
    def held(self) -> bool:
        """Whether time stands still."""
        return self._depth > 0

    def begin(self) -> None:
        """Have time stand still until the matching `end`."""
        if self._depth == 0:
            self._now_s, self._utc_s = self._clock.now_s(), self._clock.utc_s()
        self._depth += 1

    def end(self) -> None:
        """Have time go on, if this is the end of the outermost `begin`."""
        self._depth -= 1

    def __enter__(self) -> None:
        self.begin()

    def __exit__(self, *_: object) -> None:
        self.end()

    def now_s(self) -> float:
        """Return seconds that never step back."""
        return self._now_s if self._depth else self._clock.now_s()

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC."""
        return self._utc_s if self._depth else self._clock.utc_s()


START_UTC_S: Final = 1_800_000_000.0


class ManualClock:
    """Time that moves when told to, from a day in 2027: for lock step and tests."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Return seconds since the start."""
        return self._now_s

    def utc_s(self) -> float:
        """Return the start's UTC plus the seconds since."""
        return START_UTC_S + self._now_s

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
