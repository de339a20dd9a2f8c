"""Which sources send data that cannot be used, and why."""

from typing import Final

from executive.values.clock import Clock
from executive.values.facts import RejectedData, Source

REPEATED_S: Final = 2.5
"""Time after which a rejection has ended: adapters repeat it each second."""


class Rejections:
    """The rejections that were reported last."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._until_s: dict[Source, tuple[RejectedData, float]] = {}

    def observe(self, fact: RejectedData) -> None:
        """Take in what an adapter reports."""
        self._until_s[fact.source] = fact, self._clock.now_s() + REPEATED_S

    def of(self, source: Source | None) -> RejectedData | None:
        """Return the rejection of a source that goes on, or None."""
        found = self._until_s.get(source) if source else None
        return found[0] if found and self._clock.now_s() <= found[1] else None

    def explain(self, text: str, source: Source | None) -> str:
        """Return a text on what lacks, followed by why data of its source are not used."""
        found = self.of(source)
        return f"{text}; {found}" if found else text
