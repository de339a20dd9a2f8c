"""Processes that are watched together: when one ends by itself, whoever waits hears of it."""

import asyncio
from pathlib import Path
from typing import Final

from sim.processes.children import Child

LOOK_S: Final = 0.1


class Guarded:
    """Some processes that are to run until they are ended."""

    def __init__(self, *children: Child) -> None:
        """Take charge of the processes."""
        self.children = children

    @property
    def logs(self) -> tuple[Path, ...]:
        """Where the processes log."""
        return tuple(child.log for child in self.children)

    def check(self) -> None:
        """Do nothing while all run.

        Raises:
            ChildError: a process ended.
        """
        for child in self.children:
            child.check()

    async def guard(self) -> None:
        """Watch for ever.

        Raises:
            ChildError: a process ended.
        """
        while True:
            self.check()
            await asyncio.sleep(LOOK_S)
