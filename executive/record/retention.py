"""`LedgerRetention` deletes old reports of the ledger, and the commands that ended with them.

Used numbers are stored permanently and exactly, as ranges: nothing is executed twice, and no
unused number counts as used, regardless of the numbers that others send under a source. An isolated
number takes about 30 octets. The last settings and the state of the stop are also stored until
they change.

Reports that external senders can flood have a limit of their own, so that they do not displace
reports of commands; where they were deleted, the stored sequence has gaps.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Final

from executive.record.ledger import SETTINGS, STOP_AND_RESUME, TERMINAL_STAGES, Ledger
from executive.values.reports import Identity, Stage

PRUNE_BATCH: Final = 100
"""Number of reports deleted in one commit; chosen, not measured."""
FOREIGN_SHARE: Final = 10
"""Divisor of the report limit that gives the limit of foreign reports; chosen, not measured."""
_MAX_NUMBER: Final = 2**63 - 1

Range = tuple[int, int]
"""The first and the last of consecutive numbers."""


class LedgerRetention:
    """Deletes reports older than the newest ones, a slice at a time.

    A command that has not ended is retained completely, with all reports since its begin.

    Args:
        passed: minimum number of retained reports, without foreign ones.
        at_once: number of reports deleted at once.

    Raises:
        LedgerError: the ledger cannot be read.
    """

    def __init__(self, ledger: Ledger, passed: int, at_once: int = PRUNE_BATCH) -> None:
        self._ledger = ledger
        self._retained = passed
        self._at_once = at_once
        self._last_counted = ledger.last_sequence
        self._done = False
        self._foreign = self._count("foreign_reports")
        self._own = self._count("reports") - self._foreign

    def tick(self) -> None:
        """Delete a slice, if one exceeds the limit, with the next commit.

        Call it when nothing is pending.

        Raises:
            LedgerError: the ledger cannot be read.
        """
        if self._ledger.failing or (
            self._ledger.last_sequence == self._last_counted and self._done
        ):
            return
        self._take_count()
        if self._foreign >= self._retained // FOREIGN_SHARE + self._at_once:
            self._prune_foreign()
        elif self._own >= self._retained + self._at_once:
            self._prune()
        else:
            self._done = True

    def _take_count(self) -> None:
        """Count the reports since the last tick."""
        last = self._ledger.last_sequence
        foreign = self._count("foreign_reports", f"WHERE sequence > {self._last_counted}")
        self._own += last - self._last_counted - foreign
        self._foreign += foreign
        self._last_counted, self._done = last, False

    def _count(self, table: str, where: str = "") -> int:
        return int(self._ledger.rows(f"SELECT count(*) FROM {table} {where}")[0][0])

    def _prune_foreign(self) -> None:
        ((border,),) = self._ledger.rows(
            "SELECT sequence FROM foreign_reports ORDER BY sequence LIMIT 1 OFFSET ?",
            (self._at_once - 1,),
        )
        self._ledger.write(
            "DELETE FROM reports WHERE sequence IN"
            " (SELECT sequence FROM foreign_reports WHERE sequence <= ?)",
            (border,),
        )
        self._ledger.write("DELETE FROM foreign_reports WHERE sequence <= ?", (border,))
        self._foreign -= self._at_once

    def _prune(self) -> None:
        ((border,),) = self._ledger.rows(
            "SELECT sequence FROM reports WHERE sequence NOT IN foreign_reports"
            " ORDER BY sequence LIMIT 1 OFFSET ?",
            (self._at_once,),
        )
        border = self._before_unfinished(border)
        before = f"WHERE sequence < {border}"
        old = self._count("reports", before)
        if old == 0:
            self._done = True
            return
        foreign = self._count("foreign_reports", before)
        self._preserve(border)
        numbers = defaultdict(list)
        for identity, stage in self._commands_without_reports(border):
            self._ledger.prune(identity, stage)
            numbers[identity.source].append(identity.command_id)
        for source, used in numbers.items():
            self._record_used(source, used)
        for table in ("reports", "foreign_reports"):
            self._ledger.write(f"DELETE FROM {table} {before}", ())
        self._own -= old - foreign
        self._foreign -= foreign

    def _preserve(self, border: int) -> None:
        """Preserve the last settings and the last stop from reports before a number."""
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
        """Return a lower border, so that no unfinished command loses its first reports."""
        ((first,),) = self._ledger.rows(
            "SELECT min(sequence) FROM reports JOIN stages s USING (source, command_id)"
            f" WHERE sequence < ? AND s.stage NOT IN ({TERMINAL_STAGES})",
            (border,),
        )
        return border if first is None else int(first)

    def _commands_without_reports(self, border: int) -> Sequence[tuple[Identity, Stage]]:
        """Return the commands that have no report from a number on.

        NOT INDEXED, because the index by command would be scanned completely.
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

    def _record_used(self, source: str, numbers: Iterable[int]) -> None:
        """Record permanently that a source used these numbers, and no others."""
        new = merge_ranges((number, number) for number in numbers)
        before = {row for each in new for row in self._touching(source, *each)}
        after = set(merge_ranges([*before, *new]))
        for first, _ in before - after:
            self._ledger.write("DELETE FROM used WHERE source = ? AND first = ?", (source, first))
        for each in after - before:
            self._ledger.write("INSERT OR REPLACE INTO used VALUES (?, ?, ?)", (source, *each))

    def _touching(self, source: str, first: int, last: int) -> Sequence[Range]:
        """Return the stored ranges that overlap a range or are adjacent to it."""
        rows = self._ledger.rows(
            "SELECT first, last FROM (SELECT first, last FROM used WHERE source = ?"
            " AND first <= ? ORDER BY first DESC LIMIT 1) WHERE last >= ? - 1 UNION ALL"
            " SELECT first, last FROM used WHERE source = ? AND first > ? AND first <= ?",
            (source, first, first, source, first, min(last + 1, _MAX_NUMBER)),
        )
        return [(row[0], row[1]) for row in rows]


def merge_ranges(ranges: Iterable[Range]) -> Sequence[Range]:
    """Merge ranges into ascending, non-adjacent ranges with the same numbers."""
    found: list[Range] = []
    for first, last in sorted(ranges):
        if found and first - found[-1][1] <= 1:
            found[-1] = (found[-1][0], max(found[-1][1], last))
        else:
            found.append((first, last))
    return found
