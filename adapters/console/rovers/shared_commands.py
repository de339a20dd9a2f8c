"""Commands in the archive, where all consoles that use it find the same."""

import asyncio
from contextlib import suppress
from functools import partial

from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive import (
    LOOK_S,
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
    """Claims commands before they are sent, and takes in those of other consoles.

    Args:
        archive: where they are.
        tracker: takes them in.
    """

    def __init__(self, archive: Archive, tracker: CommandTracker) -> None:
        self._archive, self._tracker = archive, tracker
        self._seen = 0

    async def restore(self, count: int) -> None:
        """Take in the last commands, and all that have not ended."""
        self._seen = await self._archive.read(last_revision)
        self._tracker.restore(await self._archive.read(partial(last_commands, count=count)))

    async def claim(self, command: CommandStatus) -> bool:
        """Write a command down; return whether it is new: only then it may be sent.

        Raises:
            ArchiveError: it cannot be written.
        """
        return await self._archive.claim(command)

    async def find(self, name: str) -> CommandStatus | None:
        """Return how the command of an id stands, whichever console sent it."""
        known = self._tracker.get(name)
        if known is not None:
            return known
        return await self._archive.read(partial(read_command, name=name))

    async def look_up(self, asset: str, identity: Identity) -> None:
        """Take a command in that is heard of and not known here, if another console sent it."""
        if self._tracker.knows(asset, identity):
            return
        find = partial(
            find_command, asset=asset, source=identity.source, number=identity.command_id
        )
        with suppress(SQLAlchemyError):  # it is shown under its source until that can be read
            found = await self._archive.read(find)
            if found is not None:
                self._tracker.take_in(found)

    async def run(self) -> None:
        """Take in what other consoles wrote, again and again."""
        while True:
            await asyncio.sleep(LOOK_S)
            with suppress(SQLAlchemyError):  # the archive tells when it cannot be written
                await self._refresh()

    async def _refresh(self) -> None:
        changed = partial(changed_commands, since=self._seen)
        found, self._seen = await self._archive.read(changed)
        for command in found:
            self._tracker.take_in(command)
