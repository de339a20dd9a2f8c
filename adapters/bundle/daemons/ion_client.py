"""Attached to NASA ION: speaks to the bridge, watches over it, and starts it again."""

import asyncio
import logging
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from math import ceil
from pathlib import Path
from shutil import which
from typing import Final, assert_never

from adapters.bundle.codec.bundle import Creation
from adapters.bundle.codec.eid import Eid, parse_eid
from adapters.bundle.codec.errors import BundleError, DecodeError
from adapters.bundle.daemons.ion_frames import (
    Failed,
    Frame,
    FrameReader,
    Ping,
    Pong,
    Ready,
    Received,
    Refused,
    Send,
    Sent,
    Taken,
    encode_frame,
)
from adapters.bundle.daemons.link import (
    Inbound,
    OnInbound,
    OnResult,
    Outbound,
)
from adapters.bundle.links.link import Backoff
from adapters.bundle.node.settings import IonSettings

_ROOT = Path(__file__).resolve().parents[3]


class BridgeProcess:
    """A bridge, in a session of its own, so that no signal to a terminal or a group finds it.

    It is never killed: SIGKILL within ION can leave the database of the node locked.

    Args:
        settings: the interpreter that has pyion, and more.
        own: the endpoint.
        spool: the file of what ION has forgotten and the agent has not yet.

    Attributes:
        socket: our end of the socket between.

    Raises:
        OSError: it cannot be started.
    """

    def __init__(self, settings: IonSettings, own: Eid, spool: Path) -> None:
        """Start it."""
        ours, its = socket.socketpair()
        with its:
            try:
                self._process = subprocess.Popen(
                    [
                        settings.python or sys.executable,
                        "-m", "adapters.bundle.daemons.ion_bridge",
                        "--fd", str(its.fileno()),
                        "--own", str(own),
                        "--spool", str(spool.absolute()),
                        "--look-s", str(settings.look_s),
                        "--answer-s", str(settings.answer_s),
                    ],
                    env=_environment(settings),
                    pass_fds=(its.fileno(),),
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    start_new_session=True,
                )  # fmt: skip
            except BaseException:
                ours.close()
                raise
        self.socket = ours

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def ask_to_end(self) -> None:
        """Send SIGTERM."""
        self._process.terminate()

    def leave(self) -> None:
        """Let it end in its own time; somebody has to hear of it, or it stays as a zombie."""
        if self._process.poll() is None:
            threading.Thread(target=self._process.wait, daemon=True).start()

    def wait(self, limit_s: float) -> bool:
        """Wait for its end, but not for ever; return whether it has ended."""
        try:
            self._process.wait(limit_s)
        except subprocess.TimeoutExpired:
            return False
        return True


def _environment(settings: IonSettings) -> dict[str, str]:
    paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    if settings.node_list is not None:
        environment["ION_NODE_LIST_DIR"] = settings.node_list
    return environment


_LOG: Final = logging.getLogger(__name__)
_END_S: Final = 5.0


class _BridgeEnded(Exception):  # noqa: N818 - another one is started
    """The bridge has ended; the text says why."""


