"""Python modules as processes: each with its log, none of them outliving this one.

Processes that are watched together tell whoever waits when one ends by itself.
"""

import asyncio
import ctypes
import logging
import os
import re
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

PATIENCE_S: Final = 5.0
_PR_SET_PDEATHSIG: Final = 1
_TAIL_LINES: Final = 15
_LOG: Final = logging.getLogger(__name__)


class ChildError(Exception):
    """A process ended by itself; the text names it, how it ended, and the end of its log."""


class ChildProcess:
    """A Python module that runs as a process of its own.

    Must be started by the main thread, before any other thread: the kernel ends the child with
    the thread that started it. A Ctrl-C at the terminal does not reach it.

    Args:
        up: what it writes when it is up. With it, a process that ends by itself after that is
            started again by `check`; one that was never up would only end again.
    """

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        folder: Path,
        environment: Mapping[str, str],
        up: re.Pattern[str] | None = None,
    ) -> None:
        self.name = name
        self.log = folder / f"{name}.log"
        self._ending = False
        self._up = up
        self._command = [sys.executable, "-m", module, *arguments]
        self._environment = {**os.environ, **environment}
        self.log.write_bytes(b"")
        self._process = self._start()

    def _start(self) -> "subprocess.Popen[bytes]":
        self._log_start = self.log.stat().st_size
        with self.log.open("a", encoding="utf-8") as log:
            return subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                process_group=0,
                preexec_fn=_end_with_parent,
            )

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    def check(self) -> None:
        """Do nothing while it runs; start it again where it was up.

        Raises:
            ChildError: it ended.
        """
        code = self._process.poll()
        if code is None or self._ending:
            return
        written = self.log.read_bytes()[self._log_start :].decode(errors="replace")
        how = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit status {code}"
        if self._up is not None and self._up.search(written):
            _LOG.warning("the %s process ended %s and is started again", self.name, how)
            self._process = self._start()
            return
        lines = written.splitlines()[-_TAIL_LINES:]
        tail = "\n".join(f"  | {line}" for line in lines) or "  | (it said nothing)"
        raise ChildError(f"the {self.name} process ended {how}. The end of {self.log}:\n{tail}")

    def said(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        """Return the first match in what it has written so far."""
        return pattern.search(self.log.read_text(encoding="utf-8", errors="replace"))

    def end(self) -> None:
        """Ask it to end, and make it after `PATIENCE_S`; then end what it has left behind."""
        self._ending = True
        self._process.terminate()
        try:
            self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)  # the guard of an executive that was killed

    def kill(self) -> None:
        """End it as kill -9 does: at once, without a last word."""
        self._ending = True
        self._process.kill()
        self._process.wait()


_PRCTL: Final = ctypes.CDLL(None, use_errno=True).prctl
_PARENT: Final = os.getpid()


def _end_with_parent() -> None:
    """Have the kernel send SIGTERM to this child when its parent is gone, however that ended."""
    _PRCTL(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != _PARENT:
        os._exit(1)


LOOK_S: Final = 0.1


class ProcessGroup:
    """Some processes that are to run until they are ended."""

    def __init__(self, *children: ChildProcess) -> None:
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

    async def said(self, child: ChildProcess, pattern: re.Pattern[str]) -> str:
        """Wait until a process has written a pattern, and return its first group.

        Raises:
            ChildError: a process ended.
        """
        while (found := child.said(pattern)) is None:
            self.check()
            await asyncio.sleep(LOOK_S / 5)
        return found[1]

    async def guard(self) -> None:
        """Watch for ever.

        Raises:
            ChildError: a process ended.
        """
        while True:
            self.check()
            await asyncio.sleep(LOOK_S)
