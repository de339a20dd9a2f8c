"""`StampPeriod`: the period of a source by its stamps, its gaps, and bounds that depend on them."""

from collections import deque
from math import inf
from statistics import median
from typing import Final

STEPS: Final = 25
"""Number of steps between stamps; their median is the period."""
MIN_STEPS: Final = 12
"""Minimum number of them."""
RESOLUTION_S: Final = 1e-3
"""Resolution of the period: far below the variation of the steps."""
GAP_PERIODS: Final = 2.5
MIN_GAP_S: Final = 0.06
"""Minimum step that is a gap. Recorded robots: steps of 2 to 144 ms without a loss, at 62 to 10
Hz; gaps of up to 334 ms."""
MAX_GAP_S: Final = 0.4
"""Maximum gap that is allowed for: a longer one is a fault."""
BURST_S: Final = 0.1
"""Maximum time from a gap to the stamps of its messages."""
MAX_GAPS: Final = 100
"""Number of gaps that are stored: more than in any window."""
GAP_MPS2: Final = 2.0
GAP_RADPS2: Final = 4.0
"""Acceleration that may be missed in a gap: half of it in one direction, half back."""


class StampPeriod:
    """The learnt or declared period of a source.

    Args:
        declared_hz: rate that the asset declares; None: learnt.

    Attributes:
        period_s: 0 while it is unknown.
    """

    def __init__(self, declared_hz: float | None = None) -> None:
        self._declared = declared_hz is not None
        self.period_s = 0.0 if declared_hz is None else 1.0 / declared_hz
        self._steps_s: deque[float] = deque(maxlen=STEPS)

    def observe(self, step_s: float, *, may_lengthen: bool = True) -> None:
        """Learn from a step between stamps.

        Args:
            step_s: the step.
            may_lengthen: whether a longer period than the known one is learnt.
        """
        if self._declared or not 0.0 < step_s < inf:
            return
        self._steps_s.append(step_s)
        if len(self._steps_s) < MIN_STEPS:
            return
        found_s = round(median(self._steps_s) / RESOLUTION_S) * RESOLUTION_S
        if may_lengthen or not self.period_s or found_s < self.period_s:
            self.period_s = found_s

    def gap_s(self, step_s: float) -> float:
        """Return the time of a step without the measurements that were due; 0 without a gap.

        They were lost, or are stamped in a burst after it. A gap above `MAX_GAP_S` is a fault.
        """
        if step_s <= max(MIN_GAP_S, GAP_PERIODS * self.period_s):
            return 0.0
        return min(step_s, MAX_GAP_S) - self.period_s


class Gaps:
    """The gaps of a source, and the motion that is uncertain by them.

    The messages of a gap may be lost, or stamped in a burst after it.
    """

    def __init__(self) -> None:
        self._gaps: deque[tuple[float, float, float]] = deque(maxlen=MAX_GAPS)

    def observe(self, time_s: float, gap_s: float, speed_mps: float, rate_radps: float) -> None:
        """Add a gap that ends at a time, with the maximum speed and rate around it."""
        if gap_s <= 0.0:
            return
        missed_m = gap_s * abs(speed_mps) + GAP_MPS2 * gap_s * gap_s / 4
        missed_rad = gap_s * abs(rate_radps) + GAP_RADPS2 * gap_s * gap_s / 4
        self._gaps.append((time_s, missed_m, missed_rad))

    def missed_m(self, from_s: float) -> float:
        """Return the distance since a time that is uncertain."""
        return sum(each_m for end_s, each_m, _ in self._gaps if end_s >= from_s - BURST_S)

    def missed_rad(self, from_s: float) -> float:
        """Return the turn since a time that is uncertain."""
        return sum(each_rad for end_s, _, each_rad in self._gaps if end_s >= from_s - BURST_S)


LOW_RATE_RATIO: Final = 0.6
"""Share of its own rate below which odometry is too rare. Recorded robots: steps vary by 10 %, and
3 % of the messages may be lost."""
LOWEST_RATE_HZ: Final = 5.5
"""Rate that is always too low: below 8 Hz with the same variation."""
STALE_PERIODS: Final = 3.2
"""Minimum age of stale odometry. Recorded robots: gaps of up to 2.7 periods."""
LAG_PERIODS: Final = 2.8
"""Minimum age relative to other sensors of odometry that lags them."""
FROZEN_PERIODS: Final = 3.5
"""Maximum time without a change while motion is commanded."""
SHORT_PERIOD_S: Final = 0.05
"""Maximum period that shows the reaction to a command in time."""


class OdometryPeriod(StampPeriod):
    """The period of the odometry. Odometry that slows down in motion is a fault, and not learnt.

    Odometry of real robots has 8 to 62 Hz. At 50 Hz every bound is that of its row.
    """

    def low_rate_hz(self, bound_hz: float) -> float:
        """Return the rate below which odometry is too rare."""
        if not self.period_s:
            return bound_hz
        return min(bound_hz, max(LOW_RATE_RATIO / self.period_s, LOWEST_RATE_HZ))

    def stale_s(self, bound_s: float) -> float:
        """Return the maximum age of odometry that is not stale."""
        return max(bound_s, STALE_PERIODS * self.period_s)

    def lag_s(self, bound_s: float) -> float:
        """Return the maximum age of odometry relative to other sensors."""
        return max(bound_s, LAG_PERIODS * self.period_s)

    def frozen_s(self, window_s: float) -> float:
        """Return the maximum time without a change while motion is commanded."""
        return max(window_s, FROZEN_PERIODS * self.period_s)

    def response_s(self, window_s: float) -> float:
        """Return the window of the commands that odometry may follow."""
        return window_s + max(0.0, self.period_s - SHORT_PERIOD_S)
