"""`Pacer` holds simulated time while the executive's ticks are late."""

import logging
from typing import Final

MAX_LEAD_S: Final = 0.065
"""Maximum lead of simulated time over the executive's last tick, which is due after 0.05 s. With
0.1 s a starved executive received odometry 0.14 s old, more than the bound of `odometry_late`."""
EXECUTIVE_TIMEOUT_S: Final = 5.0
"""Real time without a tick after which time no longer waits: the executive has ended or hangs."""
WINDOW_S: Final = 5.0
"""Real time over which the speed is measured."""
SLOW_RATIO, REAL_RATIO = 0.9, 0.97
"""Speeds below which time is reported as slow, and above which as real again."""
_LOG: Final = logging.getLogger(__name__)


class Pacer:
    """Decides whether simulated time waits; logs when it runs slower than real time, and why."""

    def __init__(self) -> None:
        self._tick_s: float | None = None
        self._tick_real_s = 0.0
        self._window = 0.0, 0.0
        self._slow = False

    def on_tick(self, simulated_s: float, real_s: float) -> None:
        """Note a tick of the executive."""
        if self._tick_s is None:
            self._window = simulated_s, real_s
        self._report(simulated_s, real_s)
        self._tick_s, self._tick_real_s = simulated_s, real_s

    def waits(self, simulated_s: float, real_s: float) -> bool:
        """Return whether simulated time waits for the executive's next tick."""
        if self._tick_s is None:
            return False
        late = simulated_s > self._tick_s + MAX_LEAD_S
        return late and real_s < self._tick_real_s + EXECUTIVE_TIMEOUT_S

    def _report(self, simulated_s: float, real_s: float) -> None:
        since_s, since_real_s = self._window
        if real_s < since_real_s + WINDOW_S:
            return
        self._window = simulated_s, real_s
        ratio = (simulated_s - since_s) / (real_s - since_real_s)
        if ratio < SLOW_RATIO and not self._slow:
            self._slow = True
            text = f"simulated time runs at {100 * ratio:.0f} % of real time"
            _LOG.warning("this computer is too busy, the executive's ticks are late: %s", text)
        elif ratio > REAL_RATIO and self._slow:
            self._slow = False
            _LOG.info("simulated time runs at real time again")
