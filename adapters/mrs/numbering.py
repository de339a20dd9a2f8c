"""Numbers for the commands of one source."""

import time
from collections.abc import Callable
from typing import Final

EPOCH_MS: Final = 1_767_225_600_000
"""2026-01-01, from where command numbers count, in ms since 1970 UTC."""


class CommandNumbers:
    """Gives milliseconds since 2026, or one more than the last: never 0, never twice.

    A client that starts again goes on above its former numbers, unless it gave more than one a
    millisecond or the clock was set back.

    Args:
        now_ns: returns the time in ns since 1970 UTC.
    """

    def __init__(self, now_ns: Callable[[], int] = time.time_ns) -> None:
        """Start above 0."""
        self._now_ns = now_ns
        self._last = 0

    def take(self) -> int:
        """Return a new number."""
        self._last = max(self._last + 1, self._now_ns() // 1_000_000 - EPOCH_MS)
        return self._last
