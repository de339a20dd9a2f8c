"""Faults of the console that storms, or a situation, must find; see `planted.py`."""

from contextlib import AbstractContextManager, suppress
from typing import Any
from unittest.mock import patch

from adapters.console import command_states
from adapters.console.archive import Archive, ArchiveError, database
from adapters.console.messages import CommandStatus, LinkKind
from adapters.console.rovers import Fleet, LastNotification, RoverLink, SharedCommands
from adapters.console.tasks import start_task
from adapters.mrs.ground import CommandIdGenerator
from adapters.mrs.ground.client import EPOCH_MS
from adapters.system import utc_ns


def acknowledged_before_commit() -> AbstractContextManager[object]:
    async def write(archive: Archive, command: CommandStatus) -> None:
        with suppress(ArchiveError):
            await archive.claim_command(command)

    async def claim(self: SharedCommands, command: CommandStatus) -> bool:
        start_task(write(self._archive, command))
        return True

    return patch.object(SharedCommands, "claim", claim)


def cursor_of_other_link() -> AbstractContextManager[object]:
    async def last_known(self: Fleet, link: RoverLink) -> LastNotification | None:
        found = [await self._last_known(link.asset, kind) for kind in LinkKind]
        return max((each for each in found if each), key=lambda each: each.cursor, default=None)

    return patch.object(Fleet, "last_known", last_known)


def failed_batch_dropped() -> AbstractContextManager[object]:
    flush = Archive._flush

    async def drop(self: Archive) -> None:
        await flush(self)
        if self._failing:
            self._waiting.clear()

    return patch.object(Archive, "_flush", drop)


def commits_not_synced() -> AbstractContextManager[object]:
    prepare = database._prepare

    def unsynced(connection: Any, record: object) -> None:
        prepare(connection, record)
        connection.execute("PRAGMA synchronous=NORMAL").close()

    return patch.object(database, "_prepare", unsynced)


def numbers_of_the_clock() -> AbstractContextManager[object]:
    def take(self: CommandIdGenerator) -> int:
        return utc_ns(self._system) // 1_000_000 - EPOCH_MS

    return patch.object(CommandIdGenerator, "next_id", take)


def refusal_outweighs_stages() -> AbstractContextManager[object]:
    return patch.object(command_states, "_disproves_refusal", lambda *_: False)
