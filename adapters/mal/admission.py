"""`Connections` of a provider: which it admits, and the bounds of their resources together."""

import asyncio
import ctypes
import errno
import socket
import ssl
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from heapq import nsmallest
from typing import Final

from adapters.mal.attribute_codec import MAX_ELEMENTS
from adapters.mal.codec import Header
from adapters.mal.connection import MESSAGE_CAP, Connection, ConnectionGuard, OnMessage
from adapters.mal.errors import MalError, too_many
from adapters.system import Socket, System


@dataclass(frozen=True, slots=True)
class PeerLimits:
    """Resource bounds of a provider's peers, for all together unless stated. Chosen, not measured.

    Attributes:
        connections: Open connections, handshakes included; at most half of the process's file
            descriptors. One more replaces another.
        message_octets: Octets of one message. A longer one is answered with TOO_MANY and skipped.
        elements: List elements in one message.
        unfinished_octets: Octets of long messages that are not complete.
        unread_octets: Octets written but not accepted by the peers.
        silence_s: Timeout of a connection's first complete message.
        stall_s: Timeout of an incomplete message without new octets.
        handshake_s: Timeout of the TLS handshake.
        subscriptions, publishers, interactions: Registered, or active.
        share: Bound of each of the three over one connection.
    """

    connections: int = 256
    message_octets: int = MESSAGE_CAP
    elements: int = MAX_ELEMENTS
    unfinished_octets: int = 2 * MESSAGE_CAP
    unread_octets: int = 64 << 20
    silence_s: float = 60.0
    stall_s: float = 30.0
    handshake_s: float = 5.0
    subscriptions: int = 1024
    publishers: int = 1024
    interactions: int = 1024
    share: int = 256


class Quota:
    """A bound on a resource of all connections together, with fair shares.

    If it is exhausted, the connection with the maximum part is aborted, unless that is the
    requester itself or has priority.

    Args:
        what: The counted resource, in the plural.
        total: Bound of all connections.
        share: Bound of one connection.
        is_priority: Whether a connection has priority and must not be aborted.
    """

    def __init__(
        self, what: str, total: int, share: int, is_priority: Callable[[Connection], bool]
    ) -> None:
        self._what = what
        self._total = total
        self._share = share
        self._is_priority = is_priority
        self._held: Counter[Connection] = Counter()

    def reserve(self, connection: Connection, count: int = 1) -> None:
        """Reserve more for a connection, or release (negative).

        Raises:
            MalError: TOO_MANY; the text names the bound.
        """
        wanted = self._held[connection] + count
        if count > 0 and wanted > self._share:
            raise too_many(f"at most {self._share} {self._what} over one connection")
        while count > 0 and self._held.total() + count > self._total:
            self._take_from_others(connection, wanted)
        self._held[connection] = wanted
        if wanted <= 0:
            del self._held[connection]

    def release(self, connection: Connection) -> None:
        """Release everything of a closed connection."""
        self._held.pop(connection, None)

    def _take_from_others(self, connection: Connection, wanted: int) -> None:
        others = [c for c in self._held if c is not connection and not self._is_priority(c)]
        holder = max(others, key=self._held.__getitem__, default=None)
        if holder is None or (self._held[holder] <= wanted and not self._is_priority(connection)):
            raise too_many(f"at most {self._total} {self._what} over all connections together")
        held = self._held.pop(holder)
        holder.abort(f"it has {held} of {self._total} {self._what}, and others need some")


class LimitedLog:
    """Log of peers' errors: `maximum` records of a kind in `period_s`, then a count."""

    def __init__(
        self, warn: Callable[..., None], maximum: int = 10, period_s: float = 10.0
    ) -> None:
        self._warn = warn
        self._max_records = maximum
        self._period_s = period_s
        self._counts: dict[str, int] = {}
        self._began_s = 0.0

    def warn(self, text: str, *arguments: object) -> None:
        """Log a record, or count it beyond `most` of the same text."""
        self.flush()
        count = self._counts[text] = self._counts.get(text, 0) + 1
        if count <= self._max_records:
            self._warn(text, *arguments)

    def flush(self) -> None:
        """Log the number of omitted records, once a period."""
        now_s = asyncio.get_running_loop().time()
        if now_s - self._began_s < self._period_s:
            return
        for text, count in self._counts.items():
            if count > self._max_records:
                self._warn("%d more in %g s: " + text.replace("%", "%%"), count - self._max_records,
                           now_s - self._began_s)  # fmt: skip
        self._counts.clear()
        self._began_s = now_s


