"""Open pages of each console, shared through the database."""

import json
from dataclasses import asdict, dataclass

from sqlalchemy import Connection, select

from adapters.console.archive.tables import PRESENCE
from adapters.console.messages import OpenPage


@dataclass(frozen=True, slots=True)
class ConsolePages:
    """The open pages of a console.

    Attributes:
        instance: id of its process start.
        beat: heartbeat; differs in each write.
    """

    instance: str
    beat: int
    pages: tuple[OpenPage, ...]


def write_pages(connection: Connection, console: ConsolePages) -> None:
    """Replace the stored pages of a console; without pages its row is deleted."""
    connection.execute(PRESENCE.delete().where(PRESENCE.c.instance == console.instance))
    if console.pages:
        body = json.dumps([asdict(each) for each in console.pages])
        row = {"instance": console.instance, "beat": console.beat, "body": body}
        connection.execute(PRESENCE.insert().values(**row))


def read_pages(connection: Connection) -> list[ConsolePages]:
    """Return the pages of all consoles."""
    rows = connection.execute(select(PRESENCE).order_by(PRESENCE.c.instance))
    return [ConsolePages(row.instance, row.beat, _pages(row.body)) for row in rows]


def forget_pages(connection: Connection, console: ConsolePages) -> None:
    """Delete the pages of a console that has ended, unless its heartbeat has changed."""
    this = (PRESENCE.c.instance == console.instance, PRESENCE.c.beat == console.beat)
    connection.execute(PRESENCE.delete().where(*this))


def _pages(body: str) -> tuple[OpenPage, ...]:
    return tuple(OpenPage(**each) for each in json.loads(body))
