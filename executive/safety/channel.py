"""`StampClock` converts stamps to the core's time; `Channel`: running sums of a source over it.

A publisher's clock may differ from the core's. Its offset is learnt as the minimum difference of
arrival and stamp, so that a message counts as late if it is later than usual. The motion between
any two times is the difference of two look-ups in the channel of a source.
"""

from collections.abc import Sequence
from math import floor, inf
from typing import Final

GRID_S: Final = 0.02
SLOTS: Final = 512
"""Number of grid points of a channel: about ten seconds."""
USUAL_LATENCY_S: Final = 0.05
"""Maximum latency assumed for the first message, if its stamp is of a clock of the core."""
OWN_CLOCK_S: Final = 0.5
"""Maximum age of a first message by a clock of the core, for it to be stamped by that clock."""
OWN_AHEAD_S: Final = 1.0
"""Maximum time of stamps that are newer than the own clock, because that is received late."""
SAME_CLOCK_S: Final = 1.0
"""Maximum difference of the offsets of publishers that share a clock."""
OTHER_CLOCK_S: Final = 86_400.0
"""Maximum offset of a stamp; beyond it the clock is unknown."""
DRIFT_RATIO: Final = 1e-3
"""Maximum drift of a publisher's clock behind the core's."""


class StampClock:
    """Converts stamps of all sources to the core's time.

    Sources of one clock share one offset, so that a longer latency does not look like a newer
    measurement. A stamp of the core's own clock that is newer than it shows no shorter latency: a
    busy computer receives simulated time late.
    """

    def __init__(self) -> None:
        self._offsets_s: dict[type, float] = {}
        self._last: dict[type, tuple[float, float]] = {}
        self._own: dict[type, float] = {}

    def time_s(self, source: type, stamp_s: float, now_s: float, utc_s: float) -> float:
        """Return the measurement time, on the core's time.

        Args:
            source: the kind of fact.
            stamp_s: on the clock of its publisher.
            now_s: time of arrival.
            utc_s: the same, in UTC.
        """
        offset_s = now_s - stamp_s
        last_stamp_s, last_now_s = self._last.get(source, (inf, now_s))
        self._last[source] = (stamp_s, now_s)
        if stamp_s < last_stamp_s - SAME_CLOCK_S:
            own_age_s = next((a for a in (offset_s, utc_s - stamp_s) if 0 <= a < OWN_CLOCK_S), 0.0)
            known_s = offset_s - max(0.0, own_age_s - USUAL_LATENCY_S)
            self._own.pop(source, None)
            if 0 <= offset_s < OWN_CLOCK_S:
                self._own[source] = now_s
        else:
            known_s = self._offsets_s[source] + DRIFT_RATIO * (now_s - last_now_s)
        own_s = min(offset_s, known_s)
        if source in self._own:
            if own_s >= 0.0:
                self._own[source] = now_s
            elif offset_s > -OWN_CLOCK_S and now_s - self._own[source] <= OWN_AHEAD_S:
                own_s = 0.0
            else:  # its clock was set, or drifts ahead
                self._own.clear()
        self._offsets_s[source] = shared_s = own_s
        for each_s in self._offsets_s.values():
            if own_s - SAME_CLOCK_S < each_s < shared_s:
                shared_s = each_s
        return stamp_s + shared_s

    def sparse_time_s(self, like: type, stamp_s: float, now_s: float, utc_s: float) -> float | None:
        """Return the measurement time of a sparse source; None if its clock is unknown.

        Args:
            like: a source that may share its clock, if that was not UTC.
            stamp_s: on the clock of its publisher.
            now_s: time of arrival.
            utc_s: the same, in UTC.
        """
        ages_s = (now_s - stamp_s - self._offsets_s.get(like, 0.0), utc_s - stamp_s)
        return next((now_s - age_s for age_s in ages_s if abs(age_s) < OTHER_CLOCK_S), None)


class Channel:
    """Running sums of one source over time, on a grid, with linear interpolation.

    Attributes:
        time_s: of the newest sums; minus infinity before the first.
        first_s: the earliest time with known sums.
        sums: the newest.
    """

    def __init__(self, width: int) -> None:
        self._slots: list[Sequence[float]] = [(0.0,) * width] * SLOTS
        self._filled = self._first = 0
        self.time_s, self.first_s = -inf, 0.0
        self.sums: Sequence[float] = (0.0,) * width
        self._last_end: tuple[float, Sequence[float]] = (-inf, self.sums)

    def add(self, time_s: float, sums: Sequence[float]) -> None:
        """Add the sums at a time; a time that is not newer is ignored."""
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
        self._filled, self.first_s = last, max(self._first, last - SLOTS + 2) * GRID_S
        self.time_s, self.sums = time_s, sums
        self._last_end = -inf, sums

    def covers(self, time_s: float) -> bool:
        """Whether the sums at a time are known."""
        return self.first_s <= time_s <= self.time_s

    def sums_at(self, time_s: float) -> Sequence[float]:
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

    def sum_at(self, time_s: float, field: int) -> float:
        """Return one of the sums at a time that is covered."""
        index = floor(time_s / GRID_S)
        low, begun_s, span_s = self._slots[index % SLOTS][field], index * GRID_S, GRID_S
        if index < self._filled:
            high = self._slots[(index + 1) % SLOTS][field]
        else:
            high, span_s = self.sums[field], self.time_s - begun_s
            if span_s <= 0.0:
                return high
        return low + (time_s - begun_s) / span_s * (high - low)

    def increase_between(self, from_s: float, to_s: float) -> list[float] | None:
        """Return the increase between two times; None if it is unknown."""
        first_s = self.first_s
        if not (first_s <= from_s <= self.time_s and first_s <= to_s <= self.time_s):
            return None
        if self._last_end[0] != to_s:  # windows of one check have the same end
            self._last_end = to_s, self.sums_at(to_s)
        ends = self._last_end[1]
        return [new - old for old, new in zip(self.sums_at(from_s), ends, strict=True)]
