"""`IonClient`: the agent's side of the bridge to NASA ION, which it starts, supervises, restarts.

ION carries either payloads, in its own bundles, or our whole bundles as its payload.
"""

import asyncio
import logging
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import ceil, inf
from pathlib import Path
from shutil import which
from typing import Final

from adapters.bundle.codec.bundle import (
    DTN_EPOCH_UTC_MS,
    PAYLOAD_NUMBER,
    Block,
    BlockType,
    Bundle,
    Creation,
    Primary,
    decode_bundle,
    encode_bundle,
)
from adapters.bundle.codec.eid import NONE, Eid, node_of, parse_eid
from adapters.bundle.codec.errors import BundleError, DecodeError, StoreError
from adapters.bundle.daemons import ion_frames as frames
from adapters.bundle.links.link import WHOLE_BUNDLES, Backoff, Endpoint, Link, LinkContext
from adapters.bundle.node.sending import Outgoing
from adapters.bundle.node.settings import DaemonLink, IonSettings, Neighbour

_LOG: Final = logging.getLogger(__name__)
_ROOT: Final = Path(__file__).resolve().parents[3]
_MAX_IN_FLIGHT: Final = 32
_MIN_BACKOFF_S: Final = 0.5
_END_S: Final = 5.0
_OnResult = Callable[[str | None], None]


class _BridgeEnded(Exception):  # noqa: N818 - the client starts another bridge
    """The bridge has ended; the text gives the reason."""


class IonNeighbour(Link):
    """Gives bundles for a neighbour to ION, and offers rejected ones again."""

    def __init__(
        self, context: LinkContext, neighbour: Neighbour, settings: DaemonLink, client: "IonClient"
    ) -> None:
        super().__init__(context, neighbour)
        self.up = False
        self.whole = settings.whole
        self._endpoint, self._client = settings.endpoint, client
        self._in_flight = 0
        self._rejected: list[Outgoing] = []
        self._retry_s = inf
        self._backoff = Backoff(f"{self.name} by ION", _MIN_BACKOFF_S)

    @property
    def next_s(self) -> float:
        """Monotonic time of the next offer of rejected bundles."""
        return self._retry_s

    def _send_waiting(self, expedited: bool) -> None:
        """Give waiting bundles to ION."""
        while self._contact and self.up and (expedited or self._in_flight < _MAX_IN_FLIGHT):
            batch = self._node.sending.outgoing(self.name, 1, WHOLE_BUNDLES, expedited=expedited)
            if not batch:
                return
            for outgoing in batch:
                self._post(outgoing)

    def tick(self) -> None:
        """Offer rejected bundles again."""
        if self._now_s() >= self._retry_s:
            self._retry_s = inf
            self._node.sending.requeue(self.name, self._rejected)
            self._rejected = []

    def _post(self, outgoing: Outgoing) -> None:
        bundle = decode_bundle(outgoing.octets)
        primary = bundle.primary
        ends_utc_ms = DTN_EPOCH_UTC_MS + primary.creation.time_ms + primary.lifetime_ms
        left_ms = ends_utc_ms - self._node.utc_ms()
        if left_ms <= 0:
            self._node.sending.forget(outgoing)
            return
        self._in_flight += 1
        destination = self._endpoint if self.whole else primary.destination
        payload = outgoing.octets if self.whole else bundle.payload
        self._client.post(
            destination, left_ms / 1000, payload, outgoing.stored.expedited,
            partial(self._on_sent, outgoing),
        )  # fmt: skip

    def _on_sent(self, outgoing: Outgoing, failure: str | None) -> None:
        self._in_flight -= 1
        self._wake()
        if failure is None:
            self._backoff.reset()
            self._node.sending.mark_forwarded([outgoing])
            return
        self._rejected.append(outgoing)
        if self._retry_s == inf:
            self._retry_s = self._now_s() + self._backoff.next_pause_s(failure)


