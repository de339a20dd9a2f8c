"""Queries of the archive: decimated samples, commands, notifications, records, open pages.

Samples, and pages of tables, are JSON texts, encoded on the reader thread. The open pages of the
consoles are also written here.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum, unique
from typing import Any, Final

from sqlalchemy import Column, Connection, Row, Select, Table, and_, func, or_, select, union_all

from adapters.console.archive.archive import QUALITIES, US_PER_S
from adapters.console.archive.rollup import MINUTE_US, candidates_of, gaps_of, ranked_of, samples_of
from adapters.console.archive.tables import (
    COMMAND,
    NOTIFICATION,
    PARAMETER,
    PRESENCE,
    RECORD,
    SAMPLE,
)
from adapters.console.messages import CommandStatus, LinkKind, OpenPage, decode_command

MAX_SAMPLES: Final = 20_000
"""Maximum number of samples in one response."""
LONG_US: Final = 720 * MINUTE_US
"""Minimum time span whose parts are whole minutes, µs."""
PAGE: Final = 10_000
"""Commands of one page."""


@unique
class Strategy(Enum):
    """Selection of the samples of a time span.

    Attributes:
        LATEST: the last samples.
        MINMAX: minimum, maximum and first unknown sample of each of `size` equal parts.
    """

    LATEST = "latest"
    MINMAX = "minmax"


@dataclass(frozen=True, slots=True)
class SampleQuery:
    """Query for samples of a parameter.

    Attributes:
        link: link of the samples; None for any.
        start_us, end_us: bounds of the sample time, included.
        size: number of samples, or of parts of the time span.
    """

    asset: str
    key: str
    link: LinkKind | None
    start_us: int
    end_us: int
    strategy: Strategy
    size: int


def read_samples(connection: Connection, wanted: SampleQuery) -> str:
    """Return samples as a JSON array, oldest first."""
    by_id = {
        each.id: each for each in find_parameters(connection, wanted.asset, wanted.key, wanted.link)
    }
    if not by_id:
        return "[]"
    chosen = (
        select(SAMPLE)
        .where(
            SAMPLE.c.parameter.in_(list(by_id)),
            SAMPLE.c.utc_us.between(wanted.start_us, wanted.end_us),
        )
        .order_by(SAMPLE.c.utc_us.desc())
    )
    match wanted.strategy:
        case Strategy.LATEST:
            rows = connection.execute(chosen.limit(wanted.size)).all()[::-1]
        case Strategy.MINMAX:
            rows = connection.execute(chosen.limit(2 * wanted.size + 1)).all()[::-1]
            if len(rows) > 2 * wanted.size:
                rows = connection.execute(_extremes(connection, wanted, list(by_id))).all()
    return json.dumps([_sample(by_id[row.parameter], row) for row in rows], separators=(",", ":"))


def _extremes(connection: Connection, wanted: SampleQuery, numbers: Sequence[int]) -> Select[Any]:
    """Return the query for minimum, maximum and gap of each part of a time span.

    Parts of a long span are whole minutes, whose extremes are stored.
    """
    first_us = min(_ends(connection, wanted, numbers, SAMPLE.c.utc_us))
    last_us = max(_ends(connection, wanted, numbers, SAMPLE.c.utc_us.desc()))
    if last_us - first_us >= LONG_US:
        origin_us = first_us // MINUTE_US * MINUTE_US
        minutes = (last_us - origin_us) // MINUTE_US // wanted.size + 1
        width_us = minutes * MINUTE_US
        candidates = candidates_of(numbers, first_us, last_us)
    else:
        origin_us = first_us
        width_us = (last_us - first_us) // wanted.size + 1
        candidates = samples_of(numbers, first_us, last_us)
    ranked = ranked_of(candidates, width_us, origin_us)
    chosen = union_all(
        select(ranked.c.parameter, ranked.c.utc_us).where(
            or_(ranked.c.lowest == 1, ranked.c.highest == 1)
        ),
        gaps_of(numbers, first_us, last_us, width_us, origin_us),
    ).subquery()
    return (
        select(SAMPLE)
        .join(
            chosen,
            and_(SAMPLE.c.parameter == chosen.c.parameter, SAMPLE.c.utc_us == chosen.c.utc_us),
        )
        .order_by(SAMPLE.c.utc_us)
    )


def _ends(
    connection: Connection, wanted: SampleQuery, numbers: Sequence[int], order: Any
) -> list[int]:
    """Return the first or the last sample time of each parameter within the time span."""
    found = (
        connection.execute(
            select(SAMPLE.c.utc_us)
            .where(
                SAMPLE.c.parameter == number,
                SAMPLE.c.utc_us.between(wanted.start_us, wanted.end_us),
            )
            .order_by(order)
            .limit(1)
        ).scalar()
        for number in numbers
    )
    return [each for each in found if each is not None]


def read_last_sample(
    connection: Connection, asset: str, key: str, link: LinkKind | None, end_us: int
) -> list[dict[str, Any]]:
    """Return the last sample of a parameter at or before a time, for each link."""
    found = []
    for parameter in find_parameters(connection, asset, key, link):
        newest = (
            select(SAMPLE)
            .where(SAMPLE.c.parameter == parameter.id, SAMPLE.c.utc_us <= end_us)
            .order_by(SAMPLE.c.utc_us.desc())
            .limit(1)
        )
        found += [_sample(parameter, row) for row in connection.execute(newest)]
    return found


@dataclass(frozen=True, slots=True)
class ArchivedParameter:
    """A telemetry parameter with samples."""

    id: int
    asset: str
    key: str
    link: str


def find_parameters(
    connection: Connection,
    asset: str | None = None,
    key: str | None = None,
    link: LinkKind | None = None,
) -> list[ArchivedParameter]:
    """Return parameters; None matches any."""
    chosen = select(PARAMETER)
    for column, wanted in (
        (PARAMETER.c.asset, asset),
        (PARAMETER.c.key, key),
        (PARAMETER.c.link, None if link is None else link.value),
    ):
        if wanted is not None:
            chosen = chosen.where(column == wanted)
    rows = connection.execute(chosen.order_by(PARAMETER.c.id))
    return [ArchivedParameter(row.id, row.asset, row.key, row.link) for row in rows]


def read_command(connection: Connection, name: str) -> CommandStatus | None:
    """Return a command by its id."""
    body = connection.execute(select(COMMAND.c.body).where(COMMAND.c.id == name)).scalar()
    return None if body is None else decode_command(json.loads(body))


def find_command(
    connection: Connection, asset: str, source: str, number: int
) -> CommandStatus | None:
    """Return a command by its source and number."""
    this = (COMMAND.c.asset == asset, COMMAND.c.source == source, COMMAND.c.number == number)
    body = connection.execute(select(COMMAND.c.body).where(*this)).scalar()
    return None if body is None else decode_command(json.loads(body))


def last_revision(connection: Connection) -> int:
    """Return the last revision of all commands; 0 for none."""
    return connection.execute(select(func.max(COMMAND.c.revision))).scalar() or 0


def changed_commands(connection: Connection, since: int) -> tuple[list[CommandStatus], int]:
    """Return the commands changed after a revision, and the last revision among them."""
    later = select(COMMAND.c.body, COMMAND.c.revision).where(COMMAND.c.revision > since)
    rows = connection.execute(later.order_by(COMMAND.c.revision).limit(PAGE)).all()
    last = rows[-1].revision if rows else since
    return [decode_command(json.loads(row.body)) for row in rows], last


def last_commands(connection: Connection, count: int) -> list[CommandStatus]:
    """Return the last commands and all that have not ended, oldest first."""
    newest = select(COMMAND.c.created_us, COMMAND.c.body).order_by(COMMAND.c.created_us.desc())
    found = {row.body: row.created_us for row in connection.execute(newest.limit(count))}
    found |= {
        row.body: row.created_us for row in connection.execute(newest.where(COMMAND.c.ended == 0))
    }
    bodies = sorted(found, key=lambda body: found[body])
    return [decode_command(json.loads(body)) for body in bodies]


@dataclass(frozen=True, slots=True)
class TablePage:
    """One page of a table, newest first.

    Attributes:
        asset: asset of the rows; None for all.
        start_us, before_us: included and excluded bound of the time; None for no bound.
    """

    asset: str | None
    start_us: int | None
    before_us: int | None
    limit: int

    def of(self, chosen: Select[Any], asset: Column[str], at: Column[int]) -> Select[Any]:
        """Return the query for the page, given the columns of asset and time."""
        if self.asset is not None:
            chosen = chosen.where(asset == self.asset)
        if self.start_us is not None:
            chosen = chosen.where(at >= self.start_us)
        if self.before_us is not None:
            chosen = chosen.where(at < self.before_us)
        return chosen.order_by(at.desc()).limit(self.limit)


def read_commands(connection: Connection, page: TablePage) -> str:
    """Return commands as a JSON array."""
    return _bodies(connection, COMMAND, COMMAND.c.created_us, page)


def read_notifications(connection: Connection, page: TablePage) -> str:
    """Return notifications as a JSON array."""
    return _bodies(connection, NOTIFICATION, NOTIFICATION.c.utc_us, page)


def read_records(connection: Connection, ty: str, page: TablePage) -> str:
    """Return records of a message type as a JSON array."""
    return _bodies(connection, RECORD, RECORD.c.utc_us, page, RECORD.c.ty == ty)


def last_notification(connection: Connection, asset: str, link: LinkKind) -> tuple[int, int] | None:
    """Return cursor and time, µs, of the last stored notification; None for none."""
    newest = (
        select(NOTIFICATION.c.cursor, NOTIFICATION.c.utc_us)
        .where(
            NOTIFICATION.c.asset == asset,
            NOTIFICATION.c.link == link.value,
            NOTIFICATION.c.cursor > 0,
        )
        .order_by(NOTIFICATION.c.id.desc())
        .limit(1)
    )
    row = connection.execute(newest).first()
    return None if row is None else (row.cursor, row.utc_us)


def _bodies(
    connection: Connection, table: Table, at: Column[int], page: TablePage, *others: Any
) -> str:
    chosen = page.of(select(table.c.body).where(*others), table.c.asset, at)
    return f"[{','.join(row.body for row in connection.execute(chosen))}]"


def _sample(parameter: ArchivedParameter, row: Row[Any]) -> dict[str, Any]:
    return {
        "ty": "tm",
        "asset": parameter.asset,
        "key": parameter.key,
        "link": parameter.link,
        "utc": row.utc_us / US_PER_S,
        "rx": row.rx_us / US_PER_S,
        "value": row.text if row.value is None else row.value,
        "q": QUALITIES[row.quality].value,
    }


@dataclass(frozen=True, slots=True)
class ConsolePages:
    """The open pages of a console.

    Attributes:
        instance: id of its process start.
        heartbeat: differs in each write.
    """

    instance: str
    heartbeat: int
    pages: tuple[OpenPage, ...]


def write_pages(connection: Connection, console: ConsolePages) -> None:
    """Replace the stored pages of a console; without pages its row is deleted."""
    connection.execute(PRESENCE.delete().where(PRESENCE.c.instance == console.instance))
    if console.pages:
        body = json.dumps([asdict(each) for each in console.pages])
        row = {"instance": console.instance, "heartbeat": console.heartbeat, "body": body}
        connection.execute(PRESENCE.insert().values(**row))


def read_pages(connection: Connection) -> list[ConsolePages]:
    """Return the pages of all consoles."""
    rows = connection.execute(select(PRESENCE).order_by(PRESENCE.c.instance))
    return [ConsolePages(row.instance, row.heartbeat, _pages(row.body)) for row in rows]


def forget_pages(connection: Connection, console: ConsolePages) -> None:
    """Delete the pages of a console that has ended, unless its heartbeat has changed."""
    this = (PRESENCE.c.instance == console.instance, PRESENCE.c.heartbeat == console.heartbeat)
    connection.execute(PRESENCE.delete().where(*this))


def _pages(body: str) -> tuple[OpenPage, ...]:
    return tuple(OpenPage(**each) for each in json.loads(body))
