"""`PoseRecord`: the executive's pose and its uncertainty, in the ledger's file."""

import json
from typing import Final, TypeVar

from cattrs.preconf.json import make_converter

from executive.record.ledger import Ledger

T = TypeVar("T")

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS pose (only_row INTEGER PRIMARY KEY, state TEXT NOT NULL);
"""
_CONVERTER: Final = make_converter()


class PoseRecord:
    """The last committed state, so that a restart does not turn a wrong pose into a certain one.

    Raises:
        LedgerError: from every method, if the file cannot be read or written.
    """

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        ledger.add_tables(_SCHEMA)

    def read(self, kind: type[T]) -> T | None:
        """Return the last committed state as its class; None before the first."""
        rows = self._ledger.rows("SELECT state FROM pose")
        return _CONVERTER.structure(json.loads(rows[0][0]), kind) if rows else None

    def write(self, state: object) -> None:
        """Write the state with the next commit; without effect for None."""
        if state is None:
            return
        text = json.dumps(_CONVERTER.unstructure(state))
        self._ledger.write("INSERT OR REPLACE INTO pose VALUES (0, ?)", (text,))
