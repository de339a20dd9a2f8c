"""Limits the requests of each client, so that they fill neither the memory nor the ledger."""

from collections.abc import Callable
from typing import Final

from adapters.mal import StandardError
from adapters.mrs.spec import with_text

MAX_PEERS: Final = 1024
"""Maximum peers with a stored token bucket: the last ones."""


class PeerRateLimiter:
    """Limits the events a second of each peer, with a burst of the same number (token bucket).

    Args:
        max_hz: maximum events a second.
        now_s: a monotonic clock.
    """

    def __init__(self, max_hz: int, now_s: Callable[[], float]) -> None:
        self._max_hz = max_hz
        self._now_s = now_s
        self._spent_until_s: dict[str, float] = {}

    def admit(self, peer: str) -> None:
        """Count an event of a peer; raises TOO_MANY."""
        now_s = self._now_s()
        at_s = max(now_s, self._spent_until_s.pop(peer, now_s))
        full = at_s - now_s > 1.0 - 0.5 / self._max_hz
        self._spent_until_s[peer] = at_s if full else at_s + 1.0 / self._max_hz
        if len(self._spent_until_s) > MAX_PEERS:
            del self._spent_until_s[next(iter(self._spent_until_s))]
        if full:
            text = f"at most {self._max_hz} a second of {peer}"
            raise with_text(StandardError.TOO_MANY, text)
