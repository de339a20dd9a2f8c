"""Reads archived data page by page for the export, oldest first: samples, or complete records."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from sqlalchemy import Column, Connection, Table, select, tuple_

from adapters.console.archive.alarms import alarm_of
from adapters.console.archive.archive import QUALITIES, US_PER_S
from adapters.console.archive.queries import ArchivedParameter
from adapters.console.archive.tables import ALARM, COMMAND, NOTIFICATION, RECORD, SAMPLE
from adapters.console.messages import (
    AlarmStatus,
    CommandStatus,
    NotificationMessage,
    PlanProgress,
    TreeState,
    plain,
)

PAGE: Final = 10_000
"""Samples of one page."""
RECORD_PAGE: Final = 500
"""Records of one page; a tree has some kilobytes."""


class ExportRow(NamedTuple):
    """A sample with its parameter; `value` is text unless it is a finite number."""

    utc: float
    rx: float
    asset: str
    link: str
    key: str
    value: float | str | None
    quality: str


def export_page(
    connection: Connection, parameter: ArchivedParameter, start_us: int, end_us: int
) -> tuple[list[ExportRow], int | None]:
    """Return samples from a time on, and the start of the next page, µs; None after the last."""
    rows = connection.execute(
        select(SAMPLE)
        .where(SAMPLE.c.parameter == parameter.id, SAMPLE.c.utc_us.between(start_us, end_us))
        .order_by(SAMPLE.c.utc_us)
        .limit(PAGE)
    ).all()
    page = [
        ExportRow(
            row.utc_us / US_PER_S,
            row.rx_us / US_PER_S,
            parameter.asset,
            parameter.link,
            parameter.key,
            row.text if row.value is None else row.value,
            QUALITIES[row.quality].value,
        )
        for row in rows
    ]
    return page, rows[-1].utc_us + 1 if len(rows) == PAGE else None


Exported = (
    type[CommandStatus]
    | type[NotificationMessage]
    | type[TreeState]
    | type[PlanProgress]
    | type[AlarmStatus]
)
"""Types that are exported as complete records."""


@dataclass(frozen=True, slots=True)
class ExportRecord:
    """A complete record of the archive.

    Attributes:
        utc: time by the clock of its sender.
        rx: reception time at the console, if known.
        body: JSON object of the message, without `ty`.
    """

    utc: float
    rx: float
    body: dict[str, Any]


ExportCursor = tuple[int, int | str]
"""Time and id of a row."""


def record_page(
    connection: Connection,
    kind: Exported,
    asset: str | None,
    start_us: int,
    end_us: int,
    after: ExportCursor | None = None,
) -> tuple[list[ExportRecord], ExportCursor | None]:
    """Return records of a kind within a time span, and the cursor of the next page, if any."""
    table, at, rx = _SOURCES[kind]
    chosen = select(table, at.label("at_us"), rx.label("at_rx_us")).where(
        at.between(start_us, end_us)
    )
    if table is RECORD:
        chosen = chosen.where(RECORD.c.ty == kind.ty)
    if asset is not None:
        chosen = chosen.where(table.c.asset == asset)
    if after is not None:
        chosen = chosen.where(tuple_(at, table.c.id) > tuple_(*after))
    rows: Sequence[Any] = connection.execute(
        chosen.order_by(at, table.c.id).limit(RECORD_PAGE)
    ).all()
    page = []
    for row in rows:
        body = plain(alarm_of(row)) if table is ALARM else json.loads(row.body)
        body.pop("ty", None)
        page.append(ExportRecord(row.at_us / US_PER_S, row.at_rx_us / US_PER_S, body))
    return page, (rows[-1].at_us, rows[-1].id) if len(rows) == RECORD_PAGE else None


_SOURCES: Final[dict[Exported, tuple[Table, Column[int], Column[int]]]] = {
    CommandStatus: (COMMAND, COMMAND.c.created_us, COMMAND.c.created_us),
    NotificationMessage: (NOTIFICATION, NOTIFICATION.c.utc_us, NOTIFICATION.c.rx_us),
    TreeState: (RECORD, RECORD.c.utc_us, RECORD.c.rx_us),
    PlanProgress: (RECORD, RECORD.c.utc_us, RECORD.c.rx_us),
    AlarmStatus: (ALARM, ALARM.c.raised_us, ALARM.c.raised_us),
}
