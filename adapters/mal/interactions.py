"""The INVOKEs and PROGRESSes under way at a provider."""

import asyncio
from collections import Counter
from typing import Final

from adapters.mal.call import Handler, Parts
from adapters.mal.connection import Connection
from adapters.mal.errors import MalError, StandardError
from adapters.mal.interaction import Interaction

INTERACTION_CAP: Final = 256
"""Interactions under way over one connection, at most."""


class Interactions:
    """Runs a handler for each, until it ends or the consumer's connection does."""

    def __init__(self) -> None:
        """Begin without any."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._running: Counter[Connection] = Counter()

    def begin(self, interaction: Interaction, handler: Handler, parts: Parts) -> None:
        """Let a handler serve an interaction.

        Raises:
            MalError: TOO_MANY over its connection.
        """
        connection = interaction.call.connection
        if self._running[connection] == INTERACTION_CAP:
            raise MalError(StandardError.TOO_MANY)
        self._running[connection] += 1
        task = asyncio.ensure_future(interaction.run(handler, parts))

        def cancel(_lost: asyncio.Future[None]) -> None:
            task.cancel()

        def end(_ended: asyncio.Future[None]) -> None:
            connection.lost.remove_done_callback(cancel)
            self._tasks.discard(task)
            self._running[connection] -= 1
            if not self._running[connection]:
                del self._running[connection]

        connection.lost.add_done_callback(cancel)
        task.add_done_callback(end)
        self._tasks.add(task)

    async def close(self) -> None:
        """Cancel all, each of which is answered for."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
