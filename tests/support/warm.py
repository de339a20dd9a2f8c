"""Processes of ours without their imports: forked from one that has made them, a second each.

What starts as users start it is in `tests/demo` and `tests/docs`; here, the process is the same
from its command line on.
"""

import atexit
import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Final

from sim.processes import children
from sim.processes.children import ChildProcess

_FORKING: Final = multiprocessing.get_context("forkserver")
_FORKING.set_forkserver_preload(["tests.support.warm_imports"])


@cache
def _scripts() -> dict[str, str]:
    """Return the function of each console script, as module:function."""
    return {each.name: each.value for each in entry_points(group="console_scripts")}


class WarmProcess:
    """A forked process with the methods of `subprocess.Popen` that tests need.

    Args:
        entry, command: as `entry_of` returns them.
        environment: in place of that of this process.
        typed: the file that it reads as its input.
    """

    def __init__(
        self,
        entry: str,
        command: Sequence[str],
        log: Path,
        cwd: Path | None,
        environment: Mapping[str, str] | None = None,
        typed: Path = Path(os.devnull),
    ) -> None:
        environment = {**(environment or os.environ), "PYTHONUNBUFFERED": "1"}
        arguments = (entry, list(command), typed, log, cwd or Path.cwd(), environment)
        self._process = _FORKING.Process(target=_run, args=arguments)
        self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        status = self._process.exitcode
        if status is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout or 0.0)
        return status

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


def start_child(child: ChildProcess) -> WarmProcess:
    """Do what `ChildProcess._start` does; the process is the first of a group of its own."""
    child._log_start = child.log.stat().st_size
    entry = entry_of(child._command)
    assert entry is not None
    return WarmProcess(*entry, child.log, None, child._environment)


def entry_of(command: Sequence[str]) -> tuple[str, Sequence[str]] | None:
    """Return the entry of a command line, and its arguments from its name on.

    None if it has none, or may import other packages than those that were imported here.

    Args:
        command: begins with a script beside this Python, `python -m` and a module, or
            module:function.
    """
    program, *arguments = command
    if ":" in program:
        return program, command
    if not {*os.environ.get("PYTHONPATH", "").split(os.pathsep)} - {""} <= {*sys.path}:
        return None
    if program == sys.executable and "-m" in arguments[:2]:
        started = arguments[arguments.index("-m") + 1 :]
        return started[0], started
    path = Path(program)
    entry = _scripts().get(path.name) if path.parent == Path(sys.executable).parent else None
    return None if entry is None else (entry, command)


def _run(
    entry: str, command: list[str], typed: Path, log: Path, cwd: Path, environment: dict[str, str]
) -> None:
    """Become the process of a command line, in the forked process."""
    for descriptor, name, mode in ((0, str(typed), os.O_RDONLY), (1, str(log), os.O_WRONLY)):
        opened = os.open(name, mode | os.O_APPEND)
        os.dup2(opened, descriptor)
        os.close(opened)
    os.dup2(1, 2)
    os.setpgid(0, 0)
    children._PRCTL(children._PR_SET_PDEATHSIG, signal.SIGTERM)  # the server ends with the tests
    sys.stdin = os.fdopen(0, closefd=False)
    sys.stdout, sys.stderr = (os.fdopen(fd, "w", buffering=1, closefd=False) for fd in (1, 2))
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = command
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        module, _, name = entry.partition(":")
        if name:
            sys.exit(getattr(import_module(module), name)())
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    finally:
        atexit._run_exitfuncs()
