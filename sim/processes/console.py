"""`operations_console` starts `rover-console` for simulated rovers, if its extra is installed."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from adapters.console import PORT, PORT_VARIABLE
from sim.processes.children import ChildProcess, ProcessGroup
from sim.processes.rover_address import ANY_PORT, is_free

SERVES: Final = re.compile(r"^(http://\S+)$", re.MULTILINE)


class OperationsConsole(ProcessGroup):
    """A console process."""

    def __init__(self, console: ChildProcess) -> None:
        super().__init__(console)
        self._console = console

    async def address(self) -> str:
        """Wait until it serves, and return the address for a browser.

        Raises:
            ChildError: it ended.
        """
        return await self.wait_for_output(self._console, SERVES)


@contextmanager
def operations_console(
    folder: Path, uris: Sequence[str], port: int | None = None, round_trip_s: float = 0.0
) -> Iterator[OperationsConsole | None]:
    """Yield a console of rovers, with its log and archive in a folder.

    It is None if its extra is not installed. Without a port it uses the default one, or a free one
    if that is in use.
    """
    if find_spec("aiohttp") is None:
        yield None
        return
    to = [word for uri in uris for word in ("--to", uri)]
    arguments = [*to, "--delay", f"{round_trip_s}s", "--data", str(folder / "console")]
    if port is not None:
        arguments += ["--port", str(port)]
    elif PORT_VARIABLE not in os.environ and not is_free(PORT):
        arguments += ["--port", str(ANY_PORT)]
    child = ChildProcess("console", "adapters.console.process", arguments, folder, {})
    try:
        yield OperationsConsole(child)
    finally:
        child.end()
