"""`Archive` stores received messages in batches, and runs queries on them.

One thread writes, which preserves the order; another reads. Neither blocks the event loop.
"""

import asyncio
import json
import logging
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any, Final, TypeVar, assert_never

from sqlalchemy import Connection, Engine, Insert, Table, bindparam, func, select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive.database import SQLITE, ArchiveError, begin_writing, cause_of
from adapters.console.archive.rollup import add_samples
from adapters.console.archive.tables import (
    COMMAND,
    NOTIFICATION,
    PARAMETER,
    RECORD,
    SAMPLE,
    SAMPLE_MINUTE,
)
from adapters.console.command_states import merge
from adapters.console.messages import (
    AlarmStatus,
    AssetState,
    AuthorityMessage,
    Broadcast,
    CommandStatus,
    DictionaryChanged,
    FileChanged,
    LinkStatus,
    NotificationMessage,
    ObjectChanged,
    PlanProgress,
    Presence,
    Quality,
    QuestionStatus,
    Sample,
    StopStatus,
    TreeState,
    decode_command,
    encode,
    plain,
)
from executive.values.reports import without_figures

_LOG: Final = logging.getLogger(__name__)
T = TypeVar("T")

POLL_S: Final = 1.0
"""Poll interval for data of other consoles, s."""
WRITE_S: Final = 0.5
"""Interval between two batches, s."""
MAX_PENDING: Final = 100_000
"""Capacity of the queue while the database cannot be written; beyond it old messages are lost."""
NEIGHBOURING_STATES: Final = 8
"""Number of neighbouring states that are searched for the previous one of the same link."""
US_PER_S: Final = 1e6
QUALITIES: Final = list(Quality)

_WHEN: Final = {"utc", "lease_left"}
_Recorded = AssetState | AuthorityMessage | PlanProgress | TreeState | LinkStatus | FileChanged
Written = Sample | TreeState | Broadcast
Rows = list[dict[str, Any]]


def to_us(utc_s: float) -> int:
    """Convert a time to the whole microseconds of the tables."""
    return round(utc_s * US_PER_S)


