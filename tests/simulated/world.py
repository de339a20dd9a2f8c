"""Simulated time: one heap of events for all processes, and one seed for all that is random."""

import asyncio
import gc
import hashlib
import heapq
import shutil
import sys
import tempfile
import warnings
from asyncio import events
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from types import TracebackType
from typing import Any, Final, TextIO

from executive.values.clock import START_UTC_S
from tests.simulated.network import Network
from tests.simulated.process import Incarnation, Process, Start
from tests.simulated.topics import Topics

_LINES_AT_ONCE: Final = 512
"""Lines that are hashed together."""
_COLLECT_EVERY: Final = 4096
"""Events between two collections of young garbage."""
_COLLECT_ALL_EVERY: Final = 1 << 20
_CANCELLED_CAP: Final = 4096
"""Cancelled timers that may be in the heap before it is looked whether they are most of it."""
_THREAD_DELAY_S: Final = 0.001
_LEAST_FREE_OCTETS: Final = 1 << 30
"""What must be free in memory for the folders to be there."""

Heap = list[tuple[float, int, "Incarnation | None", asyncio.AbstractEventLoop | None, Any]]


@dataclass(frozen=True, slots=True)
class WorldError:
    """Something that a process let go uncaught.

    Attributes:
        at_s: when.
        process: its name.
        text: what its loop says.
        fault: the exception, if there was one.
    """

    at_s: float
    process: str
    text: str
    fault: BaseException | None


class Act:
    """An event of the world itself, or of a thread without a loop; `asyncio.Handle` for short."""

    __slots__ = ("_args", "_callback", "_cancelled")

    def __init__(self, callback: Callable[..., object], args: tuple[Any, ...]) -> None:
        self._callback, self._args, self._cancelled = callback, args, False

    def cancel(self) -> None:
        """Do not do it; nothing if it was done."""
        self._cancelled = True

    def _run(self) -> None:
        self._callback(*self._args)


