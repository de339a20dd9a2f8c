"""What waits to become bundles: reports all and in order, of telemetry the newest."""

from collections.abc import Sequence
from itertools import islice
from typing import Final

from adapters.mops.dictionary import Dictionary
from adapters.mops.message import Message, MopsError
from adapters.mops.reports import UNNUMBERED, report_of

MOST: Final = 10_000
"""Reports that wait here, for a store that is full; more are refused."""


class Tray:
    """Sorts messages. Used by one thread.

    Args:
        dictionary: which codes are telemetry and health.
        telemetry_queue: while more bundles than that are queued, telemetry waits.
    """

    def __init__(self, dictionary: Dictionary, telemetry_queue: int) -> None:
        """Begin empty."""
        self._dictionary = dictionary
        self._telemetry_queue = telemetry_queue
        spelling = dictionary.spelling
        self._measurements = {spelling.telemetry.code, spelling.link.code}
        self._reports: dict[Message, None] = {}
        self._newest: dict[int, Message] = {}

    def put(self, message: Message) -> bool:
        """Take a message; return False where there is no room for it."""
        if self.is_measurement(message):
            self._newest[message.code] = message
        elif message not in self._reports:
            if len(self._reports) >= MOST:
                return False
            self._reports[message] = None
        return True

    def take(self, queued: int, most: int) -> Sequence[Message]:
        """Return what is to be sent now.

        Args:
            queued: bundles that wait already.
            most: how many at most.
        """
        taken = list(islice(self._reports, most))
        for message in taken:
            del self._reports[message]
        if queued + len(taken) <= self._telemetry_queue:
            taken += self._newest.values()
            self._newest.clear()
        return taken

    def is_measurement(self, message: Message) -> bool:
        """Return whether a message is worth nothing once there is a newer one."""
        return message.code in self._measurements

    def number_of(self, message: Message) -> int | None:
        """Return the number of a report, by which its sender is told that it is taken over."""
        try:
            sequence = report_of(message, self._dictionary, 0.0).sequence
        except MopsError:
            return None
        return None if sequence == UNNUMBERED else sequence
