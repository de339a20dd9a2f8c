"""What a process before this one left behind, as its ledger tells."""

from collections.abc import Sequence
from typing import Final, get_args

from executive.commands import Command, Identity, Resume, Setting, Stop
from executive.ledger import Ledger, request_of
from executive.reports import TERMINAL, Stage

_SETTINGS: Final = tuple(kind.__name__ for kind in get_args(Setting))


def unfinished(ledger: Ledger) -> Sequence[tuple[Command, Stage]]:
    """Return the commands whose life has not ended, in the order of their arrival."""
    ended = ",".join(str(stage.value) for stage in TERMINAL)
    rows = ledger.rows(
        "SELECT source, command_id, name, request, link, stage,"
        " (SELECT min(sequence) FROM reports r WHERE r.source = c.source"
        "  AND r.command_id = c.command_id) AS first"
        " FROM commands c JOIN stages USING (source, command_id)"
        f" WHERE stage NOT IN ({ended}) ORDER BY first"
    )
    return [
        (Command(Identity(source, number), request_of(name, request), link), Stage(stage))
        for source, number, name, request, link, stage, _ in rows
    ]


def stopped_by(ledger: Ledger) -> Identity | None:
    """Return the last stop that was accepted, unless a resume was accepted after it."""
    rows = ledger.rows(
        "SELECT c.source, c.command_id, c.name FROM commands c CROSS JOIN reports r"
        " ON r.command_id = c.command_id AND r.source = c.source AND r.stage = ?"
        " WHERE c.name IN (?, ?) ORDER BY r.sequence DESC LIMIT 1",
        (Stage.ACCEPTED.value, Stop.__name__, Resume.__name__),
    )
    return next((Identity(*row[:2]) for row in rows if row[2] == Stop.__name__), None)


def last_settings(ledger: Ledger) -> Sequence[Setting]:
    """Return the last setting of each kind that was executed, in their order."""
    marks = ", ".join("?" * len(_SETTINGS))
    rows = ledger.rows(
        "SELECT c.name, c.request, max(r.sequence) AS last FROM commands c CROSS JOIN reports r"
        " ON r.command_id = c.command_id AND r.source = c.source AND r.stage = ?"
        f" WHERE c.name IN ({marks}) GROUP BY c.name ORDER BY last",
        (Stage.EXECUTED.value, *_SETTINGS),
    )
    return [request_of(name, request) for name, request, _ in rows]  # type: ignore[misc]