class IonClient(Endpoint):
    """Client of the ION node that carries an agent's bundles.

    Received units that ION has already deleted are spooled by the bridge, beside the store.
    """

    def __init__(self, settings: IonSettings, context: LinkContext) -> None:
        self._settings, self._context = settings, context
        self._own = context.node.settings.sender
        self._links: dict[str, IonNeighbour] = {}
        self._end_s = min(_END_S, settings.answer_s)
        self._backoff = Backoff("ION", _MIN_BACKOFF_S)
        self._ready: asyncio.Future[None] | None = None
        self._working: asyncio.Task[None] | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._number = 0
        self._in_flight: dict[int, _OnResult] = {}
        self._idle = asyncio.Event()
        self._open = self._answers = self._alive = self._closing = False
        self._last_received_s = 0.0

    def link(self, neighbour: Neighbour) -> IonNeighbour:
        """Return the link to a neighbour."""
        settings = neighbour.link
        assert isinstance(settings, DaemonLink)
        link = IonNeighbour(self._context, neighbour, settings, self)
        self._links[link.name] = link
        return link

    async def open(self) -> None:
        """Start the bridge, and wait at most `answer_s` for ION.

        Raises:
            BundleError: the bridge can work neither now nor later; the text gives the reason.
        """
        python = self._settings.python
        if python is not None and which(python) is None:
            raise BundleError(
                f"ion.python is {python}, which does not exist or is no program: name the"
                " interpreter that has pyion"
            )
        self._ready = asyncio.get_running_loop().create_future()
        self._working = asyncio.create_task(self._serve_for_ever())
        try:
            async with asyncio.timeout(self._settings.answer_s):
                await self._ready
        except TimeoutError:
            _LOG.warning("ION does not answer; bundles to send wait in the store")
        except BundleError:
            await self.close()
            raise

    def post(
        self, destination: Eid, lifetime_s: float, payload: bytes, expedited: bool,
        on_result: _OnResult,
    ) -> None:  # fmt: skip
        """Give a payload to the bridge; `on_result` gets None on success, otherwise the reason."""
        if self._writer is None:
            on_result("the bridge to ION is not running")
            return
        self._number += 1
        self._in_flight[self._number] = on_result
        self._write(
            frames.SendRequest(self._number, str(destination), ceil(lifetime_s), payload, expedited)
        )

    async def close(self) -> None:
        """Wait for payloads in flight, then end the bridge."""
        self._closing = True
        self._update_links()
        if self._in_flight:
            self._idle.clear()
            try:
                async with asyncio.timeout(self._end_s):
                    await self._idle.wait()
            except TimeoutError:
                _LOG.warning("ION has not accepted %d units, still queued", len(self._in_flight))
        if self._working is not None:
            self._working.cancel()
            await asyncio.gather(self._working, return_exceptions=True)
            self._working = None

    async def _serve_for_ever(self) -> None:
        while True:
            try:
                await self._serve()
            except (OSError, DecodeError, _BridgeEnded) as error:
                self._settle(None)
                await asyncio.sleep(self._backoff.next_pause_s(error))
            except BundleError as error:
                if not self._settle(error):
                    _LOG.error("ION: %s", error)
                return

    async def _serve(self) -> None:
        """Run one bridge until it ends."""
        spool = self._context.node.database.path.with_suffix(".received")
        bridge, channel = _start_bridge(self._settings, self._own, spool)
        try:
            reader, self._writer = await asyncio.open_unix_connection(sock=channel)
            self._last_received_s = self._context.now_s()
            self._alive = self._answers = True
            watching = asyncio.create_task(self._watch(bridge))
            try:
                await self._listen(reader)
            finally:
                watching.cancel()
        finally:
            if self._writer is None:
                channel.close()
            await self._end(bridge)

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        cut = frames.FrameReader()
        while octets := await reader.read(65_536):
            self._last_received_s = self._context.now_s()
            self._note(alive=True)
            for frame in cut.feed(octets):
                self._receive(frame)
        raise _BridgeEnded("the bridge has ended")

    def _receive(self, frame: frames.Frame) -> None:
        match frame:
            case frames.Ready():
                self._open = True
                self._backoff.reset()
                self._settle(None)
                self._update_links()
            case frames.Sent():
                self._complete_request(frame.number, None)
            case frames.SendRejected():
                self._complete_request(frame.number, frame.reason)
            case frames.Received():
                self._receive_unit(frame)
            case frames.Pong():
                self._note(answers=frame.ion_answers)
            case frames.Failed():
                raise BundleError(frame.why) if frame.lasting else _BridgeEnded(frame.why)
            case _:
                raise DecodeError(f"unexpected frame {type(frame).__name__} from the bridge")

    def _receive_unit(self, unit: frames.Received) -> None:
        """Process a received unit; the bridge deletes it once it is on the disk.

        Units from an invalid source are logged, dropped and acknowledged.
        """
        node = self._context.node
        try:
            source = parse_eid(unit.source)
        except ValueError as error:
            _LOG.warning("unit dropped: %s", error)
            self._write(frames.ReceivedAck(True))
            return
        name = str(node_of(source))
        link = self._links.get(name)
        octets = unit.payload
        if link is None or not link.whole:
            octets = encode_bundle(self._bundle(source, unit))
        if link is not None:
            link.note_received()
        try:
            node.receiving.receive(name, octets)
        except StoreError:
            self._write(frames.ReceivedAck(False))
        else:
            node.transaction.on_commit(
                lambda failure: self._write(frames.ReceivedAck(failure is None))
            )
        self._context.wake()

    def _bundle(self, source: Eid, unit: frames.Received) -> Bundle:
        """Rebuild the bundle that ION received, as far as it is known.

        ION does not reveal the remaining lifetime, which has not ended. The identity is therefore
        remembered for the default lifetime of own bundles, from now on.
        """
        node = self._context.node
        now_ms = node.utc_ms() - DTN_EPOCH_UTC_MS
        age_ms = max(0, now_ms - unit.time_ms) if unit.time_ms else 0
        lifetime_ms = age_ms + round(1000 * node.settings.lifetime_s)
        creation = Creation(unit.time_ms, unit.sequence)
        primary = Primary(self._own, source, NONE, creation, lifetime_ms)
        return Bundle(primary, (Block(BlockType.PAYLOAD, PAYLOAD_NUMBER, unit.payload),))

    def _complete_request(self, number: int, failure: str | None) -> None:
        if (on_result := self._in_flight.pop(number, None)) is not None:
            on_result(failure)
        if not self._in_flight:
            self._idle.set()

    def _write(self, frame: frames.Frame) -> None:
        if self._writer is not None:
            self._writer.write(frames.encode_frame(frame))

    def _settle(self, error: BundleError | None) -> bool:
        """Complete the wait of `open` with a result; return False if it has ended before."""
        if self._ready is None or self._ready.done():
            return False
        if error is None:
            self._ready.set_result(None)
        else:
            self._ready.set_exception(error)
        return True

    async def _watch(self, bridge: subprocess.Popen[bytes]) -> None:
        """Watchdog: terminate a silent bridge, once."""
        while True:
            await asyncio.sleep(self._settings.poll_period_s)
            self._write(frames.Ping())
            silent_s = self._context.now_s() - self._last_received_s
            if self._alive and silent_s > self._settings.poll_period_s + self._settings.answer_s:
                self._note(alive=False)
                bridge.terminate()

    def _note(self, *, alive: bool | None = None, answers: bool | None = None) -> None:
        """Update whether bridge and ION answer; log changes."""
        before = (self._alive, self._answers)
        self._alive = self._alive if alive is None else alive
        self._answers = self._answers if answers is None else answers
        if (self._alive, self._answers) == before:
            return
        if self._alive and self._answers:
            _LOG.info("ION answers")
        else:
            name = "ION" if self._alive else "the bridge to ION"
            _LOG.error("%s does not answer: if this persists, restart ION", name)
        self._update_links()

    def _update_links(self) -> None:
        """Set the links up or down."""
        for link in self._links.values():
            link.up = self._open and self._answers and self._alive and not self._closing
        self._context.wake()

    async def _end(self, bridge: subprocess.Popen[bytes]) -> None:
        """Close the socket, and wait for the bridge to end; no longer than `_end_s` on close."""
        self._open = False
        self._update_links()
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        for number in list(self._in_flight):
            self._complete_request(number, "the bridge to ION has ended")
        self._idle.set()
        if self._closing:
            bridge.terminate()
        try:
            if await asyncio.to_thread(_has_ended, bridge, self._end_s):
                return
            _LOG.error("process %d hangs in ION and is left running: no kill -9", bridge.pid)
            while not (self._closing or await asyncio.to_thread(_has_ended, bridge, self._end_s)):
                continue
        finally:
            if bridge.poll() is None:  # it ends later, and is reaped then
                threading.Thread(target=bridge.wait, daemon=True).start()


def _start_bridge(
    settings: IonSettings, own: Eid, spool: Path
) -> tuple[subprocess.Popen[bytes], socket.socket]:
    """Start the bridge; return it with our end of the socket.

    The bridge runs in a session of its own, so that terminal signals do not reach it. It is never
    killed: SIGKILL within ION can leave the database of the node locked.

    Raises:
        OSError: the process cannot be started.
    """
    ours, its = socket.socketpair()
    with its:
        try:
            process = subprocess.Popen(
                [
                    settings.python or sys.executable,
                    "-m", "adapters.bundle.daemons.ion_bridge",
                    "--fd", str(its.fileno()),
                    "--own", str(own),
                    "--spool", str(spool.absolute()),
                    "--look-s", str(settings.poll_period_s),
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
    return process, ours


def _environment(settings: IonSettings) -> dict[str, str]:
    paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    if settings.node_list is not None:
        environment["ION_NODE_LIST_DIR"] = settings.node_list
    return environment


def _has_ended(process: subprocess.Popen[bytes], within_s: float) -> bool:
    with suppress(subprocess.TimeoutExpired):
        process.wait(within_s)
    return process.returncode is not None
