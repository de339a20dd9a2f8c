"""Retention: old reports are deleted, and the commands that ended with them.

That their numbers were used is kept for ever, so that nothing is executed twice, and so is what
holds until it is changed: the last settings, and whether the rover is stopped.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final

from executive.record.ledger import SETTINGS, STOP_AND_RESUME, TERMINAL_STAGES, Ledger
from executive.reports import Identity, Stage

SLICE: Final = 100
"""Reports that are deleted in one commit."""
MOST_RANGES: Final = 1000
"""Ranges of used numbers that are kept of one source; beyond that the narrowest gaps close."""

Range = tuple[int, int]
"""The first and the last of consecutive numbers."""


class Retention:
    """Deletes what lies before the newest reports, a slice at a time.

    A life that has not ended is kept whole, with all reports since it began.

    Args:
        kept: how many reports stay, at least.
        at_once: how many are deleted at once.

    Raises:
        LedgerError: the ledger cannot be read.
    """

    def __init__(self, ledger: Ledger, kept: int, at_once: int = SLICE) -> None:
        self._ledger = ledger
        self._kept = kept
        self._at_once = at_once
        ((first,),) = ledger.rows("SELECT min(sequence) FROM reports")
        self._first: int = first or ledger.last_sequence + 1

    def tick(self) -> None:
        """Delete a slice, if there is one to spare, with the next commit.

        To be called when everything is committed.

        Raises:
            LedgerError: the ledger cannot be read.
        """
        border = self._first + self._at_once
        if self._ledger.failing or border > self._ledger.last_sequence - self._kept + 1:
            return
        border = self._before_unfinished(border)
        if border == self._first:
            return
        self._remember(border)
        numbers = defaultdict(list)
        for identity, stage in self._ended(border):
            self._ledger.prune(identity, stage)
            numbers[identity.source].append(identity.command_id)
        for source, used in numbers.items():
            self._use(source, used)
        self._ledger.write("DELETE FROM reports WHERE sequence < ?", (border,))
        self._first = border

    def _remember(self, border: int) -> None:
        """Keep what reports before a number say of the last settings and of a stop."""
        marks = ", ".join("?" * len(SETTINGS))
        self._ledger.write(
            "INSERT OR REPLACE INTO remembered"
            " SELECT c.name, r.sequence, c.source, c.command_id, c.request"
            " FROM reports r JOIN commands c USING (source, command_id) WHERE r.sequence < ?"
            f" AND (r.stage = ? AND c.name IN (?, ?) OR r.stage = ? AND c.name IN ({marks}))"
            " ORDER BY r.sequence",
            (border, Stage.ACCEPTED.value, *STOP_AND_RESUME, Stage.EXECUTED.value, *SETTINGS),
        )

    def _before_unfinished(self, border: int) -> int:
        """Return a border that cuts no life in two that has not ended."""
        ((first,),) = self._ledger.rows(
            "SELECT min(sequence) FROM reports JOIN stages s USING (source, command_id)"
            f" WHERE sequence < ? AND s.stage NOT IN ({TERMINAL_STAGES})",
            (border,),
        )
        return border if first is None else int(first)

    def _ended(self, border: int) -> Sequence[tuple[Identity, Stage]]:
        """Return the commands that have no report from a number on.

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
