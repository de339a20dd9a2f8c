"""A process that is started again and again, and waits for what it says."""

import re
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from sim.processes.children import Child

START_S: Final = 60.0
LOOK_S: Final = 0.02


class Victim:
    """One process at a time, with a life more at each start.

    Args:
        line: the module and its arguments in a life, counted from 0.
        up: what it says when it is up.

    Attributes:
        child: the process now.
        lives: how many there were.
    """

    def __init__(
        self,
        name: str,
        folder: Path,
        environment: Mapping[str, str],
        line: Callable[[int], Sequence[str]],
        up: str,
    ) -> None:
        """Start it."""
        self._name, self._folder, self._environment = name, folder, environment
        self._line, self._up = line, re.compile(re.escape(up))
        self.lives = 0
        self.child = self.start()

    def start(self) -> Child:
        """Begin the next life."""
        module, *arguments = self._line(self.lives)
        name = f"{self._name}-{self.lives}"
        self.child = Child(name, module, arguments, self._folder, self._environment)
        self.lives += 1
        return self.child

    def kill(self) -> None:
        """End it by kill -9, and begin the next life."""
        self.child.kill()
        self.start()

    def wait(self) -> None:
        """Return when it is up.

        Raises:
            ChildError: it ended by itself.
            TimeoutError: it does not come up.
        """
        deadline_s = time.monotonic() + START_S
        while self.child.said(self._up) is None:
            self.child.check()
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"{self.child.name} is not up after {START_S:.0f} s")
            time.sleep(LOOK_S)
