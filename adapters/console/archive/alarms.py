"""Changes of alarms in the archive, which consoles at a database share, and their queries.

At most one alarm of a source is open. A report that was received before (by another link or
console, or before a restart) changes nothing: occurrences are identified by their time aboard.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import Connection, Row, or_, select

from adapters.console.archive.archive import US_PER_S, to_us
from adapters.console.archive.queries import TablePage
from adapters.console.archive.tables import ALARM
from adapters.console.messages import AlarmStatus


@dataclass(frozen=True, slots=True)
class AlarmRaised:
    """An alarm is to be raised.

    Attributes:
        source: fault, report or limit that raises it.
        utc: time of the occurrence, by the onboard clock.
        persistent: whether it is active until an `AlarmCleared`.
        reoccurrence: whether it counts as another occurrence if the alarm is active already.
    """

    asset: str
    source: str
    utc: float
    severity: str
    text: str
    command: str | None = None
    persistent: bool = False
    reoccurrence: bool = True


@dataclass(frozen=True, slots=True)
class AlarmCleared:
    """The cause of an alarm has ended."""

    asset: str
    source: str
    utc: float


@dataclass(frozen=True, slots=True)
class AlarmCommand:
    """The cause of an alarm has ended a command."""

    asset: str
    source: str
    utc: float
    command: str


Change = AlarmRaised | AlarmCleared | AlarmCommand


def change_alarms(connection: Connection, changes: Sequence[Change]) -> None:
    """Raise and clear alarms in the order of the changes."""
    for change in changes:
        known = _last(connection, change)
        match change:
            case AlarmRaised():
                _raise(connection, change, known)
            case AlarmCleared(utc=utc):
                active = known is not None and known.cleared_us is None
                if known is not None and active and to_us(utc) >= known.last_us:
                    is_open = int(known.acknowledged_us is None)
                    _update(connection, known.id, cleared_us=to_us(utc), open=is_open)
            case AlarmCommand(utc=utc, command=command):
                if known is not None and known.command is None and to_us(utc) >= known.last_us:
                    _update(connection, known.id, command=command)


def acknowledge_alarms(
    connection: Connection, seen: Sequence[tuple[int, int]], operator: str, utc_s: float
) -> None:
    """Acknowledge alarms as an operator saw them; an alarm with a later occurrence stays open.

    Args:
        connection: connection of the writer thread.
        seen: id and number of occurrences of each.
        operator: acknowledging operator.
        utc_s: time of the acknowledgement.
    """
    for number, occurrences in seen:
        chosen = (
            ALARM.c.id == number,
            ALARM.c.occurrences == occurrences,
            ALARM.c.acknowledged_us.is_(None),
        )
        row = connection.execute(select(ALARM).where(*chosen)).first()
        if row is not None:
            is_open = int(row.cleared_us is None)
            by = {"operator": operator, "acknowledged_us": to_us(utc_s)}
            _update(connection, number, open=is_open, **by)


def shelve_alarm(
    connection: Connection, number: int, shelving: tuple[float, str, str], utc_s: float
) -> None:
    """Shelve an open alarm, or end its shelving.

    Args:
        connection: connection of the writer thread.
        number: id of the alarm.
        shelving: duration in seconds, 0 to end it; operator; comment.
        utc_s: time of the operator's action.
    """
    duration_s, operator, comment = shelving
    values = {
        "shelved_us": to_us(utc_s),
        "shelved_until_us": to_us(utc_s + duration_s) if duration_s else None,
        "shelved_by": operator,
        "comment": comment or None,
    }
    chosen = (ALARM.c.id == number, ALARM.c.open == 1)
    connection.execute(ALARM.update().where(*chosen).values(**values))


def open_alarms(connection: Connection, also: Sequence[int] = ()) -> list[AlarmStatus]:
    """Return the open alarms, and further ones by their ids, in the order of ids."""
    chosen = select(ALARM).where(or_(ALARM.c.open == 1, ALARM.c.id.in_(also)))
    return [alarm_of(row) for row in connection.execute(chosen.order_by(ALARM.c.id))]


def read_alarms(connection: Connection, page: TablePage) -> list[AlarmStatus]:
    """Return open and closed alarms, newest first."""
    chosen = page.of(select(ALARM), ALARM.c.asset, ALARM.c.raised_us).order_by(ALARM.c.id.desc())
    return [alarm_of(row) for row in connection.execute(chosen)]


def _raise(connection: Connection, raised: AlarmRaised, known: Row[Any] | None) -> None:
    utc_us = to_us(raised.utc)
    if known is not None and utc_us <= known.last_us:
        return
    values = {
        "severity": raised.severity,
        "text": raised.text,
        "command": raised.command,
        "last_us": utc_us,
        "cleared_us": None if raised.persistent else utc_us,
        "operator": None,
        "acknowledged_us": None,
    }
    if known is None or not known.open:
        first = {
            "asset": raised.asset,
            "source": raised.source,
            "raised_us": utc_us,
            "occurrences": 1,
        }
        if known is not None and (known.shelved_until_us or 0) > utc_us:
            first |= {name: getattr(known, name) for name in _SHELVING}
        connection.execute(ALARM.insert().values(**first, **values, open=1))
    elif raised.reoccurrence or known.cleared_us is not None:
        _update(connection, known.id, occurrences=known.occurrences + 1, **values)


_SHELVING: Final = ("shelved_us", "shelved_until_us", "shelved_by", "comment")
"""Columns that a recurrence inherits while the alarm is shelved."""


def _last(connection: Connection, change: Change) -> Row[Any] | None:
    chosen = (ALARM.c.asset == change.asset, ALARM.c.source == change.source)
    newest = select(ALARM).where(*chosen).order_by(ALARM.c.id.desc()).limit(1)
    return connection.execute(newest).first()


def _update(connection: Connection, number: int, **changed: Any) -> None:
    connection.execute(ALARM.update().where(ALARM.c.id == number).values(**changed))


def alarm_of(row: Row[Any]) -> AlarmStatus:
    """Return the alarm of a row."""

    def utc(us: int | None) -> float | None:
        return None if us is None else us / US_PER_S

    return AlarmStatus(
        id=row.id,
        asset=row.asset,
        source=row.source,
        severity=row.severity,
        text=row.text,
        command=row.command,
        raised=row.raised_us / US_PER_S,
        last=row.last_us / US_PER_S,
        occurrences=row.occurrences,
        cleared=utc(row.cleared_us),
        operator=row.operator,
        acknowledged=utc(row.acknowledged_us),
        shelved=utc(row.shelved_us),
        shelved_until=utc(row.shelved_until_us),
        shelved_by=row.shelved_by,
        comment=row.comment,
    )
