import os
import subprocess
import sys
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import psutil
import pytest

from tests.support.stalls import StallWatch

ROVER: Final = Path(sys.executable).with_name("rover")
LIMIT_S: Final = 240
MARK: Final = "ROVER_DEMO_TEST"


@dataclass(frozen=True, slots=True)
class Ran:
    """A demonstration that has ended.

    Attributes:
        left: the command lines of its processes that still run.
    """

    status: int
    output: str
    folder: Path
    left: list[str]


class Demo:
    """A demonstration that runs, told from others by a mark in its environment."""

    def __init__(self, folder: Path, config: Path, *arguments: str) -> None:
        self.folder = folder
        self._output = ""
        self._mark = uuid.uuid4().hex
        self.process = subprocess.Popen(
            [ROVER, "demo", "--out", folder, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={
                **os.environ,
                MARK: self._mark,
                "ROVER_CONFIG": str(config),
                "ROVER_INSTALLED": "",
            },
        )

    def wait_for(self, labels: str) -> str:
        """Read until these words were said, and return all that was."""
        assert self.process.stdout is not None
        while labels not in self._output:
            line = self.process.stdout.readline()
            assert line, f"{labels!r} was never said:\n{self._output}"
            self._output += line
        return self._output

    def end(self) -> tuple[int, str]:
        """Wait for the end and return the exit status and the rest of the output."""
        output, _ = self.process.communicate(timeout=LIMIT_S)
        return self.process.returncode, output

    def ran(self) -> Ran:
        """Wait for the end and return what is left."""
        status, output = self.end()
        return Ran(status, output, self.folder, [" ".join(p.cmdline()) for p in self.others()])

    def others(self) -> list[psutil.Process]:
        """Return its processes but the first."""
        found: list[psutil.Process] = []
        for process in psutil.process_iter():
            try:
                if process.pid != self.process.pid and process.environ().get(MARK) == self._mark:
                    found.append(process)
            except (psutil.NoSuchProcess, psutil.AccessDenied):
                continue
        return found

    def child(self, module: str) -> psutil.Process:
        """Return the process that runs a module, not the one that it has beside itself."""
        found = [process for process in self.others() if module in process.cmdline()]
        (first,) = [process for process in found if process.parent() not in found]
        return first

    def clean_up(self) -> None:
        for process in self.others():
            process.kill()
        self.process.kill()
        self.process.communicate()


@dataclass(frozen=True, slots=True)
class Played:
    """The demonstrations of one rover."""

    jackal: Ran
    mocup: Ran
    relay: Ran


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory, patient: Path) -> Played:
    """Give them as they ended. Each is played alone: they are timed, and two cores are few."""
    folder = tmp_path_factory.mktemp("demo")

    def once(name: str, *arguments: str) -> Ran:
        demo = Demo(folder / name, patient, *arguments)
        try:
            return demo.ran()
        finally:
            demo.clean_up()

    def play(name: str, *arguments: str) -> Ran:
        with StallWatch() as watch:
            ran = once(name, *arguments)
        return once(f"{name}-again", *arguments) if ran.status and watch.stalled else ran

    return Played(
        play("jackal", "--speed", "1.5"),
        play("mocup", "--mocup", "--speed", "1.5", "--no-console"),
        play("relay", "--relay", "--no-console"),
    )
