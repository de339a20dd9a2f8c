"""`ChildProcess`: a Python module as child process with a log; it ends with its parent process.

A group of supervised processes raises an error to its waiters when one ends by itself.
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

TERMINATE_TIMEOUT_S: Final = 5.0
_PR_SET_PDEATHSIG: Final = 1
_TAIL_LINES: Final = 15
_LOG: Final = logging.getLogger(__name__)


class ChildError(Exception):
    """A process ended by itself; the text has its name, exit status, and the end of its log."""


class ChildProcess:
    """A Python module that runs as a child process.

    Must be started by the main thread, before any other thread: the kernel ends the child with
    the thread that started it. A Ctrl-C at the terminal does not reach it.

    Args:
        up: pattern in its log that shows that it is up. With it, `check` restarts a process that
            ends by itself after that; one that was never up would only end again.
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
        # -P: else a folder `sim` where the user is would be imported in place of ours.
        self._command = [sys.executable, "-P", "-m", module, *arguments]
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
        """Process id."""
        return self._process.pid

    def check(self) -> None:
        """Raise ChildError unless it runs; restart it instead if it was up.

        Raises:
            ChildError: it ended.
        """
        code = self._process.poll()
        if code is None or self._ending:
            return
        written = self.log.read_bytes()[self._log_start :].decode(errors="replace")
        how = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit status {code}"
        if self._up is not None and self._up.search(written):
            _LOG.warning("the %s process ended %s and is restarted", self.name, how)
            self._process = self._start()
            return
        lines = written.splitlines()[-_TAIL_LINES:]
        tail = "\n".join(f"  | {line}" for line in lines) or "  | (the log is empty)"
        raise ChildError(f"the {self.name} process ended {how}. The end of {self.log}:\n{tail}")

    def find_output(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        """Return the first match in its output so far."""
        return pattern.search(self.log.read_text(encoding="utf-8", errors="replace"))

    def find_outputs(self, pattern: re.Pattern[str]) -> list[str]:
        """Return all matches in its output: their groups, if the pattern has one."""
        return pattern.findall(self.log.read_text(encoding="utf-8", errors="replace"))

    def end(self) -> None:
        """Terminate it, kill it after `TERMINATE_TIMEOUT_S`.

        Then kill the processes that it has left.
        """
        self._ending = True
        self._process.terminate()
        try:
            self._process.wait(TERMINATE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)  # the guard of an executive that was killed

    def kill(self) -> None:
        """End it as kill -9 does: at once, without a clean-up."""
        self._ending = True
        self._process.kill()
        self._process.wait()


_PRCTL: Final = ctypes.CDLL(None, use_errno=True).prctl
_PARENT: Final = os.getpid()


def _end_with_parent() -> None:
    """Have the kernel send SIGTERM to this child when its parent has ended for any reason."""
    _PRCTL(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != _PARENT:
        os._exit(1)


POLL_S: Final = 0.1


class ProcessGroup:
    """Processes that must run until they are ended."""

    def __init__(self, *children: ChildProcess) -> None:
        self.children = children

    @property
    def logs(self) -> tuple[Path, ...]:
        """Log files of the processes."""
        return tuple(child.log for child in self.children)

    def check(self) -> None:
        """Raise ChildError unless all run.

        Raises:
            ChildError: a process ended.
        """
        for child in self.children:
            child.check()

    async def wait_for_output(self, child: ChildProcess, pattern: re.Pattern[str]) -> str:
        """Wait until a process has written a pattern, and return its first group.

        Raises:
            ChildError: a process ended.
        """
        while (found := child.find_output(pattern)) is None:
            self.check()
            await asyncio.sleep(POLL_S / 5)
        return found[1]

    async def guard(self) -> None:
        """Supervise the processes until cancelled.

        Raises:
            ChildError: a process ended.
        """
        while True:
            self.check()
            await asyncio.sleep(POLL_S)
