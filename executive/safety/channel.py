"""Stamps on the time of the core, and running sums of a source over that time.

The clock of a publisher may be another one than the core's: its offset is learnt as the smallest
difference of arrival and stamp, so that what counts as late is what comes later than usual. What
happened between any two times is two look-ups in the channel of a source.
"""

from collections.abc import Sequence
from math import floor, inf
from typing import Final

GRID_S: Final = 0.02
SLOTS: Final = 512
"""Of a channel: about ten seconds."""
USUAL_LATENCY_S: Final = 0.05
"""At most taken for usual of the first message, where its stamp is of the core's own clocks."""
OWN_CLOCK_S: Final = 0.5
"""A first message that is no older by a clock of the core was stamped by that clock."""
SAME_CLOCK_S: Final = 1.0
"""Publishers whose offsets differ by less share a clock."""
OTHER_CLOCK_S: Final = 86_400.0
"""A stamp that is further off is of a clock that nobody here knows."""
DRIFT_RATIO: Final = 1e-3
"""By how much a publisher's clock may lose on the core's."""


class StampClock:
    """Puts stamps of all sources on the core's time.

    Sources of one clock share one offset, so that what takes longer to arrive is not taken for
    newer.
    """

    def __init__(self) -> None:
        self._offsets_s: dict[type, float] = {}
        self._last: dict[type, tuple[float, float]] = {}

    def time_s(self, source: type, stamp_s: float, now_s: float, utc_s: float) -> float:
        """Return when something was measured, on the core's time.

        Args:
            source: the kind of fact.
            stamp_s: on the clock of its publisher.
            now_s: when it arrived.
            utc_s: the same, in UTC.
        """
        offset_s = now_s - stamp_s
        last_stamp_s, last_now_s = self._last.get(source, (inf, now_s))
        self._last[source] = (stamp_s, now_s)
        if stamp_s < last_stamp_s - SAME_CLOCK_S:
            own_age_s = next((a for a in (offset_s, utc_s - stamp_s) if 0 <= a < OWN_CLOCK_S), 0.0)
            known_s = offset_s - max(0.0, own_age_s - USUAL_LATENCY_S)
        else:
            known_s = self._offsets_s[source] + DRIFT_RATIO * (now_s - last_now_s)
        self._offsets_s[source] = own_s = min(offset_s, known_s)
        shared_s = min(
            each for each in self._offsets_s.values() if abs(each - own_s) < SAME_CLOCK_S
        )
        return stamp_s + shared_s

    def seen_s(self, like: type, stamp_s: float, now_s: float, utc_s: float) -> float | None:
        """Return when something was measured that comes seldom; None where its clock is unknown.

        Args:
            like: the source whose clock may have stamped it, if it was not UTC.
            stamp_s: on the clock of its publisher.
            now_s: when it arrived.
            utc_s: the same, in UTC.
        """
        ages_s = (now_s - stamp_s - self._offsets_s.get(like, 0.0), utc_s - stamp_s)
        return next((now_s - age_s for age_s in ages_s if abs(age_s) < OTHER_CLOCK_S), None)


class Channel:
    """Running sums of one source over time, on a grid, interpolated in between.

    Attributes:
        time_s: of the newest; before the first it is minus infinity.
        sums: the newest.
    """

    def __init__(self, width: int) -> None:
        self._slots: list[Sequence[float]] = [(0.0,) * width] * SLOTS
        self._filled = self._first = 0
        self.time_s = -inf
        self.sums: Sequence[float] = (0.0,) * width

    def add(self, time_s: float, sums: Sequence[float]) -> None:
        """Take the sums up to a time; what is not newer is left out."""
        if time_s <= self.time_s:
            return
        last, since_s = floor(time_s / GRID_S), time_s - self.time_s
        if since_s > GRID_S * SLOTS:
            self._first = self._filled = last
            self._slots[last % SLOTS] = sums
        for index in range(self._filled + 1, last + 1):
            part = (index * GRID_S - self.time_s) / since_s
            self._slots[index % SLOTS] = [
                old + part * (new - old) for old, new in zip(self.sums, sums, strict=True)
            ]
        self._filled = last
        self.time_s, self.sums = time_s, sums

    @property
    def first_s(self) -> float:
        """From when on the sums are known."""
        return max(self._first, self._filled - SLOTS + 2) * GRID_S

    def covers(self, time_s: float) -> bool:
        """Whether the sums at a time are known."""
        return self.first_s <= time_s <= self.time_s

    def at(self, time_s: float) -> Sequence[float]:
        """Return the sums at a time that is covered."""
        index = floor(time_s / GRID_S)
        low = self._slots[index % SLOTS]
        if index >= self._filled:
            begun_s, high, span_s = index * GRID_S, self.sums, self.time_s - index * GRID_S
            if span_s <= 0.0:
                return high
        else:
            begun_s, high, span_s = index * GRID_S, self._slots[(index + 1) % SLOTS], GRID_S
        part = (time_s - begun_s) / span_s
        return [old + part * (new - old) for old, new in zip(low, high, strict=True)]

    def between(self, from_s: float, to_s: float) -> list[float] | None:
        """Return what was added between two times; None where that is not known."""
        if not (self.covers(from_s) and self.covers(to_s)):
            return None
        return [new - old for old, new in zip(self.at(from_s), self.at(to_s), strict=True)]