class Archive:
    """Stores messages in the database.

    Args:
        engine: engine of a migrated database.
        utc: clock, s since 1970 UTC.

    Attributes:
        utc: clock of the reception times.
        samples: number of telemetry values written since the start.
        lost: number of messages dropped because the queue was full.
    """

    def __init__(self, engine: Engine, utc: Callable[[], float]) -> None:
        self.utc = utc
        self._engine = engine
        self._is_sqlite = engine.dialect.name == SQLITE
        self._writer = ThreadPoolExecutor(1, "archive writer")
        self._reader = ThreadPoolExecutor(1, "archive reader")
        self._waiting: deque[Written] = deque(maxlen=MAX_PENDING)
        self._last_trees: dict[str, tuple[tuple[str | None, ...], ...]] = {}
        self._parameters: dict[tuple[str, str, str], int] = {}
        self._failing = False
        self._flushing = asyncio.Lock()
        self.samples = self.lost = 0

    @property
    def waiting(self) -> int:
        """Number of queued messages."""
        return len(self._waiting)

    def put(self, message: Written) -> None:
        """Queue a message for the next batch."""
        self.lost += len(self._waiting) == MAX_PENDING
        self._waiting.append(message)

    def put_tree(self, tree: TreeState) -> None:
        """Queue a behaviour tree, if it differs from the previous one.

        Compared are statuses and commands of the nodes, the mode, and the cause of motion or
        standstill without its figures. Only the display of the archive depends on the comparison
        of texts.
        """
        content = (
            (tree.mode, without_figures(tree.why)),
            *((node.path, node.status, node.command) for node in tree.nodes),
        )
        if self._last_trees.get(tree.asset) != content:
            self._last_trees[tree.asset] = content
            self.put(tree)

    async def run(self) -> None:
        """Write batches periodically."""
        while True:
            await asyncio.sleep(WRITE_S)
            await self.flush()

    async def flush(self) -> None:
        """Write the queue. After a failure, which is logged, the messages stay queued."""
        async with self._flushing:  # keeps the order: a failed batch returns to the queue
            await self._flush()

    async def _flush(self) -> None:
        batch = tuple(self._waiting)
        self._waiting.clear()
        if not batch:
            return
        try:
            await self.write(partial(self._write, batch=batch, rx_us=to_us(self.utc())))
        except asyncio.CancelledError:  # it may be written nevertheless; writing is idempotent
            self._waiting.extendleft(reversed(batch))
            raise
        except SQLAlchemyError as error:
            self._parameters.clear()  # new parameters were not written either
            self._waiting.extendleft(reversed(batch))
            if not self._failing:
                _LOG.error("the archive cannot be written, messages wait: %s", cause_of(error))
            self._failing = True
        else:
            self.samples += sum(isinstance(message, Sample) for message in batch)
            if self._failing:
                _LOG.warning("the archive can be written again")
            self._failing = False

    async def claim_command(self, command: CommandStatus) -> bool:
        """Store a new command; return whether its id and its number are new.

        If several consoles claim it at the same time, one succeeds.

        Raises:
            ArchiveError: it cannot be written.
        """
        try:
            return await self.write(lambda connection: self._add(connection, command))
        except SQLAlchemyError as error:
            raise ArchiveError(f"the archive cannot be written: {cause_of(error)}") from error

    async def write(self, act: Callable[[Connection], T]) -> T:
        """Run a function in a write transaction, after the earlier writes.

        No other console writes during the transaction.
        """

        def transaction() -> T:
            with self._engine.begin() as connection:
                begin_writing(connection)
                return act(connection)

        return await asyncio.get_running_loop().run_in_executor(self._writer, transaction)

    async def read(self, act: Callable[[Connection], T]) -> T:
        """Run a function on a connection of the reader thread."""

        def reading() -> T:
            with self._engine.connect() as connection:
                return act(connection)

        return await asyncio.get_running_loop().run_in_executor(self._reader, reading)

    async def close(self) -> None:
        """Write the queue and close the database."""
        with suppress(SQLAlchemyError):
            await self.flush()
        self._writer.shutdown()
        self._reader.shutdown()
        self._engine.dispose()

    def _write(self, connection: Connection, batch: Sequence[Written], rx_us: int) -> None:
        samples: Rows = []
        notifications: Rows = []
        records: Rows = []
        commands: dict[str, CommandStatus] = {}
        for message in batch:
            match message:
                case Sample():
                    samples.append(self._sample(connection, message))
                case NotificationMessage():
                    notifications.append(
                        {
                            "asset": message.asset,
                            "link": message.link.value,
                            "sequence": message.sequence,
                            "utc_us": to_us(message.utc),
                            "rx_us": to_us(message.rx),
                            "body": encode(message),
                            "cursor": message.cursor or 0,
                        }
                    )
                case CommandStatus():
                    commands[message.id] = message
                case AssetState() | AuthorityMessage():
                    self._store_state(connection, message, rx_us)
                case PlanProgress() | TreeState():
                    records.append(_record(message, message.utc, rx_us))
                case LinkStatus():
                    records.append(_record(message, message.since, rx_us))
                case FileChanged():
                    records.append(_record(message, message.rx, rx_us))
                case (
                    AlarmStatus()
                    | StopStatus()
                    | QuestionStatus()
                    | Presence()
                    | DictionaryChanged()
                    | ObjectChanged()
                ):
                    pass
                case _:
                    assert_never(message)
        self._samples(connection, samples)
        self._insert(connection, NOTIFICATION, notifications)
        if records:
            connection.execute(_NEW_RECORD, records)
        for command in commands.values():
            self._store_command(connection, command)

    def _store_state(
        self, connection: Connection, message: AssetState | AuthorityMessage, rx_us: int
    ) -> None:
        """Store a state, unless a neighbouring state of the same link has the same content."""
        new = _record(message, message.utc, rx_us)
        this = (RECORD.c.ty == new["ty"], RECORD.c.asset == new["asset"])
        state, utc_us = _without_times(new["body"]), RECORD.c.utc_us
        before, after = utc_us <= new["utc_us"], utc_us > new["utc_us"]
        for side, order in ((before, utc_us.desc()), (after, utc_us)):
            found = (
                select(RECORD.c.body).where(*this, side).order_by(order).limit(NEIGHBOURING_STATES)
            )
            neighbours = map(_without_times, connection.execute(found).scalars())
            if state == next((each for each in neighbours if each["link"] == state["link"]), None):
                return
        connection.execute(_NEW_RECORD, new)

    def _sample(self, connection: Connection, sample: Sample) -> dict[str, Any]:
        value = plain(sample.value)  # a float that is not finite becomes text
        is_text = isinstance(value, str)
        return {
            "parameter": self._parameter(connection, sample),
            "utc_us": to_us(sample.utc),
            "rx_us": to_us(sample.rx),
            "value": None if is_text or value is None else float(value),
            "text": value if is_text else None,
            "quality": QUALITIES.index(sample.q),
        }

    def _samples(self, connection: Connection, rows: Rows) -> None:
        """Store samples, and add the new ones to their minutes."""
        if not rows:
            return
        key = (SAMPLE.c.parameter, SAMPLE.c.utc_us)
        inserting = self._insert_into(SAMPLE).on_conflict_do_nothing().returning(*key)
        new = {tuple(row) for row in connection.execute(inserting, rows)}
        added = []
        for row in rows:
            if (row["parameter"], row["utc_us"]) in new:
                new.remove((row["parameter"], row["utc_us"]))
                added.append(row)
        add_samples(connection, self._insert_into(SAMPLE_MINUTE), added)

    def _parameter(self, connection: Connection, sample: Sample) -> int:
        key = (sample.asset, sample.key, sample.link.value)
        if key not in self._parameters:
            named = dict(zip(("asset", "key", "link"), key, strict=True))
            self._insert(connection, PARAMETER, [named])
            wanted = [PARAMETER.c[name] == value for name, value in named.items()]
            number = connection.execute(select(PARAMETER.c.id).where(*wanted)).scalar_one()
            self._parameters[key] = number
        return self._parameters[key]

    def _insert(self, connection: Connection, table: Table, rows: Rows) -> None:
        """Insert rows; existing rows are kept unchanged."""
        if rows:
            connection.execute(self._insert_into(table).on_conflict_do_nothing(), rows)

    def _insert_into(self, table: Table) -> Any:
        return sqlite.insert(table) if self._is_sqlite else postgresql.insert(table)

    def _store_command(self, connection: Connection, command: CommandStatus) -> None:
        """Store a command, merged with the state that other consoles stored."""
        this = (
            COMMAND.c.asset == command.asset,
            COMMAND.c.source == command.source,
            COMMAND.c.number == command.number,
        )
        body = connection.execute(select(COMMAND.c.body).where(*this)).scalar()
        if body is None:
            self._add(connection, command)
            return
        stored = decode_command(json.loads(body))
        merged = merge(stored, command)
        if merged != stored:
            row = _command_row(connection, merged)
            connection.execute(COMMAND.update().where(*this).values(**row))

    def _add(self, connection: Connection, command: CommandStatus) -> bool:
        insert = self._insert_into(COMMAND).values(**_command_row(connection, command))
        new = insert.on_conflict_do_nothing().returning(COMMAND.c.id)
        return connection.execute(new).first() is not None


