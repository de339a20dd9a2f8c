"""Processes that are started, killed by -9 and started again, in a place of their own."""

import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from sim.processes import allocate_address
from sim.processes.children import ChildProcess

CHECKOUT: Final = Path(__file__).resolve().parents[2]
LISTENS: Final = r"listens at \D*(?:[\d.]+:)?(\d+)"
"""What servers of ours say when they are up; the group is the port."""
START_S: Final = 60.0
POLL_S: Final = 0.02
Line = Callable[[int], Sequence[object]]
"""A module and its arguments for each life, counted from 0."""


class Victim:
    """One process at a time, with one life more at each start; each life has a log."""

    def __init__(self, name: str, workplace: "Workplace", line: Line, up: str) -> None:
        self.name = name
        self.starts = 0
        self._workplace, self._line, self._up = workplace, line, up
        self.start()

    def start(self, *more: str) -> None:
        """Begin the next life, with further arguments."""
        module, *arguments = map(str, self._line(self.starts))
        self.starts += 1
        name, workspace = f"{self.name}-{self.starts}", self._workplace
        self.child = ChildProcess(
            name, module, (*arguments, *more), workspace.folder, workspace.environment
        )

    def restart(self, *more: str) -> None:
        """End this life by kill -9 and begin the next."""
        self.child.kill()
        self.start(*more)

    def wait(self, pattern: str = "", limit_s: float = START_S) -> re.Match[str]:
        """Wait until it says something: that it is up, unless told otherwise."""
        deadline_s, wanted = time.monotonic() + limit_s, re.compile(pattern or self._up)
        while (found := self.child.find_output(wanted)) is None:
            self.child.check()
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"{self.child.name} never says {wanted.pattern!r}")
            time.sleep(POLL_S)
        return found

    def port(self) -> int:
        """Wait until it listens; return where."""
        return int(self.wait()[1])


class Workplace:
    """Where victims live: a folder for logs and data, and a ROS domain nobody else uses."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.folder, self.domain = folder, domain
        paths = filter(None, (str(CHECKOUT), os.environ.get("PYTHONPATH")))
        self.environment = {"ROS_DOMAIN_ID": str(domain), "PYTHONPATH": os.pathsep.join(paths)}
        self.victims: list[Victim] = []

    def start(self, name: str, *line: object, up: str = LISTENS) -> Victim:
        """Start a module with its arguments."""
        return self.start_again(name, lambda _: line, up)

    def start_again(self, name: str, line: Line, up: str = LISTENS) -> Victim:
        """Start a module whose arguments differ from life to life."""
        self.victims.append(Victim(name, self, line, up))
        return self.victims[-1]

    def check(self) -> None:
        """Raise ChildError if a process ended by itself."""
        for victim in self.victims:
            victim.child.check()


@contextmanager
def workplace(output: Path | None = None) -> Iterator[Workplace]:
    """Yield a place for victims; in the end they are ended, and the folder is gone unless kept.

    Must be called on the main thread, which no other thread may run beside yet.
    """
    with allocate_address() as address, tempfile.TemporaryDirectory(prefix="rover-") as passing:
        found = Workplace(output or Path(passing), address.domain)
        try:
            yield found
        finally:
            for victim in reversed(found.victims):
                victim.child.end()
