"""Processes of ours, run by tests as users run them, each with a log."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.support.warm import WarmProcess, entry_of

LIMIT_S = 90.0
LISTENS = r"listens at (maltcp://\S+)"


class Running:
    """One process; what it says on either output is in its log, what it reads in a file."""

    def __init__(
        self, log: Path, *command: str, cwd: Path | None = None, typed: Path = Path(os.devnull)
    ) -> None:
        self.log = log
        log.write_text("", encoding="utf-8")
        if (entry := entry_of(command)) is not None:
            self._process: WarmProcess | subprocess.Popen[bytes] = WarmProcess(
                *entry, log, cwd, typed=typed
            )
            return
        with log.open("a", encoding="utf-8") as output, typed.open("rb") as keyboard:
            self._process = subprocess.Popen(
                command,
                cwd=cwd,
                stdin=keyboard,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def is_running(self) -> bool:
        return self._process.poll() is None

    @property
    def text(self) -> str:
        return self.log.read_text(encoding="utf-8")

    def output(self, pattern: str) -> str:
        """Wait until it has said something; return the first group."""
        deadline_s = time.monotonic() + LIMIT_S
        while (found := re.search(pattern, self.text)) is None:
            assert self._process.poll() is None, f"it ended:\n{self.text}"
            assert time.monotonic() < deadline_s, f"it never said {pattern}:\n{self.text}"
            time.sleep(0.02)
        return found[1] if found.groups() else found[0]

    def ended(self) -> int:
        """Wait for its end; return the exit status."""
        return self._process.wait(LIMIT_S)

    def send(self, number: int) -> None:
        self._process.send_signal(number)

    def end(self, number: int = signal.SIGTERM) -> int:
        """Send a signal, wait for the end, and return the exit status."""
        self.send(number)
        return self.ended()

    def clean_up(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()


def run_to_end(
    *command: str | Path, cwd: Path | None = None, timeout_s: float = LIMIT_S, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a command, with more in its environment; return how it ended and what it said."""
    return subprocess.run(
        command,
        cwd=cwd,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


@contextmanager
def running(log: Path, *command: str) -> Iterator[Running]:
    """Run a console script of ours for the time of the with."""
    script, *arguments = command
    process = Running(log, str(Path(sys.executable).with_name(script)), *arguments)
    try:
        yield process
    finally:
        process.clean_up()


@contextmanager
def simulation(folder: Path, *arguments: str) -> Iterator[Running]:
    """Run rover-sim on flat ground, ready to be driven."""
    log = folder / f"sim-{time.monotonic_ns()}.log"
    with running(log, "rover-sim", "--world", "flat", *arguments) as process:
        process.output("stands in world")
        yield process


@contextmanager
def executive(folder: Path, *arguments: str) -> Iterator[tuple[Running, str]]:
    """Run rover-executive on the files in a folder; give it with the address of its link."""
    log = folder / f"executive-{time.monotonic_ns()}.log"
    options = ("--port", "0", "--data", str(folder / "data"))
    with running(log, "rover-executive", *options, *arguments) as process:
        yield process, process.output(LISTENS)
