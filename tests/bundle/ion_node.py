"""What ION does behind the model of pyion: nodes that reach one another at once."""

import asyncio
import base64
import ctypes
import json
import os
import sys
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing, suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, Final

PYION_MODEL: Final = Path(__file__).with_name("pyion_model")
MODEL: Final = "MODEL_ION"
DTN_NOW_MS: Final = 848_000_000_000

_LIBC: Final = ctypes.CDLL(None, use_errno=True)
_CREATE, _REMOVE = 0o1600, 0
_keys = count(0x52000000 + (os.getpid() << 8) % 0x1000000)

Answer = dict[str, Any]
IO_ERROR: Final[Answer] = {"error": "io"}


@dataclass
class Faults:
    """What goes wrong, until it is set back or so many times.

    Attributes:
        stopped: there is no ION.
        locked: its database is locked: nothing is ever answered.
        full: there is no room for what is sent.
        refused, repeats: how often it refuses; how often a bundle comes beside the first time.
    """

    stopped: bool = False
    locked: bool = False
    full: bool = False
    refused: int = 0
    repeats: int = 0


@dataclass
class Handle:
    """An endpoint that some process has opened; only the first to do so can receive."""

    eid: str
    pid: int
    first: bool
    memory: int
    interrupted: bool = False


@dataclass
class IonNodes:
    """All nodes of a test."""

    faults: dict[int, Faults] = field(default_factory=dict)
    waiting: dict[str, deque[Answer]] = field(default_factory=dict)
    handles: dict[int, Handle] = field(default_factory=dict)
    lifetimes_s: list[int] = field(default_factory=list)
    folders: set[str] = field(default_factory=set)
    memory: dict[int, int] = field(default_factory=dict)
    lost: list[bytes] = field(default_factory=list)
    closed: list[str] = field(default_factory=list)
    count: int = 0
    changed: asyncio.Condition = field(default_factory=asyncio.Condition)
    serving: dict[asyncio.Task[None], asyncio.StreamWriter] = field(default_factory=dict)

    def bring(self, source: str, to: str, payload: bytes) -> None:
        """Have a bundle arrive."""
        self.count += 1
        bundle = {
            "source": source,
            "count": self.count,
            "msec": DTN_NOW_MS,
            "data": base64.b64encode(payload).decode(),
        }
        queue = self.waiting.setdefault(to, deque())
        queue.extend(bundle for _ in range(1 + self.faults[_node(to)].repeats))

    def make_memory(self, node: int) -> None:
        """Make the shared memory of a node: a real segment, as ION does."""
        self.memory[node] = _LIBC.shmget(next(_keys), 4096, _CREATE)
        assert self.memory[node] >= 0, os.strerror(ctypes.get_errno())

    def remove_memory(self, node: int) -> None:
        """Remove it; a process that is attached stays so."""
        _LIBC.shmctl(self.memory.pop(node), _REMOVE, None)

    async def restart(self, node: int, fresh: bool) -> None:
        """End a node and start it: who is attached hears nothing; what waits stays or not."""
        async with self.changed:
            self.remove_memory(node)
            if fresh:
                for eid in [eid for eid in self.waiting if _node(eid) == node]:
                    del self.waiting[eid]
            self.make_memory(node)
            self.changed.notify_all()

    async def change(self, node: int, **faults: bool | int) -> None:
        """Have something go wrong, or right again."""
        async with self.changed:
            for name, value in faults.items():
                setattr(self.faults[node], name, value)
            self.changed.notify_all()

    def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take a connection."""
        self.serving[asyncio.create_task(self._serve(reader, writer))] = writer

    async def end(self) -> None:
        """Hang up on who still waits for an answer."""
        for each in self.serving:
            each.cancel()
        await asyncio.gather(*self.serving, return_exceptions=True)
        for writer in self.serving.values():
            writer.close()  # a task that was cancelled before its first step has not

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer one question, unless who asked has died."""
        with closing(writer):
            question = json.loads(await reader.readline())
            self.folders.add(question["folder"])
            closed = asyncio.ensure_future(reader.read())
            answering = asyncio.ensure_future(self._answer(question))
            await asyncio.wait((closed, answering), return_when=asyncio.FIRST_COMPLETED)
            if answering.done():
                writer.write(json.dumps(answering.result()).encode() + b"\n")
            answering.cancel()
            closed.cancel()
            with suppress(OSError):
                await writer.drain()

    async def _answer(self, question: Answer) -> Answer:
        faults = self.faults[question["node"]]
        if faults.stopped:
            return {"error": "no ION"}
        async with self.changed:
            await self.changed.wait_for(lambda: not faults.locked)
            match question["op"]:
                case "attach":
                    return {"memory": self.memory[question["node"]]}
                case "open":
                    return self.open_endpoint(question["eid"], question["pid"])
                case "receive":
                    return await self._receive(self.handles[question["handle"]])
                case "interrupt":
                    self.handles[question["handle"]].interrupted = True
                case "close":
                    self.closed.append(self.handles.pop(question["handle"]).eid)
                case "send":
                    return await self._send(question, faults)
                case _:
                    pass
            self.changed.notify_all()
            return {}

    def open_endpoint(self, eid: str, pid: int) -> Answer:
        node, service = eid.removeprefix("ipn:").split(".")
        if int(node) not in self.faults or int(service) > 2:
            return {"error": "undefined"}
        memory = self.memory[int(node)]
        first = not any(
            other.eid == eid
            and other.pid != pid
            and other.memory == memory
            and _is_running(other.pid)
            for other in self.handles.values()
        )
        self.count += 1
        self.handles[self.count] = Handle(eid, pid, first, memory)
        return {"handle": self.count}

    async def _receive(self, handle: Handle) -> Answer:
        if not handle.first:
            return IO_ERROR
        await self.changed.wait_for(
            lambda: (
                handle.interrupted or (self.waiting.get(handle.eid) and self._is_current(handle))
            )
        )
        if handle.interrupted:
            handle.interrupted = False
            return {"error": "interrupted"}
        return self.waiting[handle.eid].popleft()

    def _is_current(self, handle: Handle) -> bool:
        """Return whether an endpoint was opened in the memory that its node has now."""
        return self.memory.get(_node(handle.eid)) == handle.memory

    async def _send(self, question: Answer, faults: Faults) -> Answer:
        if faults.full and not question["waits"]:
            return {"error": "full"}
        handle = question["handle"]
        await self.changed.wait_for(lambda: not faults.full or handle not in self.handles)
        if handle not in self.handles:
            return {"error": "full"}
        if faults.refused:
            faults.refused -= 1
            return {"error": "send"}
        if not self._is_current(self.handles[handle]):
            self.lost.append(base64.b64decode(question["data"]))
            return {}
        self.lifetimes_s.append(question["ttl"])
        self.bring(question["source"], question["to"], base64.b64decode(question["data"]))
        self.changed.notify_all()
        return {}


