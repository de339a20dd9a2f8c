"""How much of a rover's past the orbiter keeps."""

from collections.abc import Callable
from typing import Final

from executive.commands import Identity
from executive.ledger import Ledger

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS forgotten (only_row INTEGER PRIMARY KEY, sequence INTEGER NOT NULL);
"""
_OF_COMMAND: Final = "{0}.source = c.source AND {0}.command_id = c.command_id"
_COMMANDS: Final = (
    "DELETE FROM commands AS c WHERE"
    f" coalesce((SELECT max(sequence) FROM reports r WHERE {_OF_COMMAND.format('r')}), 0) <= ?"
    f" AND NOT EXISTS (SELECT 1 FROM asked a WHERE {_OF_COMMAND.format('a')}"
    "  AND (a.until_utc_s > ? OR NOT a.ended AND EXISTS"
    f"   (SELECT 1 FROM stages s WHERE {_OF_COMMAND.format('s')})))"
    " AND NOT (c.source = ? AND c.command_id = ?)"
)
_REPORTS: Final = (
    "DELETE FROM reports AS r WHERE sequence <= ?"
    f" AND NOT EXISTS (SELECT 1 FROM commands c WHERE {_OF_COMMAND.format('r')})"
)
_LEFTOVERS: Final = (
    *(
        f"DELETE FROM {table} AS t"
        f" WHERE NOT EXISTS (SELECT 1 FROM commands c WHERE {_OF_COMMAND.format('t')})"
        for table in ("stages", "asked")
    ),
    "DELETE FROM heard AS h WHERE NOT EXISTS (SELECT 1 FROM reports r WHERE r.sequence = h.number)",
)


_SLACK: Final = 20
"""One part in so many may be too much, that it is not looked through every time."""


class History:
    """Forgets the oldest reports above a number, and the commands of which nothing is left.

    What is under way stays, and so does what can still come again: a command is known for its
    whole lifetime. So there may be more than that number for a while. A stop that holds stays, too.

    Args:
        ledger: commands and reports, with the tables of `Asked` and `Record`.
        most: how many reports are kept.
        stopped_by: returns the stop that holds.

    Raises:
        LedgerError: from every method, if the file cannot be read or written.
    """

    def __init__(
        self, ledger: Ledger, most: int, stopped_by: Callable[[], Identity | None]
    ) -> None:
        """Go on with what is forgotten already."""
        self._ledger, self._most, self._stopped_by = ledger, most, stopped_by
        ledger.extend(_SCHEMA)
        rows = ledger.rows("SELECT sequence FROM forgotten")
        self._border = int(rows[0][0]) if rows else 0

    def forgot(self, number: int) -> bool:
        """Return whether a number that nothing has now may have been forgotten."""
        return 0 < number <= self._border

    def prune(self, utc_s: float) -> None:
        """Forget what is too much at a time."""
        too_many = self._most + self._most // _SLACK
        ((lowest,),) = self._ledger.rows("SELECT min(sequence) FROM reports")
        if (lowest or 0) < -too_many:
            self._forget_refusals(lowest + self._most)
        border = self._number_after(self._most)
        if border > self._border and self._number_after(too_many):
            self._forget(border, utc_s)

    def _forget_refusals(self, number: int) -> None:
        """Forget refusals without a number, which are numbered downwards, from a number on."""
        self._ledger.write("DELETE FROM reports WHERE sequence BETWEEN ? AND -1", (number,))
        self._ledger.write(_LEFTOVERS[-1], ())
        self._ledger.commit()

    def _forget(self, border: int, utc_s: float) -> None:
        stop = self._stopped_by()
        kept = ("", 0) if stop is None else (stop.source, stop.command_id)
        self._ledger.write(_COMMANDS, (border, utc_s, *kept))
        self._ledger.write(_REPORTS, (border,))
        for statement in _LEFTOVERS:
            self._ledger.write(statement, ())
        self._ledger.write("INSERT OR REPLACE INTO forgotten VALUES (0, ?)", (border,))
        self._ledger.commit()
        self._border = border

    def _number_after(self, count: int) -> int:
        """Return the number of the newest report that so many come after; 0 if there is none."""
        rows = self._ledger.rows(
            "SELECT sequence FROM reports WHERE sequence > 0"
            " ORDER BY sequence DESC LIMIT 1 OFFSET ?",
            (count,),
        )
        return int(rows[0][0]) if rows else 0