_CONNECTIONS_A_VICTIM: Final = 32
_KNOWN: Final = 16
"""Maximum message count that matters in the choice of a victim; chosen, not measured."""
_RECEIVE_BUFFER_OCTETS: Final = 64 << 10
"""Receive buffer of a consumer under load, in octets."""
_NO_SUCH_ADDRESS: Final = (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT)
_RETRY_S: Final = 0.1
"""Pause after a failed accept."""
_SWEEP_S: Final = 1.0
"""Maximum period of the check for stalled connections."""
_TRIM_THRESHOLD_OCTETS: Final = 4 << 20
"""Freed octets after which memory is returned to the operating system; chosen, not measured."""


class Connections(ConnectionGuard):
    """All connections and listening sockets of a provider.

    At the limit, a connection of the peer with the maximum number is aborted: first those with
    no or few messages, then the one without a message for the longest time.

    `on_refused` is called with the header of a message that exceeds a bound, and the error.

    Attributes:
        is_priority: Whether a connection has priority and must not be aborted; set by the owner.
    """

    def __init__(
        self,
        limits: PeerLimits,
        on_message: OnMessage,
        on_refused: Callable[[Connection, Header, MalError], None],
        on_lost: Callable[[Connection], None],
        warn: Callable[..., None],
        system: System,
    ) -> None:
        super().__init__(limits.message_octets, _RECEIVE_BUFFER_OCTETS)
        self.is_priority: Callable[[Connection], bool] = lambda _: False
        self._limits = limits
        self._on_message = on_message
        self._on_refused = on_refused
        self._on_lost = on_lost
        self._system = system
        self._log = LimitedLog(warn)
        self._unfinished = self.quota(
            "octets of unfinished messages", limits.unfinished_octets, limits.message_octets
        )
        self._hosts: dict[Connection, str] = {}
        self._open: dict[Connection, float] = {}
        self._handshakes: dict[Connection, asyncio.Task[None]] = {}
        self._listeners: list[Socket] = []
        self._tasks: list[asyncio.Task[None]] = []
        self._tls: ssl.SSLContext | None = None
        self._released = 0
        import resource  # Windows has none, and the ground's clients import this package

        descriptors, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        unbounded = descriptors == resource.RLIM_INFINITY
        self._max_connections = (
            limits.connections if unbounded else min(limits.connections, descriptors // 2)
        )

    def quota(self, what: str, total: int, share: int) -> Quota:
        """Return a new bound on a resource of the connections."""
        return Quota(what, total, share, lambda connection: self.is_priority(connection))

    async def listen(self, host: str, port: int, tls: ssl.SSLContext | None) -> int:
        """Accept connections from now on, and return the port.

        Raises:
            OSError: The address is not available.
        """
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        self._tls = tls
        for family, _, _, _, address in dict.fromkeys(found):
            try:
                listener = self._system.listen((str(address[0]), port), family)
            except OSError as fault:
                if fault.errno in _NO_SUCH_ADDRESS and len(found) > 1:
                    continue
                await self.stop()
                raise
            self._listeners.append(listener)
            port = listener.getsockname()[1]
        if not self._listeners:
            raise OSError(errno.EADDRNOTAVAIL, f"{host} is no address of this host")
        self._tasks = [loop.create_task(self._accept(each)) for each in self._listeners]
        self._tasks.append(loop.create_task(self._sweep()))
        return port

    async def stop(self) -> None:
        """Stop accepting connections."""
        tasks = (*self._tasks, *self._handshakes.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for listener in self._listeners:
            listener.close()

    async def close(self) -> None:
        """Close all connections."""
        await asyncio.gather(*(connection.close() for connection in self._open))

    def on_opened(self, connection: Connection) -> None:
        """Called by a connection that is ready for use."""
        self._open[connection] = asyncio.get_running_loop().time()
        self.traffic.connections += 1
        connection.lost.add_done_callback(lambda _: self._forget(connection))

    def reserve(self, connection: Connection, octets: int) -> None:
        """Called by a connection that reserves or releases memory for a long message."""
        self._unfinished.reserve(connection, octets)
        self._released += max(-octets, 0)

    def on_refused(self, connection: Connection, header: Header, error: MalError) -> None:
        """Called by a connection that receives a message beyond a bound."""
        self._on_refused(connection, header, error)

    def warn(self, text: str, *arguments: object) -> None:
        """Log an error of a peer, limited in rate."""
        self._log.warn(text, *arguments)

    async def _accept(self, listener: Socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, address = await loop.sock_accept(listener)
            except OSError as fault:
                self.warn("cannot accept a connection: %s", fault.strerror)
                self._evict()
                await asyncio.sleep(_RETRY_S)
                continue
            if len(self._hosts) >= self._max_connections and not self._evict():
                accepted.close()
                continue
            connection = Connection(self._on_message, self)
            self._hosts[connection] = address[0]
            self._handshakes[connection] = loop.create_task(self._begin(connection, accepted))
            await asyncio.sleep(0)

    async def _begin(self, connection: Connection, taken: Socket) -> None:
        patience_s = None if self._tls is None else self._limits.handshake_s
        try:
            await asyncio.get_running_loop().connect_accepted_socket(
                lambda: connection, taken, ssl=self._tls, ssl_handshake_timeout=patience_s
            )
        except OSError as fault:
            self.warn("no connection with %s: %s", self._hosts.get(connection), fault)
        finally:
            del self._handshakes[connection]
            if connection not in self._open:
                self._hosts.pop(connection, None)
                taken.close()

    def _evict(self) -> bool:
        """Abort connections; return whether one could be aborted.

        With many connections several are aborted at once, since repeated connection attempts would
        otherwise sort all of them each time.
        """
        candidates = [connection for connection in self._hosts if not self.is_priority(connection)]
        if not candidates:
            self.warn("a connection is refused: all %d have priority", len(self._hosts))
            return False
        crowd = Counter(map(self._peer, candidates))
        for victim in nsmallest(
            max(1, self._max_connections // _CONNECTIONS_A_VICTIM),
            candidates,
            key=lambda c: (
                -crowd[self._peer(c)],
                min(c.messages_received, _KNOWN),
                c.last_received_s,
            ),
        ):
            del self._hosts[victim]
            if victim in self._handshakes:
                self._handshakes[victim].cancel()
            victim.abort(
                f"{self._max_connections} connections are open, and another peer needs one"
            )
        return True

    def _peer(self, connection: Connection) -> str:
        return connection.peer_name or self._hosts[connection]

    def _forget(self, connection: Connection) -> None:
        self._hosts.pop(connection, None)
        self._open.pop(connection, None)
        self.traffic.connections -= 1
        self._released += _RECEIVE_BUFFER_OCTETS
        self._unfinished.release(connection)
        self._on_lost(connection)

    async def _sweep(self) -> None:
        """Abort stalled connections, and return freed memory to the system."""
        loop, limits = asyncio.get_running_loop(), self._limits
        while True:
            await asyncio.sleep(min(_SWEEP_S, limits.silence_s, limits.stall_s))
            self._log.flush()
            now_s = loop.time()
            for connection, opened_s in list(self._open.items()):
                if not connection.messages_received and now_s - opened_s > limits.silence_s:
                    connection.abort(f"no message within {limits.silence_s:g} s")
                elif connection.waits_for_more and now_s - connection.arrived_s > limits.stall_s:
                    connection.abort(f"a message is incomplete for {limits.stall_s:g} s")
            self._bound_unread()
            if self._released > _TRIM_THRESHOLD_OCTETS:
                self._released = 0
                _trim()

    def _bound_unread(self) -> None:
        unread = Counter({c: c.unread_octets for c in self._open if not self.is_priority(c)})
        for connection, octets in unread.most_common():
            if unread.total() <= self._limits.unread_octets:
                return
            del unread[connection]
            connection.abort(f"{octets} octets are unread, and other peers need the memory")


def _trim() -> None:
    """Return memory that the C library caches to the operating system."""
    with suppress(AttributeError):  # only glibc has it
        ctypes.CDLL(None).malloc_trim(0)
