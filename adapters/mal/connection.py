"""One TCP connection that carries messages both ways: framing, turns, notifications, URIs."""

import asyncio
import logging
import socket
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final, cast
from urllib.parse import urlsplit

from adapters.mal.codec import SHORTEST, Header, decode_header, decode_message
from adapters.mal.errors import DecodeError, MalError, too_many
from adapters.mal.tls import certificate_name

_LOG: Final = logging.getLogger(__name__)
_UNREAD_CAP: Final = 8 << 20
"""Octets written and not taken by the peer, beyond which another reply ends the connection."""
_UNSENT_CAP: Final = 128 << 10
"""Octets that the operating system may buffer for a slow peer. By default it takes megabytes, which
would be minutes of telemetry that can no longer be dropped."""
_GATHERED_CAP: Final = 16 << 10
"""Octets of notifications that are written at once."""
_GRACE_S: Final = 1.0
"""How long a peer may take what was written before the connection was closed."""

MESSAGE_CAP: Final = 64 << 20
"""Octets of the longest message taken, and of the longest that is skipped."""
HEADER_OCTETS: Final = 4096
"""Of a message that is too long, what is read of it to see whom to tell."""
_LEAST_ROOM: Final = 16 << 10
"""Octets of a new framer's buffer."""
ROOM_AT_ONCE: Final = 256 << 10
"""Octets that a buffer grows to because much comes; beyond that only for a longer message."""