def _node(eid: str) -> int:
    return int(eid.removeprefix("ipn:").split(".")[0])


def _is_running(pid: int) -> bool:
    with suppress(OSError):
        os.kill(pid, 0)
        return True
    return False


@asynccontextmanager
async def ion_nodes(folder: Path, *numbers: int) -> AsyncIterator[IonNodes]:
    """Have nodes of ION for the time of a with; bridges started meanwhile find them."""
    nodes = IonNodes({number: Faults() for number in numbers})
    for number in numbers:
        nodes.make_memory(number)
    path = folder / "ion.socket"
    server = await asyncio.start_unix_server(nodes.serve, path, limit=1 << 24)
    before = {name: os.environ.get(name) for name in (MODEL, "PYTHONPATH")}
    os.environ[MODEL] = str(path)
    os.environ["PYTHONPATH"] = str(PYION_MODEL)
    try:
        yield nodes
    finally:
        server.close()
        await nodes.end()
        for number in list(nodes.memory):
            nodes.remove_memory(number)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def bpadmin(folder: Path, node: int) -> None:
    """Write a bpadmin that asks a node of the test, and waits as ION's does."""
    program = folder / "bpadmin"
    program.write_text(
        f"#!{sys.executable}\n"
        "import sys\n"
        f"sys.path.insert(0, {str(PYION_MODEL / 'pyion')!r})\n"
        "import model\n"
        "sys.stdin.read()\n"
        f"answer = model.request(op='ask', node={node})\n"
        "print(': ION database not found.' if 'error' in answer else"
        f" ': ipn:{node}.1  -1\\trule: q')\n"
    )
    program.chmod(0o755)
