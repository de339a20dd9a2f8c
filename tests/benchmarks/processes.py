"""The processes that are measured, in a ROS domain and a folder of their own."""

import re
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, Self

from sim.processes import free_place
from sim.processes.children import Child

START_S: Final = 30.0
LOOK_S: Final = 0.05
_LISTENS: Final = re.compile(r"listens at \D*(?:[\d.]+:)?(\d+)")


class Bench:
    """Where processes are measured, for the time of a `with`.

    Attributes:
        domain: a ROS domain that nobody else uses.
        folder: for logs and data; gone in the end.
    """

    def __enter__(self) -> Self:
        """Take a domain and a folder."""
        with ExitStack() as held:
            self.domain = held.enter_context(free_place()).domain
            self.folder = Path(held.enter_context(tempfile.TemporaryDirectory()))
            self._held = held.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Give both back."""
        self._held.close()

    @contextmanager
    def started(self, name: str, module: str, *arguments: str) -> Iterator[Child]:
        """Yield a module of ours that runs as a process."""
        environment = {"ROS_DOMAIN_ID": str(self.domain)}
        child = Child(name, module, arguments, self.folder, environment)
        try:
            yield child
        finally:
            child.end()


def port_of(child: Child) -> int:
    """Wait until a process says where it listens, and return the port.

    Raises:
        ChildError: it ended before.
        TimeoutError: it does not say so.
    """
    deadline_s = time.monotonic() + START_S
    while (found := child.said(_LISTENS)) is None:
        child.check()
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"{child.name} does not listen after {START_S:.0f} s")
        time.sleep(LOOK_S)
    return int(found[1])
