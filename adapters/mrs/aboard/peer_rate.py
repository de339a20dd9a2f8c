"""Bounds what others may have reported, so that they fill neither the memory nor the ledger."""

from collections.abc import Callable
from typing import Final

from adapters.mal import StandardError
from adapters.mrs.spec import with_text

MOST_PEERS: Final = 1024
"""Of whom is remembered how much they told: the last ones."""


class PeerRateLimiter:
    """How many times a second each peer may tell or ask, and as many at once (a token bucket each).

    Args:
        most_hz: events a second.
        now_s: a clock that is never set.
    """

    def __init__(self, most_hz: int, now_s: Callable[[], float]) -> None:
        self._most_hz = most_hz
        self._now_s = now_s
        self._spent_until_s: dict[str, float] = {}

    def admit(self, peer: str) -> None:
        """Count an event of a peer; raises TOO_MANY."""
        now_s = self._now_s()
        at_s = max(now_s, self._spent_until_s.pop(peer, now_s))
        full = at_s - now_s > 1.0 - 0.5 / self._most_hz
        self._spent_until_s[peer] = at_s if full else at_s + 1.0 / self._most_hz
        if len(self._spent_until_s) > MOST_PEERS:
            del self._spent_until_s[next(iter(self._spent_until_s))]
        if full:
            text = f"{self._most_hz} a second at most of {peer}"
            raise with_text(StandardError.TOO_MANY, text)