class World:
    """Time, the processes in it, and what happens next.

    Args:
        seed: of all that is random.
        folder: where the folders of processes are; None for a new one, in memory if there is room,
            which `close` removes.
        trace: takes a line for each event; None for none.

    Attributes:
        now_s: the time since the start.
        start_utc_s: seconds since 1970-01-01 UTC at the start.
        processes: by name.
        errors: what processes let go uncaught.
        before_event: called before each event of a process, with it and the name of the event; it
            may kill. None for nothing.
        network: between the processes.
        topics: of ROS, between the processes.
        running: the life of a process to which the present event belongs.
        count: how many events there were.
    """

    def __init__(
        self,
        seed: int | str,
        folder: Path | None = None,
        trace: TextIO | list[str] | None = None,
        start_utc_s: float = START_UTC_S,
    ) -> None:
        self.seed, self.start_utc_s = seed, start_utc_s
        self.now_s = 0.0
        self.processes: dict[str, Process] = {}
        self.errors: list[WorldError] = []
        self.before_event: Callable[[Process, str], None] | None = None
        self.running: Incarnation | None = None
        self.count = 0
        self._own_folder = folder is None
        self.folder = make_folder() if folder is None else folder
        self._trace = trace
        self._heap: Heap = []
        self._number = self._cancelled = self._tasks = 0
        self._randoms: dict[str, Random] = {}
        self._hash = hashlib.sha256()
        self._lines: list[str] = []
        self._past: list[Incarnation] = []
        self._stopped = False
        gc.freeze()  # what is older than the world need not be looked at at each collection
        self._threads = self.random("threads")
        self.network = Network(self)
        self.topics = Topics(self)

    def random(self, stream: str) -> Random:
        """Return a stream of random numbers of its own; the same one for the same name."""
        if stream not in self._randoms:
            self._randoms[stream] = Random(f"{self.seed}/{stream}")
        return self._randoms[stream]

    def process(self, name: str, host: str, start: Start) -> Process:
        """Add a process, which `Process.begin` starts.

        Args:
            name: of it, and of its folder.
            host: its own IP address.
            start: assembles it; is called as an event of its first loop, at each start.
        """
        if name in self.processes or any(host == each.host for each in self.processes.values()):
            raise ValueError(f"{name} at {host}: there is one already")
        process = self.processes[name] = self.network.hosts[host] = Process(self, name, host, start)
        return process

    def push(
        self,
        when_s: float,
        incarnation: Incarnation | None,
        loop: asyncio.AbstractEventLoop | None,
        handle: Any,
    ) -> None:
        """Put an event into the heap; events of the same time keep the order of being put there."""
        self._number += 1
        heapq.heappush(self._heap, (when_s, self._number, incarnation, loop, handle))

    def at(self, when_s: float, callback: Callable[..., object], *arguments: Any) -> Act:
        """Have the world itself do something, at a time that is not before the present one."""
        act = Act(callback, arguments)
        self.push(max(when_s, self.now_s), None, None, act)
        return act

    def after(self, delay_s: float, callback: Callable[..., object], *arguments: Any) -> Act:
        """Have the world itself do something some seconds from now."""
        return self.at(self.now_s + delay_s, callback, *arguments)

    def thread_delay_s(self) -> float:
        """Return how long it takes now until another thread is on."""
        return self._threads.random() * _THREAD_DELAY_S

    def next_task(self) -> int:
        """Return a number for a task, of all in this world."""
        self._tasks += 1
        return self._tasks

    def note(self, text: str) -> None:
        """Add a line to the digest and the trace, with the time."""
        self._lines.append(f"{self.now_s!r} {text}\n")
        if len(self._lines) >= _LINES_AT_ONCE:
            self._hash_lines()

    @property
    def digest(self) -> str:
        """Stands for all events until now."""
        self._hash_lines()
        return self._hash.hexdigest()

    def stop(self) -> None:
        """Have `run` return after the present event."""
        self._stopped = True

    def run(self, until_s: float) -> None:
        """Let everything happen until a time, or until `stop`."""
        if events._get_running_loop() is not None:
            raise RuntimeError("a world does not run within a loop")
        self._stopped = False
        collects, hooks = gc.isenabled(), sys.get_asyncgen_hooks()
        gc.disable()  # it would begin at another event in each run
        try:
            self._run(until_s)
        finally:
            events._set_running_loop(None)
            sys.set_asyncgen_hooks(*hooks)
            if collects:
                gc.enable()
        if not self._stopped:
            self.now_s = max(self.now_s, until_s)

    def _run(self, until_s: float) -> None:
        heap = self._heap
        hooked: asyncio.AbstractEventLoop | None = None
        active: asyncio.AbstractEventLoop | None = None
        while heap and heap[0][0] <= until_s and not self._stopped:
            when_s, _, incarnation, loop, handle = heapq.heappop(heap)
            if handle._cancelled:
                self._cancelled = max(0, self._cancelled - 1)
                continue
            if incarnation is not None:
                if not incarnation.alive:
                    continue
                if incarnation.process.paused:
                    incarnation.waiting.append((loop, handle))
                    continue
            self.now_s = when_s
            name = _name_of(handle._callback)
            if incarnation is not None and self.before_event is not None:
                self.before_event(incarnation.process, name)
                if not incarnation.alive:
                    continue
                if incarnation.process.paused:
                    incarnation.waiting.append((loop, handle))
                    continue
            self.count += 1
            self.note(f"- {name}" if incarnation is None else f"{incarnation.process.name} {name}")
            if loop is not None and loop is not hooked:
                hooked = loop
                sys.set_asyncgen_hooks(
                    firstiter=loop._asyncgen_firstiter_hook,  # type: ignore[attr-defined]
                    finalizer=loop._asyncgen_finalizer_hook,  # type: ignore[attr-defined]
                )
            self.running = incarnation
            if loop is not active:
                active = loop
                events._set_running_loop(loop)
            try:
                handle._run()
            except SystemExit as end:
                if incarnation is None:
                    raise
                incarnation.ended_by(end)
            finally:
                self.running = None
            if self.count % _COLLECT_EVERY == 0:
                gc.collect(2 if self.count % _COLLECT_ALL_EVERY == 0 else 1)

    def timer_cancelled(self) -> None:
        """Know that a timer in the heap was cancelled; many of them are thrown out."""
        self._cancelled += 1
        if self._cancelled > _CANCELLED_CAP and 2 * self._cancelled > len(self._heap):
            self._heap[:] = [event for event in self._heap if not event[4]._cancelled]
            heapq.heapify(self._heap)
            self._cancelled = 0

    def fault(self, process: str, text: str, fault: BaseException | None) -> None:
        """Record what a process let go uncaught."""
        self.errors.append(WorldError(self.now_s, process, text, fault))
        self.note(f"{process} ! {text}")

    def bury(self, incarnation: Incarnation) -> None:
        """Keep what a dead process holds until the end: its coroutines would go on when freed."""
        self._past.append(incarnation)

    def close(self) -> None:
        """End everything, and remove the folders if they were made here."""
        for process in self.processes.values():
            process.vanish()
        hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
        try:  # what the dead still raise, or begin and do not await, concerns nobody
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                for incarnation in self._past:
                    incarnation.free()
                self._past.clear()
                self._heap.clear()
                gc.collect()
        finally:
            sys.unraisablehook = hook
            gc.unfreeze()
        if self._own_folder:
            shutil.rmtree(self.folder, ignore_errors=True)

    def __enter__(self) -> "World":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        fault: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _hash_lines(self) -> None:
        lines = "".join(self._lines)
        self._hash.update(lines.encode())
        if isinstance(self._trace, list):
            self._trace.extend(self._lines)
        elif self._trace is not None:
            self._trace.write(lines)
        self._lines.clear()


def make_folder() -> Path:
    """Return a new folder, in memory if there is room."""
    memory = Path("/dev/shm")
    there = memory.is_dir() and shutil.disk_usage(memory).free >= _LEAST_FREE_OCTETS
    return Path(tempfile.mkdtemp(prefix="world-", dir=memory if there else None))


def _name_of(callback: Any) -> str:
    """Return the name of a callback; for the step of a task, that of its coroutine."""
    owner = getattr(callback, "__self__", None)
    if isinstance(owner, asyncio.Task):
        return getattr(owner.get_coro(), "__qualname__", "task")
    while (inner := getattr(callback, "func", None)) is not None:
        callback = inner
    name = getattr(callback, "__qualname__", None)
    return name if isinstance(name, str) else type(callback).__qualname__
