"""`Connection`: one TCP connection in both directions, with framing and fair scheduling; URIs."""

import asyncio
import logging
import socket
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final, cast
from urllib.parse import urlsplit

from adapters.mal.codec import MIN_MESSAGE_OCTETS, Header, decode_header, decode_message
from adapters.mal.errors import DecodeError, MalError, too_many
from adapters.mal.tls import certificate_name

_LOG: Final = logging.getLogger(__name__)
_UNREAD_CAP: Final = 8 << 20
"""Maximum octets written but not accepted by the peer; another reply then ends the connection."""
_UNSENT_CAP: Final = 128 << 10
"""Maximum octets that the operating system buffers for a slow peer. Its default of megabytes would
be minutes of telemetry that can no longer be dropped."""
_GATHERED_CAP: Final = 16 << 10
"""Maximum octets of notifications in one write."""
_GRACE_S: Final = 1.0
"""Timeout of a close for the peer to accept written octets; chosen, not measured."""

MESSAGE_CAP: Final = 64 << 20
"""Maximum octets of an accepted message, and of a skipped one."""
HEADER_OCTETS: Final = 4096
"""Octets that are read of a message that is too long, to find its sender."""
_MIN_BUFFER_OCTETS: Final = 16 << 10
"""Initial octets of a framer's buffer."""
BUFFER_STEP_OCTETS: Final = 256 << 10
"""Buffer size under load; larger only for a longer message."""


