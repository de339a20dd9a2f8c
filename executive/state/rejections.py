"""The sources with rejected data, and the causes."""

from typing import Final

from executive.values.clock import Clock
from executive.values.facts import RejectedData, Source

REPEATED_S: Final = 2.5
"""Timeout of a rejection; adapters repeat it each second."""


class Rejections:
    """The last rejection of each source."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._until_s: dict[Source, tuple[RejectedData, float]] = {}

    def observe(self, fact: RejectedData) -> None:
        """Record the rejection that an adapter reports."""
        self._until_s[fact.source] = fact, self._clock.now_s() + REPEATED_S

    def of(self, source: Source | None) -> RejectedData | None:
        """Return the present rejection of a source, or None."""
        found = self._until_s.get(source) if source else None
        return found[0] if found and self._clock.now_s() <= found[1] else None

    def explain(self, text: str, source: Source | None) -> str:
        """Return a text on missing data, followed by why data of its source are rejected."""
        found = self.of(source)
        return f"{text}; {found}" if found else text
