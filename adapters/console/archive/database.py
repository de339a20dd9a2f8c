"""Opens the archive's database, SQLite or PostgreSQL, and migrates its tables."""

import logging
import sqlite3
from pathlib import Path
from typing import Any, Final

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, create_engine, event, func, make_url, select
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError

from adapters.console.archive.tables import METADATA
from adapters.process import StartError, require
from adapters.system import OPERATING_SYSTEM, System

MIGRATIONS: Final = Path(__file__).parent / "migrations"
FILE: Final = "archive.sqlite"
SQLITE: Final = "sqlite"
POSTGRESQL: Final = "postgresql"
_DRIVERS: Final = {SQLITE: SQLITE, POSTGRESQL: "postgresql+psycopg"}
_WRITING: Final = 0x526F766572
"""Advisory lock of PostgreSQL for exclusive write transactions."""
_CONNECT_TIMEOUTS: Final = {
    "connect_timeout": 10,
    "tcp_user_timeout": 10_000,
    "keepalives_idle": 5,
    "keepalives_interval": 2,
    "keepalives_count": 3,
}
"""Options of libpq (s, ms): a connection without an answer for about 10 s is lost."""
BOUNDS_MS: Final = {"idle_in_transaction_session_timeout": 15_000, "lock_timeout": 30_000}
"""Timeouts of PostgreSQL, ms: a console that stalls in a transaction does not block the others."""
_HOW: Final = "write sqlite:///FILE or postgresql://USER@HOST/DATABASE"


class ArchiveError(Exception):
    """The archive could not be written; the text gives the reason."""


def cause_of(error: Exception) -> str:
    """Return the cause of a database error, in one line."""
    return str(getattr(error, "orig", None) or error).strip().partition("\n")[0]


def begin_writing(connection: Connection) -> None:
    """Start an exclusive write transaction; other consoles wait for its end."""
    if connection.dialect.name == SQLITE:
        connection.exec_driver_sql("BEGIN IMMEDIATE")
    else:
        connection.execute(select(func.pg_advisory_xact_lock(_WRITING)))


def open_database(url: str | None, folder: Path, system: System = OPERATING_SYSTEM) -> Engine:
    """Return the engine of a database, migrated to this version.

    Args:
        url: URL of the database; None for a file in the folder.
        folder: data folder.
        system: opens the SQLite file.

    Raises:
        StartError: it cannot be opened, or has the tables of another version.
        ModuleNotFoundError: its driver is not installed.
    """
    try:
        parsed = make_url(f"{SQLITE}:///{(folder / FILE).absolute()}" if url is None else url)
        driver = _DRIVERS[parsed.get_backend_name()]
    except (ArgumentError, KeyError, NoSuchModuleError) as error:
        raise StartError(f"--archive: {url} is no supported database: {_HOW}") from error
    silent = {}
    if driver != SQLITE:
        require("psycopg")
        silent = {
            name: value for name, value in _CONNECT_TIMEOUTS.items() if name not in parsed.query
        }
    url_of_driver = parsed.set(drivername=driver)
    engine = create_engine(url_of_driver, pool_pre_ping=True, connect_args=silent)
    if driver == SQLITE:
        event.listen(
            engine, "do_connect", lambda _, __, file, ___: system.connect(*file, any_thread=True)
        )
    event.listen(engine, "connect", _prepare if driver == SQLITE else _bound)
    try:
        _migrate(engine)
    except StartError:
        engine.dispose()
        raise
    except (DBAPIError, OSError) as error:
        engine.dispose()
        where = parsed.render_as_string(hide_password=True)
        raise StartError(f"the archive {where} cannot be opened: {cause_of(error)}") from error
    return engine


def _prepare(connection: Any, _: object) -> None:
    assert isinstance(connection, sqlite3.Connection)
    # FULL: a sent command survives a loss of power, so it is not sent a second time.
    for pragma in ("auto_vacuum=INCREMENTAL", "journal_mode=WAL", "synchronous=FULL"):
        connection.execute(f"PRAGMA {pragma}").close()
    connection.execute("PRAGMA busy_timeout=5000").close()


def _bound(connection: Any, _: object) -> None:
    for name, bound_ms in BOUNDS_MS.items():
        connection.execute(f"SET {name} = {bound_ms}")
    connection.commit()


def _migrate(engine: Engine) -> None:
    logging.getLogger("alembic").setLevel(logging.WARNING)
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    known = {each.revision for each in ScriptDirectory.from_config(config).walk_revisions()}
    with engine.begin() as connection:
        begin_writing(connection)
        current = MigrationContext.configure(connection).get_current_revision()
        if current is not None and current not in known:
            raise StartError(
                f"the archive has the tables of another version (revision {current}): start that"
                " version of rover-console, or choose another archive with --archive"
            )
        config.attributes["connection"] = connection
        if current is None:
            METADATA.create_all(connection, checkfirst=False)
            command.stamp(config, "head")
        else:
            command.upgrade(config, "head")