def _record(message: _Recorded, utc_s: float, rx_us: int) -> dict[str, Any]:
    return {
        "ty": message.ty,
        "asset": message.asset,
        "utc_us": to_us(utc_s),
        "rx_us": rx_us,
        "body": encode(message),
    }


def _without_times(body: str) -> dict[str, Any]:
    """Return a state without its times: consoles receive it at different times."""
    return {name: value for name, value in json.loads(body).items() if name not in _WHEN}


def _command_row(connection: Connection, command: CommandStatus) -> dict[str, Any]:
    last = connection.execute(select(func.max(COMMAND.c.revision))).scalar()
    return {
        "id": command.id,
        "asset": command.asset,
        "source": command.source,
        "number": command.number,
        "created_us": to_us(command.created),
        "ended": int(command.ended),
        "body": encode(command),
        "revision": (last or 0) + 1,
    }


def _new_record() -> Insert:
    """Return the statement that inserts a record, unless an equal one is stored."""
    given = {
        each.name: bindparam(each.name, type_=each.type) for each in RECORD.c if each.name != "id"
    }
    same = select(RECORD.c.id).where(
        *(RECORD.c[name] == given[name] for name in ("ty", "asset", "utc_us", "body"))
    )
    return RECORD.insert().from_select(list(given), select(*given.values()).where(~same.exists()))


_NEW_RECORD: Final = _new_record()