class Framer:
    """Cuts a stream of octets into messages.

    The buffer is reused, and never much longer than what has arrived of a message.

    Args:
        cap: Octets of the longest message taken.
        reserve: Called with how many octets beyond `room` the buffer is about to take, or
            (negative) has given back; it raises to refuse.
        room: Octets that the buffer grows to because much comes.
    """

    def __init__(
        self,
        cap: int = MESSAGE_CAP,
        reserve: Callable[[int], None] = lambda _: None,
        room: int = ROOM_AT_ONCE,
    ) -> None:
        self._cap = cap
        self._room = room
        self._reserve = reserve
        self._buffer = memoryview(bytearray(_LEAST_ROOM))
        self._begin = 0
        self._end = 0
        self._skip = 0

    @property
    def unfinished(self) -> bool:
        """Whether a message has begun and not ended."""
        return self._end > self._begin or self._skip > 0

    def buffer(self) -> memoryview:
        """The free part of the buffer, at least one octet: the next octets go there."""
        return self._buffer[self._end :]

    def received(self, count: int) -> None:
        """Note that so many octets were put into `buffer`."""
        self._end += count

    def take(self) -> memoryview | None:
        """Return the next message, which is valid until the next call; None if none is complete.

        Raises:
            DecodeError: These octets are no message; where the next begins is unknown.
            MalError: It is too long, or `reserve` refused; it may be skipped.
        """
        if self._skip:
            skipped = min(self._skip, self._end - self._begin)
            self._begin += skipped
            self._skip -= skipped
        there = self._end - self._begin
        length = self._length() if there >= 4 else 0
        if there < 4 or there < min(length, HEADER_OCTETS if length > self._cap else length):
            self._arrange(length)
            return None
        message = self._buffer[self._begin : self._begin + length]
        if length > self._cap:
            raise too_many(f"a message of {length} octets; at most {self._cap} are taken")
        self._begin += length
        if self._begin == self._end:
            self._begin = self._end = 0
            if len(self._buffer) > self._room:
                self._resize(_LEAST_ROOM)
        return message

    def skip(self) -> memoryview:
        """Let the message that has begun come and go; return its first octets."""
        self._skip = self._length()
        return self._buffer[self._begin : min(self._end, self._begin + HEADER_OCTETS)]

    def release(self) -> None:
        """Let go of the buffer; nothing comes any more."""
        self._buffer = memoryview(b"")
        self._begin = self._end = self._skip = 0

    def _length(self) -> int:
        begin = self._buffer[self._begin : self._begin + 4]
        length = int.from_bytes(begin, "big")
        if begin[0] >> 4 == 2:
            raise DecodeError(
                f"first octet {begin[0]:#04x}: the header of 521.0-B-2, not of 521.0-B-3"
            )
        if not SHORTEST <= length <= MESSAGE_CAP:
            raise DecodeError(f"message length {length}, not within {SHORTEST} and {MESSAGE_CAP}")
        return length

    def _arrange(self, length: int) -> None:
        """Make room behind an incomplete message by moving it, into a longer buffer if need be."""
        begun = self._buffer[self._begin : self._end]
        size = len(self._buffer)
        if len(begun) == size or (self._end == size and size < self._room):
            self._resize(min(2 * size, max(length, self._room)))
        elif not begun and size > self._room:
            self._resize(_LEAST_ROOM)
        elif self._begin == 0 or (begun and self._end <= size // 2):
            return
        self._begin, self._end = 0, len(begun)
        self._buffer[: self._end] = begun

    def _resize(self, size: int) -> None:
        before, after = (max(octets - self._room, 0) for octets in (len(self._buffer), size))
        if after != before:
            self._reserve(after - before)
        self._buffer = memoryview(bytearray(size))


SLICE_S: Final = 0.002
"""How long messages are served at a time, before whoever else is on the loop has a turn."""
_PAUSE_S: Final = 0.0001
"""How long nothing must have been served for a new slice to begin."""

Job = Callable[[], bool]
"""Does one piece of work, and returns whether more is left."""


class FairScheduler:
    """Shares the loop's time among connections, a piece of work at a time.

    Whoever has little to do is served before those who always have more.
    """

    def __init__(self) -> None:
        self._fresh: deque[Job] = deque()
        self._busy: deque[Job] = deque()
        self._waiting: set[Job] = set()
        self._ended_s = self._end_s = 0.0

    def wake(self, job: Job) -> None:
        """Do a job's work: at once while there is time and nobody waits, the rest in turn."""
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

    def forget(self, job: Job) -> None:
        """Let a job wait no longer."""
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


class ConnectionGuard:
    """What a connection asks of whoever looks after it; this one knows no others.

    Attributes:
        turns: Whose turn it is.
        message_cap: Octets of the longest message taken.
        room: Octets that each connection's buffer may have without asking.
    """

    def __init__(self, message_cap: int = MESSAGE_CAP, room: int = ROOM_AT_ONCE) -> None:
        self.turns = FairScheduler()
        self.message_cap = message_cap
        self.room = room

    def opened(self, connection: "Connection") -> None:
        """Know that a connection can be used."""

    def reserve(self, connection: "Connection", octets: int) -> None:
        """Give room for octets of long messages, or (negative) take it back.

        Raises:
            MalError: TOO_MANY.
        """

    def refused(self, connection: "Connection", header: Header, error: MalError) -> None:
        """Answer a message that there is no room for, and that is skipped."""
        connection.refuse(f"{header.stage.name}: {error}")

    def warn(self, text: str, *arguments: object) -> None:
        """Log what a peer caused."""
        _LOG.warning(text, *arguments)


class Connection(asyncio.BufferedProtocol):
    """Gives every message to its owner, in its turn, and writes without waiting.

    Octets that are no message close the connection with one line in the log, and so does a peer
    that does not read its replies. Reading never waits for writing, so that a command gets in
    however slow the way back is.

    Attributes:
        lost: Done when the connection is gone, whichever end closed it.
        peer: The other end, for logs.
        peer_host: The address of the other end's computer.
        peer_name: Whom the other end's certificate names, over TLS; empty if it names nobody, None
            without one.
        arrived_s: When octets came last, in the loop's time.
        heard: How many whole messages came.
        heard_s: When the last of them did, in the loop's time.
    """

    def __init__(self, on_message: OnMessage, guard: ConnectionGuard | None = None) -> None:
        self._on_message = on_message
        self._guard = guard = ConnectionGuard() if guard is None else guard
        self._framer = Framer(guard.message_cap, partial(guard.reserve, self), guard.room)
        self._transport: asyncio.Transport | None = None
        self._notifications = NotificationQueue(self._gather, self.give_up)
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
        self.peer = "nobody"
        self.peer_host = ""
        self.peer_name: str | None = None
        self.arrived_s = loop.time()
        self.heard, self.heard_s = 0, 0.0

    @property
    def is_open(self) -> bool:
        """Whether messages can be sent."""
        return self._transport is not None and not self._transport.is_closing()

    @property
    def local_address(self) -> tuple[str, int]:
        """The host and port of this end, of an open connection."""
        assert self._transport is not None
        host, port, *_ = self._transport.get_extra_info("sockname")
        return host, port

    def send(self, message: bytes) -> None:
        """Write a message; nothing happens when the connection is gone.

        The answers to messages that came together are written together.
        """
        self._keep(message)
        if not self._serving:
            self._write_gathered()

    def _write(self, message: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > _UNREAD_CAP:
            self.give_up(f"more than {_UNREAD_CAP} octets wait to be read there")
            return
        self._transport.write(message)

    async def drain(self, patience_s: float | None = None) -> None:
        """Yield to the loop, and return when the peer has taken most of what was written.

        Returns at once on a connection that is lost.

        Raises:
            TimeoutError: The peer did not in so many seconds.
        """
        await asyncio.sleep(0)
        if not self._writable.is_set():
            async with asyncio.timeout(patience_s):
                while not self._writable.is_set():
                    await self._writable.wait()

    @property
    def unread_octets(self) -> int:
        """What was written and is not taken by the peer yet."""
        return 0 if self._transport is None else self._transport.get_write_buffer_size()

    @property
    def waits_for_more(self) -> bool:
        """Whether a message has begun to arrive, and not ended."""
        return self._framer.unfinished

    def pause_reading(self, holder: object) -> None:
        """Read nothing until each holder has resumed; the peer waits meanwhile."""
        self._holders.add(holder)
        if self._transport is not None:
            self._transport.pause_reading()

    def resume_reading(self, holder: object) -> None:
        """Read on if no other holder has paused reading."""
        if holder in self._holders:
            self._holders.remove(holder)
            if not self._holders and self._transport is not None:
                self._transport.resume_reading()

    def notify(self, messages: Callable[[], Iterable[bytes]], droppable: bool) -> None:
        """Write messages that may wait, and be dropped meanwhile if they are `droppable`.

        They are made when the peer takes them. Those of one turn of the loop are written together.
        The oldest are dropped first.
        """
        if self.is_open and self._notifications.put(messages, droppable):
            self._guard.turns.wake(self._jobs[1])

    def _gather(self, message: bytes) -> None:
        if not self._gathered:
            self._loop.call_soon(self._write_gathered)
        self._keep(message)

    def _keep(self, message: bytes) -> None:
        self._gathered.append(message)
        self._gathered_octets += len(message)
        if self._gathered_octets > _GATHERED_CAP:
            self._write_gathered()

    def _write_gathered(self) -> None:
        if self._gathered:
            together = b"".join(self._gathered)
            self._gathered.clear()
            self._gathered_octets = 0
            self._write(together)

    def refuse(self, reason: str) -> None:
        """Close the connection because of what came over it, which the log will say."""
        if self.is_open:
            self._guard.warn("connection with %s closed: %s", self.peer, reason)
            self._write_gathered()
            assert self._transport is not None
            self._transport.close()

    def give_up(self, reason: str) -> None:
        """End the connection at once, which the log will say; what was not taken yet is lost."""
        if self.is_open:
            self._guard.warn("connection with %s given up: %s", self.peer, reason)
        if self._transport is not None:
            self._transport.abort()

    async def close(self) -> None:
        """Close the connection and return when it is gone; a peer that takes nothing loses it."""
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
        gone = ("nobody", 0)  # it hung up before it was taken, and is lost next
        host, port, *_ = transport.get_extra_info("peername") or gone
        self.peer, self.peer_host = f"{host}:{port}", host
        certificate = transport.get_extra_info("peercert")
        self.peer_name = (certificate_name(certificate) or "") if certificate else None
        self._guard.opened(self)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Called by asyncio, for where to put what arrives."""
        return self._framer.buffer()

    def buffer_updated(self, nbytes: int) -> None:
        """Called by asyncio when octets have arrived there."""
        self._framer.received(nbytes)
        self.arrived_s = self._loop.time()
        self._drained = False
        self._serving = True
        self._guard.turns.wake(self._jobs[0])
        self._serving = False
        self._write_gathered()
        if not self._drained:
            self.pause_reading(self._framer)

    def _receive_one(self) -> bool:
        """Take a message that has arrived; read on when there is none."""
        try:
            message = self._framer.take()
            if message is not None:
                header, body = decode_message(message)
                self.heard, self.heard_s = self.heard + 1, self.arrived_s
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
        """Have a message that there is no room for answered, and let it come and go."""
        try:
            header, _ = decode_header(self._framer.skip())
        except DecodeError:
            self.refuse(str(error))
            return False
        self._guard.refused(self, header, error)
        return self.is_open

    def pause_writing(self) -> None:
        """Called by asyncio when the peer does not take what is written."""
        self._writable.clear()
        self._notifications.paused = True

    def resume_writing(self) -> None:
        """Called by asyncio when the peer takes again."""
        self._writable.set()
        self._notifications.paused = False
        self._guard.turns.wake(self._jobs[1])

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by asyncio, once."""
        self._transport = None
        self._writable.set()
        for job in self._jobs:
            self._guard.turns.forget(job)
        self._framer.release()
        self.lost.set_result(None)


SCHEME: Final = "maltcp"
_BROKER: Final = "InternalBroker"


@dataclass(frozen=True, slots=True)
class MalUri:
    """Where a consumer, provider or broker is, and its name there."""

    host: str
    port: int
    name: str

    @classmethod
    def parse(cls, text: str) -> "MalUri":
        """Read `maltcp://host:port/name`.

        Raises:
            ValueError: It is not of this form.
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
        """The broker that belongs to a provider, named as ESA does."""
        return MalUri(self.host, self.port, self.name + _BROKER)

    def __str__(self) -> str:
        """The URI as text."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{SCHEME}://{host}:{self.port}/{self.name}"


DROPPABLE_CAP: Final = 256
"""Droppable notifications that wait, at most; the oldest gives way to a new one."""
BACKLOG_CAP: Final = 4096
"""Notifications that may not be dropped and wait, at most; one more, and the subscriber is given
up."""


class NotificationQueue:
    """Notifications for one peer, in order and bounded, made into messages when it takes them.

    Attributes:
        paused: Whether the peer takes nothing now.
    """

    def __init__(self, write: Callable[[bytes], None], give_up: Callable[[str], None]) -> None:
        self.paused = False
        self._write = write
        self._give_up = give_up
        self._waiting: OrderedDict[int, Callable[[], Iterable[bytes]]] = OrderedDict()
        self._droppable: deque[int] = deque()
        self._number = 0
        self._under_way: Iterator[bytes] | None = None

    def put(self, messages: Callable[[], Iterable[bytes]], droppable: bool) -> bool:
        """Have messages wait, and return whether they may be sent now."""
        if self._under_way is None and not self._waiting and not self.paused:
            self._under_way = iter(messages())
            return True
        self._number += 1
        self._waiting[self._number] = messages
        if droppable:
            if len(self._droppable) == DROPPABLE_CAP:
                del self._waiting[self._droppable.popleft()]
            self._droppable.append(self._number)
        while len(self._waiting) - len(self._droppable) > BACKLOG_CAP:
            if not self.send_one():
                self._give_up(f"{BACKLOG_CAP} messages wait that may not be dropped")
                return False
        return not self.paused

    def send_one(self) -> bool:
        """Write a message, and return whether more can be written now."""
        while not self.paused:
            if self._under_way is None:
                if not self._waiting:
                    break
                number, messages = self._waiting.popitem(last=False)
                if self._droppable and self._droppable[0] == number:
                    self._droppable.popleft()
                self._under_way = iter(messages())
            message = next(self._under_way, None)
            if message is not None:
                self._write(message)
                return True
            self._under_way = None
        return False
