"""All that read recordings, each as its user calls it: command lines, tables, the console."""

import asyncio
import ctypes
import logging
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from types import FrameType
from typing import Final

import click
from click.testing import CliRunner

from adapters.cli.bag import bag
from adapters.cli.log import log
from adapters.cli.watch import watch
from adapters.cli.why import why
from adapters.console.recordings import Recordings
from adapters.console.web import json_response
from adapters.recording import RecordingError, complete, frames
from adapters.recording.commands import replay
from adapters.system import OPERATING_SYSTEM
from sim.calibration.commands import calibrate
from sim.fork.commands import whatif
from sim.plot.commands import plot

MAX_CPU_S: Final = 5.0
MAX_MB: Final = 150.0
"""The simulation of a fork takes up to 114 MB; measured with 800 wrong recordings."""
PATIENCE: Final = 4.0
"""Times `MAX_CPU_S` after which a reader is interrupted."""
REFUSED: Final = 2


@unique
class ReaderFault(Enum):
    """What no reader may show."""

    RAISED = "readers that raised something else than RecordingError"
    SLOW = f"readers that took more than {MAX_CPU_S:g} s of CPU"
    LARGE = f"readers that took more than {MAX_MB:g} MB"


class TooLongError(BaseException):
    """A reader was interrupted; no reader may contain it."""


@dataclass(frozen=True, slots=True)
class Taken:
    """How a reader took a recording.

    Attributes:
        read: whether it read it, at least up to its damage.
        error: what was raised, or what it says; empty if nothing.
    """

    read: bool
    raised: bool
    error: str
    cpu_s: float
    grown_mb: float


Reader = Callable[[Path, Path], str]
"""Reads a recording into an empty folder; returns what is wrong with it, or raises."""


def _command(command: click.Command, *arguments: str) -> Reader:
    def read(path: Path, folder: Path) -> str:
        given = [each.format(path=path, folder=folder) for each in arguments]
        result = CliRunner().invoke(command, given, catch_exceptions=False)
        if result.exit_code not in {0, 1, 2}:
            raise AssertionError(f"exit status {result.exit_code}: {result.output[-300:]}")
        return result.output if result.exit_code == REFUSED else ""

    return read


def _tables(path: Path, _: Path) -> str:
    frames(path)
    return ""


def _completed(path: Path, folder: Path) -> str:
    torn = folder / "torn.mcap"
    torn.write_bytes(path.read_bytes()[:-1])
    complete(torn)
    return ""


def _console(path: Path, folder: Path) -> str:
    async def poll() -> None:
        recordings = Recordings(folder, lambda _: None, OPERATING_SYSTEM.utc_s)
        try:
            json_response((await recordings.open(path)).entry)
        finally:
            await recordings.close()

    asyncio.run(poll())
    return ""


READERS: Final[dict[str, Reader]] = {
    "replay": _command(replay, "{path}"),
    "replay --with": _command(replay, "{path}", "--with", "jackal"),
    "why": _command(why, "--file", "{path}"),
    "why COMMAND": _command(why, "MOE:1", "--file", "{path}"),
    "log": _command(log, "--file", "{path}", "--unfold"),
    "watch": _command(watch, "--file", "{path}", "--at", "1.0"),
    "watch --html": _command(watch, "--file", "{path}", "--html", "{folder}/page.html"),
    "calibrate": _command(calibrate, "{path}"),
    "frames": _tables,
    "complete": _completed,
    "console": _console,
    "plot": _command(plot, "{path}", "--out", "{folder}/plot.svg"),
    "whatif": _command(whatif, "{path}"),
    "bag": _command(bag, "{path}", "{folder}/bag"),
}


class Meter:
    """Measures what a reader takes: CPU time, and memory beyond that when the meter was made."""

    def __init__(self) -> None:
        self._begin_mb = self._resident_mb("VmRSS")

    def take(self, reader: Reader, path: Path, folder: Path) -> Taken:
        """Have a recording read; nothing that is raised gets out."""
        ctypes.CDLL(None).malloc_trim(0)  # of glibc: what was freed before does not count
        Path("/proc/self/clear_refs").write_text("5")  # the peak is counted from here
        began_s, read, raised, error = time.process_time(), True, False, ""
        try:
            with _interrupted(PATIENCE * MAX_CPU_S):
                error = reader(path, folder)
                read = not error
        except RecordingError as reported:
            read, error = False, str(reported)
        except (Exception, TooLongError) as other:
            # Whatever it is, it is what this looks for.
            read, raised, error = False, True, f"{type(other).__name__}: {other}"
            logging.getLogger(__name__).debug(error, exc_info=True)
        cpu_s = time.process_time() - began_s
        return Taken(read, raised, error, cpu_s, self._resident_mb("VmHWM") - self._begin_mb)

    @staticmethod
    def _resident_mb(name: str) -> float:
        lines = Path("/proc/self/status").read_text().splitlines()
        (line,) = (each for each in lines if each.startswith(f"{name}:"))
        return int(line.split()[1]) / 1000


@contextmanager
def _interrupted(cpu_s: float) -> Iterator[None]:
    """Raise TooLongError after so much CPU time."""

    def interrupt(_: int, __: FrameType | None) -> None:
        raise TooLongError(f"not done after {cpu_s:g} s of CPU")

    before = signal.signal(signal.SIGPROF, interrupt)
    signal.setitimer(signal.ITIMER_PROF, cpu_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
