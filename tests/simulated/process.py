"""A simulated process: its folder, its clock, and how it ends and begins again."""

import asyncio
import shutil
import signal
import sqlite3
from asyncio import events
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from tests.simulated.disk import Disk, SimConnection
from tests.simulated.loop import SimLoop

if TYPE_CHECKING:
    from tests.simulated.world import World


class Killed(SystemExit):
    """Ends what a process does at the moment when it is killed; asyncio lets a SystemExit pass."""


class Resource(Protocol):
    """What the operating system takes back from a process that ends: sockets, topics."""

    def drop(self, *, silent: bool) -> None:
        """Take it back; `silent` if nobody is told, because the computer is off."""
        ...


class Incarnation:
    """A process from one start to its end.

    Attributes:
        process: whose.
        number: 1 for its first.
        alive: whether it goes on. What is not alive reaches nothing.
        status: of its end, as a shell has it; None while it is alive.
        loops: its event loops, the first of its main thread.
        waiting: events that came while it was stopped.
        resources: what is taken back at its end.
        databases: its open files of SQLite.
        stored: tasks and generators that must not be freed.
        main: its main program, if it was begun by `Process.run`.
    """

    def __init__(self, process: "Process", number: int) -> None:
        self.process, self.number = process, number
        self.world = process.world
        self.alive = True
        self.status: int | None = None
        self.loops: list[SimLoop] = []
        self.waiting: deque[tuple[asyncio.AbstractEventLoop | None, Any]] = deque()
        self.resources: list[Resource] = []
        self.databases: list[SimConnection] = []
        self.stored: list[list[Any]] = []
        self.main: asyncio.Task[None] | None = None

    def new_loop(self) -> SimLoop:
        """Return a loop for another thread of it."""
        loop = SimLoop(self)
        self.loops.append(loop)
        return loop

    def push(self, delay_s: float, loop: asyncio.AbstractEventLoop | None, handle: Any) -> None:
        """Have it do something, unless it is dead."""
        if self.alive:
            world = self.world
            world.push(world.now_s + delay_s, self, loop, handle)

    def require(self) -> None:
        """Go no further if it is dead.

        Raises:
            Killed: it is.
        """
        if not self.alive:
            raise Killed(self.status)

    def end(self, status: int, *, silent: bool = False, power_lost: bool = False) -> None:
        """End it; what it has on the disk at this moment is what the next life finds."""
        if not self.alive:
            return
        process = self.process
        process.save(power_lost=power_lost)
        self.alive, self.status = False, status
        self.world.note(f"{process.name} ends with {status}")
        for resource in self.resources:
            resource.drop(silent=silent)
        self.resources.clear()
        self.waiting.clear()
        for loop in self.loops:
            self.stored.append(loop.unfinished())
        self.world.bury(self)
        if process.on_end is not None:
            process.on_end(process, status)

    def ended_by(self, end: SystemExit) -> None:
        """Know that an event of it raised SystemExit."""
        code = end.code
        if isinstance(end, Killed):
            return
        self.end(code if isinstance(code, int) else int(code is not None))

    def close_databases(self) -> None:
        """Close its files, after its end, before another life has files of the same names."""
        for database in self.databases:
            with suppress(sqlite3.Error):
                sqlite3.Connection.close(database)
        self.databases.clear()

    def free(self) -> None:
        """Close its coroutines; what they still do reaches nothing."""
        self.close_databases()
        for loop in self.loops:
            events._set_running_loop(loop)
            try:
                loop.free()
            finally:
                events._set_running_loop(None)
        self.stored.clear()


Start = Callable[["Process"], None]


