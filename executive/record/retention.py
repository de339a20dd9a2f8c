"""How far back the record goes: old reports are let go, and the commands that ended with them.

What stays for ever is that their numbers were used, so that nothing is executed twice, and what
holds until it is changed: the last settings, and whether the rover is stopped.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final

from executive.record.ledger import Ledger
from executive.record.recovery import remember
from executive.reports import TERMINAL, Identity, Stage

SLICE: Final = 100
"""Reports that are let go in one commit."""
MOST_RANGES: Final = 1000
"""Ranges in which the numbers of one source are kept; where there are more, the nearest join."""

_ENDED: Final = ",".join(str(stage.value) for stage in TERMINAL)

Range = tuple[int, int]
"""The first and the last number of a row of them."""


class Retention:
    """Lets go of what lies before the newest reports, a slice at a time.

    A life that has not ended is kept whole, with all that was said since it began.

    Args:
        kept: how many reports stay, at least.
        at_once: how many are let go at once.

    Raises:
        LedgerError: the ledger cannot be read.
    """

    def __init__(self, ledger: Ledger, kept: int, at_once: int = SLICE) -> None:
        """Look how far back the record goes."""
        self._ledger = ledger
        self._kept = kept
        self._at_once = at_once
        ((first,),) = ledger.rows("SELECT min(sequence) FROM reports")
        self._first: int = first or ledger.last_sequence + 1

    def tick(self) -> None:
        """Let go of a slice, if there is one to spare, with the next commit.

        To be called when everything is committed.

        Raises:
            LedgerError: the ledger cannot be read.
        """
        border = self._first + self._at_once
        if self._ledger.failing or border > self._ledger.last_sequence - self._kept + 1:
            return
        border = self._whole(border)
        if border == self._first:
            return
        remember(self._ledger, border)
        numbers = defaultdict(list)
        for identity, stage in self._ended(border):
            self._ledger.forget(identity, stage)
            numbers[identity.source].append(identity.command_id)
        for source, used in numbers.items():
            self._use(source, used)
        self._ledger.write("DELETE FROM reports WHERE sequence < ?", (border,))
        self._first = border

    def _whole(self, border: int) -> int:
        """Return a border that cuts no life in two that has not ended."""
        ((first,),) = self._ledger.rows(
            "SELECT min(sequence) FROM reports JOIN stages s USING (source, command_id)"
            f" WHERE sequence < ? AND s.stage NOT IN ({_ENDED})",
            (border,),
        )
        return border if first is None else int(first)

    def _ended(self, border: int) -> Sequence[tuple[Identity, Stage]]:
        """Return the commands of which nothing was said any more from a number on.

        NOT INDEXED, because the index by command would be gone through as a whole.
        """
        rows = self._ledger.rows(
            "SELECT DISTINCT r.source, r.command_id, s.stage"
            " FROM reports r NOT INDEXED JOIN stages s USING (source, command_id)"
            " WHERE r.sequence < ? AND NOT EXISTS (SELECT 1 FROM reports later"
            " WHERE later.command_id = r.command_id AND later.source = r.source"
            " AND later.sequence >= ?)",
            (border, border),
        )
        return [(Identity(source, number), Stage(stage)) for source, number, stage in rows]

    def _use(self, source: str, numbers: Iterable[int]) -> None:
        """Remember for ever that a source used these numbers."""
        rows = self._ledger.rows("SELECT first, last FROM used WHERE source = ?", (source,))
        before = {(first, last) for first, last in rows}
        after = set(merge_ranges([*before, *((number, number) for number in numbers)]))
        for first, _ in before - after:
            self._ledger.write("DELETE FROM used WHERE source = ? AND first = ?", (source, first))
        for each in after - before:
            self._ledger.write("INSERT INTO used VALUES (?, ?, ?)", (source, *each))


def merge_ranges(ranges: Iterable[Range], most: int = MOST_RANGES) -> Sequence[Range]:
    """Return ranges in rising order that hold every number of these, so many at most.

    They hold no other number, unless there would be too many of them: then the narrowest gaps are
    closed.
    """
    rising = sorted(ranges)
    gaps = sorted(later[0] - earlier[1] for earlier, later in pairwise(_merged(rising, 1)))
    too_many = len(gaps) + 1 - most
    return _merged(rising, gaps[too_many - 1] if too_many > 0 else 1)


def _merged(rising: Iterable[Range], gap: int) -> Sequence[Range]:
    """Return ranges with those made one that lie no further apart than this."""
    found: list[Range] = []
    for first, last in rising:
        if found and first - found[-1][1] <= gap:
            found[-1] = (found[-1][0], max(found[-1][1], last))
        else:
            found.append((first, last))
    return found
