"""What a process before this one left behind, as its ledger tells."""

from collections.abc import Sequence
from typing import Final, get_args

from executive.commands import Command, Resume, Setting, Stop
from executive.record.ledger import Ledger, request_of
from executive.reports import TERMINAL, Identity, Stage

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
    names = (Stop.__name__, Resume.__name__)
    rows = ledger.rows(
        "SELECT c.source, c.command_id, c.name, r.sequence FROM commands c CROSS JOIN reports r"
        " ON r.command_id = c.command_id AND r.source = c.source AND r.stage = ?"
        " WHERE c.name IN (?, ?) UNION ALL"
        " SELECT source, command_id, name, sequence FROM remembered WHERE name IN (?, ?)"
        " ORDER BY sequence DESC LIMIT 1",
        (Stage.ACCEPTED.value, *names, *names),
    )
    return next((Identity(*row[:2]) for row in rows if row[2] == Stop.__name__), None)


def last_settings(ledger: Ledger) -> Sequence[Setting]:
    """Return the last setting of each kind that was executed, in their order."""
    marks = ", ".join("?" * len(_SETTINGS))
    rows = ledger.rows(
        "SELECT name, request, max(sequence) AS last FROM ("
        "SELECT c.name, c.request, r.sequence FROM commands c CROSS JOIN reports r"
        " ON r.command_id = c.command_id AND r.source = c.source AND r.stage = ?"
        f" WHERE c.name IN ({marks}) UNION ALL"
        f" SELECT name, request, sequence FROM remembered WHERE name IN ({marks})"
        ") GROUP BY name ORDER BY last",
        (Stage.EXECUTED.value, *_SETTINGS, *_SETTINGS),
    )
    return [request_of(name, request) for name, request, _ in rows]  # type: ignore[misc]


def remember(ledger: Ledger, border: int) -> None:
    """Remember what `stopped_by` and `last_settings` know from reports before a number."""
    marks = ", ".join("?" * len(_SETTINGS))
    ledger.write(
        "INSERT OR REPLACE INTO remembered"
        " SELECT c.name, r.sequence, c.source, c.command_id, c.request"
        " FROM reports r JOIN commands c USING (source, command_id) WHERE r.sequence < ?"
        f" AND (r.stage = ? AND c.name IN (?, ?) OR r.stage = ? AND c.name IN ({marks}))"
        " ORDER BY r.sequence",
        (
            border,
            *(Stage.ACCEPTED.value, Stop.__name__, Resume.__name__),
            *(Stage.EXECUTED.value, *_SETTINGS),
        ),
    )
