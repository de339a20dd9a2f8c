"""The operations console beside simulated rovers: `rover-console`, where its extra is installed."""

import os
import re
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from sim.processes.children import LOOK_S, Child, ProcessGroup
from sim.processes.place import ANY_PORT, HOST

SERVES: Final = re.compile(r"^(http://\S+)$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class OperationsConsole:
    """A console that runs.

    Attributes:
        address: for a browser.
    """

    process: ProcessGroup
    address: str


@contextmanager
def operations_console(folder: Path, uris: Sequence[str]) -> Iterator[OperationsConsole | None]:
    """Yield a console of rovers once it serves; None where its extra is not installed.

    Args:
        folder: gets its log, and its archive.
        uris: of the rovers.

    Raises:
        ChildError: it ended.
    """
    if find_spec("aiohttp") is None:
        yield None
        return
    from adapters.console import PORT, PORT_VARIABLE

    to = [word for uri in uris for word in ("--to", uri)]
    arguments = [*to, "--data", str(folder / "console")]
    if PORT_VARIABLE not in os.environ and not _is_free(PORT):
        arguments += ["--port", str(ANY_PORT)]
    child = Child("console", "adapters.console.process", arguments, folder, {})
    try:
        while (found := child.said(SERVES)) is None:
            child.check()
            time.sleep(LOOK_S)
        yield OperationsConsole(ProcessGroup(child), found[1])
    finally:
        child.end()


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True