class Process:
    """A program on a computer of its own, which can be killed, stopped and started again.

    Attributes:
        world: in which it is.
        name: of it.
        host: the IP address of its computer.
        folder: of its data. A start finds what the last end left.
        incarnation: the present or last one; None before the first.
        paused: whether it is stopped (SIGSTOP).
        powered: whether its computer answers others.
        stepped: whether its clock was ever set.
        disk: that of its computer.
        start_fault: what its last start raised; it ended with status 1 then.
        on_end: is told of each end, with the status; to be set by a supervisor.
    """

    def __init__(self, world: "World", name: str, host: str, start: Start) -> None:
        self.world, self.name, self.host = world, name, host
        self.folder = world.folder / name
        self.folder.mkdir()
        self.incarnation: Incarnation | None = None
        self.paused = False
        self.powered = True
        self.stepped = False
        self.on_end: Callable[[Process, int], None] | None = None
        self.start_fault: Exception | None = None
        self.disk = Disk(self)
        self._start = start
        self._saved = world.folder / f"{name}.saved"
        self._starts = 0
        self._offset_s = self._drift = self._drifts_since_s = 0.0

    @property
    def alive(self) -> bool:
        """Whether it runs, be it stopped."""
        return self.incarnation is not None and self.incarnation.alive

    @property
    def status(self) -> int | None:
        """The status of its last end; None while it runs, and before its first start."""
        return None if self.incarnation is None else self.incarnation.status

    @property
    def present(self) -> Incarnation:
        """Its life, the last one if it is dead."""
        if self.incarnation is None:
            raise RuntimeError(f"{self.name} was never started")
        return self.incarnation

    @property
    def loop(self) -> SimLoop:
        """The loop of its main thread."""
        return self.present.loops[0]

    def begin(self) -> Incarnation:
        """Start it, with what is in its folder.

        Raises:
            RuntimeError: it runs.
        """
        if self.alive:
            raise RuntimeError(f"{self.name} runs")
        last = self.incarnation
        self._starts += 1
        self.paused, self.powered = False, True
        incarnation = self.incarnation = Incarnation(self, self._starts)
        self.world.note(f"{self.name} starts")
        incarnation.push(0.0, incarnation.new_loop(), _Start(self, incarnation, last))
        return incarnation

    restart = begin

    def run(self, main: Coroutine[Any, Any, object]) -> None:
        """Run a coroutine as its main program: it ends when that does, with 1 if it raises."""
        incarnation = self.present
        incarnation.main = incarnation.loops[0].create_task(self._run(incarnation, main))

    def kill(self, *, silent: bool = False) -> None:
        """Kill it (SIGKILL); nothing if it is dead.

        Args:
            silent: whether its peers are not told, as if its computer were cut off: connections
                stay half open until it is started again.

        Raises:
            Killed: the present event is one of its own.
        """
        self._end(137, silent=silent, power_lost=False)

    def cut_power(self) -> None:
        """Have its computer lose power: what was not synced is lost as well; raises as `kill`."""
        self._end(137, silent=True, power_lost=True)

    def exit(self, status: int = 0) -> None:
        """End it by itself.

        Raises:
            Killed: the present event is one of its own.
        """
        self._end(status, silent=False, power_lost=False)

    def terminate(self, number: signal.Signals = signal.SIGTERM) -> None:
        """Send it a signal, which ends it unless a loop of it has a handler."""
        if self.alive and not any(loop.signalled(number) for loop in self.present.loops):
            self._end(128 + number, silent=False, power_lost=False)

    def pause(self) -> None:
        """Stop it (SIGSTOP): its events wait; its operating system goes on."""
        if self.alive:
            self.paused = True
            self.world.note(f"{self.name} pauses")

    def resume(self) -> None:
        """Let it go on (SIGCONT): what waited comes first, in its order."""
        if not self.paused:
            return
        self.paused = False
        self.world.note(f"{self.name} resumes")
        incarnation = self.present
        for loop, handle in incarnation.waiting:
            incarnation.push(0.0, loop, handle)
        incarnation.waiting.clear()

    def utc_s(self) -> float:
        """Return what its clock says, in seconds since 1970-01-01 UTC."""
        now_s = self.world.now_s
        drifted_s = self._drift * (now_s - self._drifts_since_s)
        return self.world.start_utc_s + now_s + self._offset_s + drifted_s

    def step_clock(self, step_s: float) -> None:
        """Have its UTC step; what is monotonic does not."""
        self._offset_s += step_s
        self.stepped = True

    def set_drift(self, drift: float) -> None:
        """Have its UTC run faster by a part (1e-6: a microsecond a second)."""
        now_s = self.world.now_s
        self._offset_s += self._drift * (now_s - self._drifts_since_s)
        self._drift, self._drifts_since_s = drift, now_s

    def save(self, *, power_lost: bool) -> None:
        """Copy its folder for the next life, as it is on the disk now."""
        shutil.rmtree(self._saved, ignore_errors=True)
        shutil.copytree(self.folder, self._saved, ignore=shutil.ignore_patterns("*-shm"))
        if power_lost:
            self.disk.lose_unsynced(self._saved)

    def take_saved(self) -> None:
        """Have what the last end left in the place of its folder."""
        if self._saved.exists():
            shutil.rmtree(self.folder)
            self._saved.rename(self.folder)

    @property
    def stored(self) -> Path:
        """Where that lies which is on its disk, for judges: elsewhere while it is dead."""
        return self._saved if self._saved.exists() else self.folder

    def vanish(self) -> None:
        """End it with the world: without a copy, without a word."""
        incarnation = self.incarnation
        if incarnation is not None and incarnation.alive:
            incarnation.alive, incarnation.status = False, 137
            for loop in incarnation.loops:
                incarnation.stored.append(loop.unfinished())
            self.world.bury(incarnation)

    def _end(self, status: int, *, silent: bool, power_lost: bool) -> None:
        incarnation = self.incarnation
        if incarnation is None or not incarnation.alive:
            return
        self.paused = False
        if silent:
            self.powered = False
        incarnation.end(status, silent=silent, power_lost=power_lost)
        if self.world.running is incarnation:
            raise Killed(status)

    async def _run(self, incarnation: Incarnation, main: Coroutine[Any, Any, object]) -> None:
        try:
            await main
        except Exception as fault:
            if incarnation.alive:
                self.world.fault(self.name, "the process ends", fault)
                incarnation.end(1)
        else:
            incarnation.end(0)
        incarnation.require()


class _Start:
    """The event that starts a process."""

    _cancelled = False

    def __init__(
        self, process: Process, incarnation: Incarnation, last: Incarnation | None
    ) -> None:
        self._process, self._incarnation, self._last = process, incarnation, last
        self._callback = process._start

    def _run(self) -> None:
        if self._last is not None:
            self._last.close_databases()
            self._process.take_saved()
        try:
            self._callback(self._process)
        except Exception as fault:
            self._process.world.note(f"{self._process.name} ! does not start: {fault!r}")
            self._process.start_fault = fault
            self._incarnation.end(1)
