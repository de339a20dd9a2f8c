"""`Identity`, the id of a command: its source and its number."""

from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True, slots=True)
class Identity:
    """Command id: source and number, the key of deduplication."""

    source: str
    command_id: int

    def __str__(self) -> str:
        return f"{self.source}:{self.command_id}"

    @classmethod
    def parse(cls, text: str) -> Self | None:
        """Return the command id of its text; None if it is none."""
        source, _, number = text.rpartition(":")
        return cls(source, int(number)) if source and number.isdecimal() else None
