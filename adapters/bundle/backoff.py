"""How long to wait before trying again, and what to say of it, once."""

import logging
from typing import Final

_LOG: Final = logging.getLogger(__name__)
_LONGEST_S: Final = 30.0


class Backoff:
    """Pauses that double while nothing goes well.

    Args:
        name: of what is tried, for the log.
        shortest_s: the first pause.

    Attributes:
        pause_s: the next pause.
    """

    def __init__(self, name: str, shortest_s: float) -> None:
        """Begin with the shortest pause."""
        self._name, self._shortest_s = name, shortest_s
        self.pause_s = shortest_s
        self._said = ""

    def went_well(self) -> None:
        """Begin anew with the shortest pause."""
        self.pause_s, self._said = self._shortest_s, ""

    def failed(self, failure: BaseException) -> float:
        """Log a failure, unless it is that of last time; return how long to wait, in seconds."""
        text = text_of(failure)
        if text != self._said:
            _LOG.warning("%s: %s", self._name, text)
        self._said = text
        return self.next_pause_s()

    def next_pause_s(self) -> float:
        """Return how long to wait, in seconds; longer the next time."""
        pause_s, self.pause_s = self.pause_s, min(2 * self.pause_s, _LONGEST_S)
        return pause_s


def text_of(failure: BaseException) -> str:
    """Return what an exception says; some say nothing but their name."""
    return str(failure) or type(failure).__name__