class IonDaemon:
    """The client of an ION node; see `Daemon`.

    Args:
        settings: of the bridge.
        own: the endpoint.
        spool: where the bridge keeps what ION has forgotten.
        again_s: the shortest pause before a bridge that has ended is started again.
    """

    def __init__(self, settings: IonSettings, own: Eid, spool: Path, again_s: float = 0.5) -> None:
        """Be ready to be opened."""
        self._settings, self._own, self._spool = settings, own, spool
        self._end_s = min(_END_S, settings.answer_s)
        self._backoff = Backoff("ION", again_s)
        self._hear: OnInbound = _deaf
        self._wake: Callable[[], None] = _nobody
        self._ready: asyncio.Future[None] | None = None
        self._working: asyncio.Task[None] | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._number = 0
        self._under_way: dict[int, OnResult] = {}
        self._idle = asyncio.Event()
        self._open = self._answers = self._alive = self._closing = False
        self._heard_s = 0.0

    @property
    def up(self) -> bool:
        """Whether the bridge and ION answer."""
        return self._open and self._answers and self._alive and not self._closing

    async def open(self, hear: OnInbound, wake: Callable[[], None]) -> None:
        """Start the bridge, and wait once for what comes of it; see `Daemon`."""
        python = self._settings.python
        if python is not None and which(python) is None:
            raise BundleError(
                f"ion.python is {python}, which is not there or no program: name the interpreter"
                " that has pyion"
            )
        self._hear, self._wake = hear, wake
        self._ready = asyncio.get_running_loop().create_future()
        self._working = asyncio.create_task(self._for_ever())
        try:
            async with asyncio.timeout(self._settings.answer_s):
                await self._ready
        except TimeoutError:
            _LOG.warning("ION does not answer; what is sent waits here")
        except BundleError:
            await self.close()
            raise

    def post(self, data: Outbound, told: OnResult) -> None:
        """Give it to the bridge."""
        if self._writer is None:
            told("there is no bridge to ION")
            return
        self._number += 1
        self._under_way[self._number] = told
        lifetime_s = ceil(data.lifetime_s)
        self._write(Send(self._number, str(data.destination), lifetime_s, data.payload))

    async def close(self) -> None:
        """Let what is under way come to its end, then the bridge."""
        self._closing = True
        if self._under_way:
            self._idle.clear()
            try:
                async with asyncio.timeout(self._end_s):
                    await self._idle.wait()
            except TimeoutError:
                _LOG.warning("ION has not taken %d units: they wait here", len(self._under_way))
        if self._working is not None:
            self._working.cancel()
            await asyncio.gather(self._working, return_exceptions=True)
            self._working = None

    async def _for_ever(self) -> None:
        while True:
            try:
                await self._serve()
            except (OSError, DecodeError, _BridgeEnded) as error:
                self._settle(None)
                await asyncio.sleep(self._backoff.failed(error))
            except BundleError as error:
                if not self._settle(error):
                    _LOG.error("ION: %s", error)
                return

    async def _serve(self) -> None:
        """Have a bridge until it ends, and do not begin another before."""
        bridge = BridgeProcess(self._settings, self._own, self._spool)
        try:
            reader, self._writer = await asyncio.open_unix_connection(sock=bridge.socket)
            self._heard_s = asyncio.get_running_loop().time()
            self._alive = self._answers = True
            watching = asyncio.create_task(self._watch(bridge))
            try:
                await self._listen(reader)
            finally:
                watching.cancel()
        finally:
            await self._end(bridge)

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        frames = FrameReader()
        while octets := await reader.read(65_536):
            self._heard_s = asyncio.get_running_loop().time()
            self._turn(alive=True)
            for frame in frames.feed(octets):
                self._heed(frame)
        raise _BridgeEnded("the bridge has ended")

    def _heed(self, frame: Frame) -> None:
        match frame:
            case Ready():
                self._open = True
                self._backoff.went_well()
                self._settle(None)
                self._wake()
            case Sent():
                self._tell(frame.number, None)
            case Refused():
                self._tell(frame.number, frame.why)
            case Received():
                self._take(frame)
            case Pong():
                self._turn(answers=frame.ion_answers)
            case Failed():
                raise BundleError(frame.why) if frame.lasting else _BridgeEnded(frame.why)
            case Send() | Taken() | Ping():
                raise DecodeError(f"{type(frame).__name__} is for the bridge")
            case _:
                assert_never(frame)

    def _take(self, unit: Received) -> None:
        """Tell the bridge to let go of a unit once it is on the disk, or makes no sense."""
        try:
            source = parse_eid(unit.source)
        except ValueError as error:
            _LOG.warning("dropped: %s", error)
            self._write(Taken(True))
            return
        creation = Creation(unit.time_ms, unit.sequence)
        inbound = Inbound(source, self._own, creation, unit.payload)
        self._hear(inbound, lambda failure: self._write(Taken(failure is None)))

    def _tell(self, number: int, failure: str | None) -> None:
        if (told := self._under_way.pop(number, None)) is not None:
            told(failure)
        if not self._under_way:
            self._idle.set()

    def _write(self, frame: Frame) -> None:
        if self._writer is not None:
            self._writer.write(encode_frame(frame))

    def _settle(self, error: BundleError | None) -> bool:
        """Let `open` return; return whether it still waited."""
        if self._ready is None or self._ready.done():
            return False
        if error is None:
            self._ready.set_result(None)
        else:
            self._ready.set_exception(error)
        return True

    async def _watch(self, bridge: BridgeProcess) -> None:
        """Notice a bridge that is silent, and ask it, once, to end."""
        while True:
            await asyncio.sleep(self._settings.look_s)
            self._write(Ping())
            silent_s = asyncio.get_running_loop().time() - self._heard_s
            if self._alive and silent_s > self._settings.look_s + self._settings.answer_s:
                self._turn(alive=False)
                bridge.ask_to_end()

    def _turn(self, *, alive: bool | None = None, answers: bool | None = None) -> None:
        """Note who answers, and say what has changed."""
        before = (self._alive, self._answers)
        self._alive = self._alive if alive is None else alive
        self._answers = self._answers if answers is None else answers
        if (self._alive, self._answers) == before:
            return
        if self._alive and self._answers:
            _LOG.info("ION answers")
        else:
            who = "ION" if self._alive else "the bridge to ION"
            _LOG.error("%s does not answer: if that lasts, ION has to be restarted", who)
        self._wake()

    async def _end(self, bridge: BridgeProcess) -> None:
        """Hang up, and wait for the bridge to end, for as long as it takes unless this ends."""
        self._open = False
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        else:
            bridge.socket.close()
        under_way, self._under_way = self._under_way, {}
        for told in under_way.values():
            told("the bridge to ION has ended")
        self._idle.set()
        self._wake()
        if self._closing:
            bridge.ask_to_end()
        try:
            if await asyncio.to_thread(bridge.wait, self._end_s):
                return
            _LOG.error("process %d hangs in ION and is left to end: no kill -9", bridge.pid)
            while not self._closing and not await asyncio.to_thread(bridge.wait, self._end_s):
                continue
        finally:
            bridge.leave()


def _deaf(_: Inbound, told: OnResult) -> None:
    told("not open")


def _nobody() -> None:
    """Nobody waits."""
