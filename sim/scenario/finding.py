"""One line of a verdict."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

NEVER: Final = "that time never came"


@dataclass(frozen=True, slots=True)
class Finding:
    """What was expected, what was seen, and whether the one holds of the other.

    Attributes:
        subject: what it is about: a command, the pose, a parameter.
    """

    subject: str
    expected: str
    seen: str
    holds: bool


def joined(subject: str, aspects: Sequence[Finding]) -> Finding:
    """Return several findings about one subject as one."""
    return Finding(
        subject,
        ", ".join(aspect.expected for aspect in aspects),
        ", ".join(aspect.seen for aspect in aspects),
        all(aspect.holds for aspect in aspects),
    )
