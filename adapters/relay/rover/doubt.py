"""How long the rover is heard before a command is published that it may have already."""

from typing import Final

SILENT_S: Final = 3.0
"""A rover that says nothing for so long has nothing to say."""
SAID_S: Final = 1.0
"""One that said something and says nothing more for so long has said all: it looks each 0.2 s."""
LONGEST_S: Final = 30.0
"""One that never pauses has told again by then what nobody kept."""
FULL_S: Final = 60.0
"""A disk that is full for longer may stay so, and a stop may wait behind this command."""


class Doubt:
    """Whether the rover may still have something to say on what an earlier process published.

    It says only so much until that is kept, and then more. So what waits to be kept prolongs the
    doubt, but not for ever on a disk that stays full.

    Args:
        now_s: since when it is heard, on a steady clock.
    """

    def __init__(self, now_s: float) -> None:
        """Begin to hear."""
        self._looked_s = self._last_s = now_s
        self._patience_s, self._left_s = SILENT_S, LONGEST_S
        self._end_s = now_s + FULL_S

    def said(self, now_s: float) -> None:
        """Take note that the rover said something."""
        self._last_s, self._patience_s = now_s, SAID_S

    def lasts(self, now_s: float, storing: bool) -> bool:
        """Return whether it may have more to say.

        Args:
            now_s: the time.
            storing: whether something of what it said is not kept yet.
        """
        if storing:
            self._last_s = now_s
        else:
            self._left_s -= now_s - self._looked_s
        self._looked_s = now_s
        return self._left_s > 0 and now_s < min(self._last_s + self._patience_s, self._end_s)
