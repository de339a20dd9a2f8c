"""The notifications of another asset as they were heard: the last of them, in order."""

from typing import Final

from adapters.mrs.types import Notification

MOST: Final = 1000
HEAVIEST: Final = 1 << 20
"""Octets that they may take in memory, roughly: long texts leave room for fewer."""

_BARE: Final = 500
_FIGURE: Final = 350


class History:
    """Keeps notifications by their sequence numbers, which rise unless the asset's ledger is new.

    Attributes:
        last: the one with the highest number; None before any was heard.
    """

    def __init__(self) -> None:
        """Have heard nothing."""
        self.last: Notification | None = None
        self._kept: dict[int, Notification] = {}
        self._weight = 0

    def take(self, notification: Notification) -> bool:
        """Keep a notification; return whether it is news.

        One that is kept already is none. One with a number that something else had, or that lies
        before all that are kept, tells that the asset began anew: what was kept is forgotten.
        """
        if self._kept.get(notification.sequence) == notification:
            return False
        if self.last is not None and notification.sequence <= self.last.sequence:
            self._kept.clear()
            self._weight = 0
        self.last = notification
        self._kept[notification.sequence] = notification
        self._weight += _weight(notification)
        while len(self._kept) > MOST or self._weight > HEAVIEST:
            oldest = self._kept.pop(next(iter(self._kept)))
            self._weight -= _weight(oldest)
        return True

    def since(self, first: int, count: int) -> tuple[Notification, ...]:
        """Return what is kept from a sequence number on, oldest first, so many at most."""
        wanted = [kept for number, kept in self._kept.items() if number >= first]
        return tuple(wanted[:count])


def _weight(notification: Notification) -> int:
    figures = notification.parameters or ()
    return _BARE + 2 * len(notification.text or "") + _FIGURE * len(figures)