class Framer:
    """Splits a stream of octets into messages.

    The buffer is reused, and never much larger than the received part of a message.

    Args:
        cap: Maximum octets of a message.
        reserve: Called with the octets beyond `capacity` that the buffer is about to allocate, or
            (negative) has released; raises to reject.
        capacity: Buffer size under load.
    """

    def __init__(
        self,
        cap: int = MESSAGE_CAP,
        reserve: Callable[[int], None] = lambda _: None,
        capacity: int = BUFFER_STEP_OCTETS,
    ) -> None:
        self._cap = cap
        self._capacity = capacity
        self._reserve = reserve
        self._buffer = memoryview(bytearray(_MIN_BUFFER_OCTETS))
        self._begin = 0
        self._end = 0
        self._skip = 0

    @property
    def unfinished(self) -> bool:
        """Whether a message is incomplete."""
        return self._end > self._begin or self._skip > 0

    def buffer(self) -> memoryview:
        """Return the free part of the buffer, at least one octet, for the next octets."""
        return self._buffer[self._end :]

    def add_received(self, count: int) -> None:
        """Add `count` octets that were written to `buffer`."""
        self._end += count

    def next_message(self) -> memoryview | None:
        """Return the next message, valid until the next call; None if none is complete.

        Raises:
            DecodeError: The octets are no message; the start of the next one is unknown.
            MalError: It is too long, or `reserve` rejected it; it can be skipped.
        """
        if self._skip:
            skipped = min(self._skip, self._end - self._begin)
            self._begin += skipped
            self._skip -= skipped
        size = self._end - self._begin
        length = self._length() if size >= 4 else 0
        if size < 4 or size < min(length, HEADER_OCTETS if length > self._cap else length):
            self._arrange(length)
            return None
        message = self._buffer[self._begin : self._begin + length]
        if length > self._cap:
            raise too_many(f"message of {length} octets, at most {self._cap} are accepted")
        self._begin += length
        if self._begin == self._end:
            self._begin = self._end = 0
            if len(self._buffer) > self._capacity:
                self._resize(_MIN_BUFFER_OCTETS)
        return message

    def skip(self) -> memoryview:
        """Skip the incomplete message; return its first octets."""
        self._skip = self._length()
        return self._buffer[self._begin : min(self._end, self._begin + HEADER_OCTETS)]

    def release(self) -> None:
        """Release the buffer of a closed connection."""
        self._buffer = memoryview(b"")
        self._begin = self._end = self._skip = 0

    def _length(self) -> int:
        begin = self._buffer[self._begin : self._begin + 4]
        length = int.from_bytes(begin, "big")
        if begin[0] >> 4 == 2:
            raise DecodeError(
                f"first octet {begin[0]:#04x}: the header of 521.0-B-2, not of 521.0-B-3"
            )
        if bytes(begin) == b"HTTP":
            raise DecodeError("it is a web server, such as a console")
        if not MIN_MESSAGE_OCTETS <= length <= MESSAGE_CAP:
            raise DecodeError(
                f"message length {length} is outside {MIN_MESSAGE_OCTETS} to {MESSAGE_CAP}"
            )
        return length

    def _arrange(self, length: int) -> None:
        """Move an incomplete message to free space after it, into a larger buffer if necessary."""
        begun = self._buffer[self._begin : self._end]
        size = len(self._buffer)
        if len(begun) == size or (self._end == size and size < self._capacity):
            self._resize(min(2 * size, max(length, self._capacity)))
        elif not begun and size > self._capacity:
            self._resize(_MIN_BUFFER_OCTETS)
        elif self._begin == 0 or (begun and self._end <= size // 2):
            return
        self._begin, self._end = 0, len(begun)
        self._buffer[: self._end] = begun

    def _resize(self, size: int) -> None:
        before, after = (max(octets - self._capacity, 0) for octets in (len(self._buffer), size))
        if after != before:
            self._reserve(after - before)
        self._buffer = memoryview(bytearray(size))


SLICE_S: Final = 0.002
"""Duration of a slice of messages before other tasks of the loop run; chosen, not measured."""
_PAUSE_S: Final = 0.0001
"""Idle time after which a new slice begins."""

Job = Callable[[], bool]
"""Does one piece of work, and returns whether more is pending."""


class FairScheduler:
    """Shares the loop's time among connections, one piece of work at a time.

    A job with little work is served before jobs that always have more.
    """

    def __init__(self) -> None:
        self._fresh: deque[Job] = deque()
        self._busy: deque[Job] = deque()
        self._waiting: set[Job] = set()
        self._ended_s = self._end_s = 0.0

    def wake(self, job: Job) -> None:
        """Run a job: immediately if the slice has time and no job waits, the rest in turn."""
        if not self._waiting:
            now_s = asyncio.get_running_loop().time()
            if now_s - self._ended_s > _PAUSE_S:
                self._end_s = now_s + SLICE_S
            while now_s < self._end_s:
                more = job()
                now_s = self._ended_s = asyncio.get_running_loop().time()
                if not more:
                    return
            asyncio.get_running_loop().call_soon(self._next_slice)
        elif job in self._waiting:
            return
        self._waiting.add(job)
        self._fresh.append(job)

    def remove(self, job: Job) -> None:
        """Remove a waiting job."""
        if job in self._waiting:
            self._waiting.remove(job)
            (self._fresh if job in self._fresh else self._busy).remove(job)

    def _next_slice(self) -> None:
        self._ended_s = asyncio.get_running_loop().time()
        self._end_s = self._ended_s + SLICE_S
        served = 0
        while self._waiting:
            if self._ended_s >= self._end_s:
                asyncio.get_running_loop().call_soon(self._next_slice)
                return
            served += 1
            queue = self._fresh if self._fresh and (served % 8 or not self._busy) else self._busy
            job = queue.popleft()
            self._waiting.remove(job)
            if job() and job not in self._waiting:
                self._waiting.add(job)
                self._busy.append(job)
            self._ended_s = asyncio.get_running_loop().time()


OnMessage = Callable[["Connection", Header, bytes], None]


@dataclass(slots=True)
class LinkTraffic:
    """Open connections, and traffic of all connections since the start; read on any thread."""

    connections: int = 0
    received_messages: int = 0
    received_octets: int = 0
    sent_messages: int = 0
    sent_octets: int = 0


class ConnectionGuard:
    """Owner of a connection: bounds and scheduling; this base class has a single connection.

    Attributes:
        traffic: sent and received messages and octets of the connections.
        message_cap: Maximum octets of a message.
        capacity: Octets of each connection's buffer without a reservation.
    """

    def __init__(self, message_cap: int = MESSAGE_CAP, capacity: int = BUFFER_STEP_OCTETS) -> None:
        self.turns = FairScheduler()
        self.traffic = LinkTraffic()
        self.message_cap = message_cap
        self.buffer_octets = capacity

    def on_opened(self, connection: "Connection") -> None:
        """Called when a connection is ready for use."""

    def reserve(self, connection: "Connection", octets: int) -> None:
        """Reserve octets for long messages, or release (negative).

        Raises:
            MalError: TOO_MANY.
        """

    def on_refused(self, connection: "Connection", header: Header, error: MalError) -> None:
        """Answer a message that exceeds a bound and is skipped."""
        connection.refuse(f"{header.stage.name}: {error}")

    def warn(self, text: str, *arguments: object) -> None:
        """Log an error of a peer."""
        _LOG.warning(text, *arguments)


class Connection(asyncio.BufferedProtocol):
    """Passes every received message to its owner, in fair turns, and writes without waiting.

    Invalid octets close the connection with one line in the log, as does a peer that does not read
    its replies. Reading never waits for writing, so that a command is received however slow the
    return path is.

    Attributes:
        lost: Completes when the connection is closed, by either end.
        refusal: The error of an invalid message, after it has closed the connection; None before.
        peer: The peer, for logs.
        peer_name: The name in the peer's certificate; empty if it has none, None without a
            certificate.
        arrived_s: Time of the last received octets, by the loop's clock.
        messages_received: Number of complete received messages.
        last_received_s: Time of the last of them, by the loop's clock.
    """

    def __init__(self, on_message: OnMessage, guard: ConnectionGuard | None = None) -> None:
        self._on_message = on_message
        self._guard = guard = ConnectionGuard() if guard is None else guard
        self._traffic = guard.traffic
        self._framer = Framer(guard.message_cap, partial(guard.reserve, self), guard.buffer_octets)
        self._transport: asyncio.Transport | None = None
        self._notifications = NotificationQueue(self._gather, self.abort)
        self._gathered: list[bytes] = []
        self._gathered_octets = 0
        self._serving = False
        self._writable = asyncio.Event()
        self._writable.set()
        self._holders: set[object] = set()
        self._drained = True
        self._jobs = (self._receive_one, self._notifications.send_one)
        self._loop = loop = asyncio.get_running_loop()
        self.lost: asyncio.Future[None] = loop.create_future()
        self.refusal: str | None = None
        self.peer = "unknown"
        self.peer_host = ""
        self.peer_name: str | None = None
        self.arrived_s = loop.time()
        self.messages_received, self.last_received_s = 0, 0.0

    @property
    def is_open(self) -> bool:
        """Whether messages can be sent."""
        return self._transport is not None and not self._transport.is_closing()

    @property
    def local_address(self) -> tuple[str, int]:
        """Host and port of this end of an open connection."""
        assert self._transport is not None
        host, port, *_ = self._transport.get_extra_info("sockname")
        return host, port

    def send(self, message: bytes) -> None:
        """Write a message; ignored if the connection is closed.

        The answers to messages that arrived together are written together.
        """
        self._add_gathered(message)
        if not self._serving:
            self._write_gathered()

    def _write(self, octets: bytes, messages: int) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > _UNREAD_CAP:
            self.abort(f"more than {_UNREAD_CAP} octets are unread by the peer")
            return
        self._traffic.sent_messages += messages
        self._traffic.sent_octets += len(octets)
        self._transport.write(octets)

    async def drain(self, patience_s: float | None = None) -> None:
        """Yield to the loop, and wait until the write buffer of the connection has space.

        Returns immediately if the connection is lost.

        Raises:
            TimeoutError: The peer did not within `patience_s`.
        """
        await asyncio.sleep(0)
        if not self._writable.is_set():
            async with asyncio.timeout(patience_s):
                while not self._writable.is_set():
                    await self._writable.wait()

    @property
    def unread_octets(self) -> int:
        """Octets written but not accepted by the peer yet."""
        return 0 if self._transport is None else self._transport.get_write_buffer_size()

    @property
    def waits_for_more(self) -> bool:
        """Whether a received message is incomplete."""
        return self._framer.unfinished

    def pause_reading(self, holder: object) -> None:
        """Stop reading until each holder has resumed; TCP then slows down the peer."""
        self._holders.add(holder)
        if self._transport is not None:
            self._transport.pause_reading()

    def resume_reading(self, holder: object) -> None:
        """Continue reading if no other holder has paused it."""
        if holder in self._holders:
            self._holders.remove(holder)
            if not self._holders and self._transport is not None:
                self._transport.resume_reading()

    def notify(self, messages: Callable[[], Iterable[bytes]], droppable: bool) -> None:
        """Queue messages for writing; `droppable` ones may be dropped from the queue.

        They are encoded when the peer accepts data. Those of one loop iteration are written
        together. The oldest are dropped first.
        """
        if self.is_open and self._notifications.put(messages, droppable):
            self._guard.turns.wake(self._jobs[1])

    def _gather(self, message: bytes) -> None:
        if not self._gathered:
            self._loop.call_soon(self._write_gathered)
        self._add_gathered(message)

    def _add_gathered(self, message: bytes) -> None:
        self._gathered.append(message)
        self._gathered_octets += len(message)
        if self._gathered_octets > _GATHERED_CAP:
            self._write_gathered()

    def _write_gathered(self) -> None:
        if self._gathered:
            together, messages = b"".join(self._gathered), len(self._gathered)
            self._gathered.clear()
            self._gathered_octets = 0
            self._write(together, messages)

    def refuse(self, reason: str) -> None:
        """Close the connection because of an invalid message, with the reason in the log."""
        if self.is_open:
            self.refusal = reason
            self._guard.warn("connection with %s closed: %s", self.peer, reason)
            self._write_gathered()
            assert self._transport is not None
            self._transport.close()

    def abort(self, reason: str) -> None:
        """Abort the connection, with the reason in the log; unsent octets are lost."""
        if self.is_open:
            self._guard.warn("connection with %s aborted: %s", self.peer, reason)
        if self._transport is not None:
            self._transport.abort()

    async def close(self) -> None:
        """Close the connection and wait for its end; it is aborted after a timeout."""
        self._write_gathered()
        if self._transport is not None:
            self._transport.close()
            await asyncio.wait([self.lost], timeout=_GRACE_S)
        if self._transport is not None:
            self._transport.abort()
            await self.lost

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio."""
        self._transport = cast(asyncio.Transport, transport)
        options = {socket.TCP_NODELAY: 1, socket.TCP_NOTSENT_LOWAT: _UNSENT_CAP}
        for option, value in options.items():
            transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, option, value)
        closed = ("unknown", 0)  # the peer closed it before the accept; it is lost next
        host, port, *_ = transport.get_extra_info("peername") or closed
        self.peer, self.peer_host = f"{host}:{port}", host
        certificate = transport.get_extra_info("peercert")
        self.peer_name = (certificate_name(certificate) or "") if certificate else None
        self._guard.on_opened(self)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return the buffer for received octets; called by asyncio."""
        return self._framer.buffer()

    def buffer_updated(self, nbytes: int) -> None:
        """Called by asyncio when octets were received into the buffer."""
        self._framer.add_received(nbytes)
        self._traffic.received_octets += nbytes
        self.arrived_s = self._loop.time()
        self._drained = False
        self._serving = True
        self._guard.turns.wake(self._jobs[0])
        self._serving = False
        self._write_gathered()
        if not self._drained:
            self.pause_reading(self._framer)

    def _receive_one(self) -> bool:
        """Process one received message; continue reading if there is none."""
        try:
            message = self._framer.next_message()
            if message is not None:
                header, body = decode_message(message)
                self._traffic.received_messages += 1
                self.messages_received, self.last_received_s = (
                    self.messages_received + 1,
                    self.arrived_s,
                )
                self._on_message(self, header, body)
                if self._framer.unfinished:
                    return self.is_open
        except MalError as error:
            return self._skip(error)
        except DecodeError as fault:
            self.refuse(str(fault))
            return False
        self._drained = True
        self.resume_reading(self._framer)
        return False

    def _skip(self, error: MalError) -> bool:
        """Answer a message that exceeds a bound, and skip it."""
        try:
            header, _ = decode_header(self._framer.skip())
        except DecodeError:
            self.refuse(str(error))
            return False
        self._guard.on_refused(self, header, error)
        return self.is_open

    def pause_writing(self) -> None:
        """Called by asyncio when the write buffer is full."""
        self._writable.clear()
        self._notifications.paused = True

    def resume_writing(self) -> None:
        """Called by asyncio when the write buffer has space again."""
        self._writable.set()
        self._notifications.paused = False
        self._guard.turns.wake(self._jobs[1])

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by asyncio, once."""
        self._transport = None
        self._writable.set()
        for job in self._jobs:
            self._guard.turns.remove(job)
        self._framer.release()
        self.lost.set_result(None)


SCHEME: Final = "maltcp"
_BROKER: Final = "InternalBroker"


@dataclass(frozen=True, slots=True)
class MalUri:
    """URI of a consumer, provider or broker."""

    host: str
    port: int
    name: str

    @classmethod
    def parse(cls, text: str) -> "MalUri":
        """Parse `maltcp://host:port/name`.

        Raises:
            ValueError: It does not have this form.
        """
        parts = urlsplit(text)
        if (
            parts.scheme != SCHEME
            or not parts.hostname
            or parts.port is None
            or len(parts.path) < 2
        ):
            raise ValueError(f"{text!r} is not {SCHEME}://host:port/name")
        return cls(parts.hostname, parts.port, parts.path[1:])

    @property
    def broker(self) -> "MalUri":
        """URI of a provider's broker, named as in mo-services-java."""
        return MalUri(self.host, self.port, self.name + _BROKER)

    def __str__(self) -> str:
        """Return the URI as text."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{SCHEME}://{host}:{self.port}/{self.name}"


DROPPABLE_CAP: Final = 256
"""Maximum queued droppable notifications: a new one replaces the oldest. Chosen, not measured."""
BACKLOG_CAP: Final = 4096
"""Maximum queued notifications that may not be dropped; beyond it the subscriber is
disconnected. Chosen, not measured."""


class NotificationQueue:
    """Bounded, ordered queue of notifications for one peer; encoded when the peer accepts data.

    Attributes:
        paused: Whether the peer accepts no data now.
    """

    def __init__(self, write: Callable[[bytes], None], on_failure: Callable[[str], None]) -> None:
        self.paused = False
        self._write = write
        self._abort = on_failure
        self._waiting: OrderedDict[int, Callable[[], Iterable[bytes]]] = OrderedDict()
        self._droppable: deque[int] = deque()
        self._number = 0
        self._in_flight: Iterator[bytes] | None = None

    def put(self, messages: Callable[[], Iterable[bytes]], droppable: bool) -> bool:
        """Queue messages, and return whether they can be sent now."""
        if self._in_flight is None and not self._waiting and not self.paused:
            self._in_flight = iter(messages())
            return True
        self._number += 1
        self._waiting[self._number] = messages
        if droppable:
            if len(self._droppable) == DROPPABLE_CAP:
                del self._waiting[self._droppable.popleft()]
            self._droppable.append(self._number)
        while len(self._waiting) - len(self._droppable) > BACKLOG_CAP:
            if not self.send_one():
                self._abort(f"{BACKLOG_CAP} queued messages may not be dropped")
                return False
        return not self.paused

    def send_one(self) -> bool:
        """Write one message, and return whether more can be written now."""
        while not self.paused:
            if self._in_flight is None:
                if not self._waiting:
                    break
                number, messages = self._waiting.popitem(last=False)
                if self._droppable and self._droppable[0] == number:
                    self._droppable.popleft()
                self._in_flight = iter(messages())
            message = next(self._in_flight, None)
            if message is not None:
                self._write(message)
                return True
            self._in_flight = None
        return False
