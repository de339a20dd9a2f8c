"""Commands of all consoles at one archive."""

import asyncio
from contextlib import suppress
from functools import partial

from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive import (
    POLL_S,
    Archive,
    changed_commands,
    find_command,
    last_commands,
    last_revision,
    read_command,
)
from adapters.console.messages import CommandStatus
from adapters.console.rovers.tracker import CommandTracker
from executive.values.reports import Identity


class SharedCommands:
    """Claims commands before they are sent, and merges those of other consoles.

    Args:
        archive: stores the commands.
        tracker: tracks their states.
    """

    def __init__(self, archive: Archive, tracker: CommandTracker) -> None:
        self._archive, self._tracker = archive, tracker
        self._last_revision = 0

    async def restore(self, count: int) -> None:
        """Restore the last commands, and all that have not ended."""
        self._last_revision = await self._archive.read(last_revision)
        self._tracker.restore(await self._archive.read(partial(last_commands, count=count)))

    async def claim(self, command: CommandStatus) -> bool:
        """Store a command; return whether it is new, which permits sending it.

        Raises:
            ArchiveError: the archive cannot be written.
        """
        return await self._archive.claim_command(command)

    async def find(self, name: str) -> CommandStatus | None:
        """Return the status of a command of any console by its id; None if unknown."""
        known = self._tracker.get(name)
        if known is not None:
            return known
        return await self._archive.read(partial(read_command, name=name))

    async def load_foreign(self, asset: str, identity: Identity) -> None:
        """Load a command that another console sent."""
        if self._tracker.knows(asset, identity):
            return
        find = partial(
            find_command, asset=asset, source=identity.source, number=identity.command_id
        )
        with suppress(SQLAlchemyError):  # shown under its source until the archive can be read
            found = await self._archive.read(find)
            if found is not None:
                self._tracker.merge(found)

    async def run(self) -> None:
        """Merge changes of other consoles periodically."""
        while True:
            await asyncio.sleep(POLL_S)
            with suppress(SQLAlchemyError):  # the archive logs that it cannot be written
                await self._refresh()

    async def _refresh(self) -> None:
        changed = partial(changed_commands, since=self._last_revision)
        found, self._last_revision = await self._archive.read(changed)
        for command in found:
            self._tracker.merge(command)
