"""`Mux` of a simulated base, with the behaviour of twist_mux.

An input is masked while its last message is older than its timeout, or while a lock of a higher
priority is locked. A message is forwarded to the base if its input has the maximum priority of
those that are not masked. An input without a timeout counts even without a message. A lock has the
state of its last message, and is locked if that is older than its timeout. For a masked message no
other one is published: the base stops by its own timeout.
"""

from dataclasses import dataclass
from math import inf

from executive.settings import MuxEntry, MuxSettings


@dataclass(slots=True)
class _LastMessage:
    """An input or a lock, with the time of its last message; `locked` is for a lock."""

    entry: MuxEntry
    at_s: float = -inf
    locked: bool = False

    def expired(self, now_s: float) -> bool:
        return 0.0 < self.entry.timeout < now_s - self.at_s


class Mux:
    """Selects the input that drives the base."""

    def __init__(self, settings: MuxSettings) -> None:
        self.settings = settings
        self._inputs = {name: _LastMessage(entry) for name, entry in settings.topics.items()}
        self._locks = {name: _LastMessage(entry) for name, entry in settings.locks.items()}

    def add(self, name: str, entry: MuxEntry) -> None:
        """Add an input; it replaces one of that name."""
        self._inputs[name] = _LastMessage(entry)

    def passes(self, name: str, now_s: float) -> bool:
        """Process a velocity of an input; return whether it is forwarded to the base."""
        self._inputs[name].at_s = now_s
        bar = max(
            (
                lock.entry.priority
                for lock in self._locks.values()
                if lock.locked or lock.expired(now_s)
            ),
            default=0,
        )
        open_ = (each for each in self._inputs.values() if each.entry.priority >= bar)
        live = (each for each in open_ if not each.expired(now_s))
        first = max(live, key=lambda each: each.entry.priority, default=None)
        return first is self._inputs[name]

    def lock(self, name: str, locked: bool, now_s: float) -> None:
        """Process a message of a lock."""
        lock = self._locks[name]
        lock.locked, lock.at_s = locked, now_s
