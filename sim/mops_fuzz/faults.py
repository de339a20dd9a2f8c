"""What must not become of a string, and a count of it."""

import logging
from collections import Counter
from collections.abc import Sequence
from enum import Enum, unique
from typing import Final

LONGEST_LINE: Final = 6000
"""Characters of a line that names a message of 4096 octets."""
EXAMPLES: Final = 5


@unique
class Fault(Enum):
    """A promise that was broken."""

    RAISED = "raised something else than a refusal"
    LENIENT = "taken though wrong"
    DEAF = "not taken though sound"
    CHANGED = "read otherwise than it was written"
    SILENT = "wrong and not told"
    WORDY = "told in more than one line"
    UNCALLED = "said or done though no sound string asked for it"
    MOVED = "motion"


class Faults:
    """Counts faults, and keeps the first.

    Attributes:
        counts: how many of each.
        examples: the first, as lines.
    """

    def __init__(self) -> None:
        """Begin without."""
        self.counts: Counter[Fault] = Counter()
        self.examples: list[str] = []

    def add(self, fault: Fault, about: object) -> None:
        """Count a fault."""
        self.counts[fault] += 1
        if len(self.examples) < EXAMPLES:
            self.examples.append(f"{fault.value}: {about!r}")

    def compare(self, octets: bytes, sound: Sequence[bytes], taken: Sequence[bytes]) -> None:
        """Compare what should be taken of octets with what was."""
        wanted, found = Counter(sound), Counter(taken)
        for _ in (found - wanted).elements():
            self.add(Fault.LENIENT, octets)
        for _ in (wanted - found).elements():
            self.add(Fault.DEAF, octets)

    def told(self, octets: bytes, lines: Sequence[str], least: int, most: int) -> None:
        """Check that so many lines were told."""
        if len(lines) < least:
            self.add(Fault.SILENT, octets)
        if len(lines) > most or any(map(_is_long, lines)):
            self.add(Fault.WORDY, (octets, lines))


class Lines(logging.Handler):
    """Keeps the lines of a logger instead of having them printed.

    Attributes:
        lines: what was logged since they were last cleared.
    """

    def __init__(self, name: str) -> None:
        """Take what is logged under a name, until `close`."""
        super().__init__(logging.WARNING)
        self.lines: list[str] = []
        self._logger = logging.getLogger(name)
        self._logger.addHandler(self)
        self._logger.propagate = False

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a line."""
        self.lines.append(record.getMessage())

    def close(self) -> None:
        """Let the logger be as it was."""
        self._logger.removeHandler(self)
        self._logger.propagate = True
        super().close()


def _is_long(line: str) -> bool:
    return "\n" in line or len(line) > LONGEST_LINE
