"""`BrickSession`: the brick on USB (thesis 6.2), by libusb and pyusb; reconnects after a loss.

There are two threads, so that a slow or dead brick blocks no other thread: one searches and
reads; while a brick is connected, the other writes.
"""

import errno
import logging
from collections import deque
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from math import inf
from queue import Empty, Full, Queue
from threading import Condition, Event, Thread
from time import monotonic
from typing import Final

import usb.backend.libusb1
import usb.core
import usb.util
from usb.backend import IBackend

from adapters.process import StartError

PACKET: Final = 64
"""Size of the brick's packets in octets, in both directions."""
READ_MS: Final = 100
"""Timeout of one read in ms; maximum delay of closing the session."""
WRITE_MS: Final = 200
"""Timeout of one write in ms, for the brick to accept a packet."""


class BrickError(Exception):
    """The brick is not available, or no longer; the text gives the cause for operators."""


@dataclass(frozen=True, slots=True)
class UsbAddress:
    """USB address of the brick.

    Attributes:
        vendor_id, product_id: identify it.
        interface: number of the claimed interface.
        endpoint_out, endpoint_in: addresses of its bulk endpoints.
    """

    vendor_id: int
    product_id: int
    interface: int
    endpoint_out: int
    endpoint_in: int

    def __str__(self) -> str:
        return f"{self.vendor_id:04x}:{self.product_id:04x}"


def libusb() -> IBackend:
    """Return the USB backend of this machine.

    Raises:
        StartError: there is none; the text gives the package to install.
    """
    backend = usb.backend.libusb1.get_backend()
    if backend is None:
        raise StartError("libusb 1.0 is not installed: apt install libusb-1.0-0")
    return backend


class Brick:
    """One claimed brick. `read` and `write` may be called by two threads at once."""

    def __init__(self, address: UsbAddress, backend: IBackend) -> None:
        """Find and claim it.

        Raises:
            BrickError: it is not connected, or another program has claimed it.
        """
        self._address = address
        try:
            found = usb.core.find(
                idVendor=address.vendor_id, idProduct=address.product_id, backend=backend
            )
        except usb.core.USBError as error:
            raise BrickError(f"USB cannot be searched: {error.strerror}") from error
        if found is None:
            raise BrickError(f"no brick {address} is plugged in")
        self._device = found
        try:
            self._claim()
        except BrickError:
            self.close()
            raise

    def close(self) -> None:
        """Release it; also valid after a disconnect."""
        usb.util.dispose_resources(self._device)

    def read(self) -> bytes:
        """Return the content of one packet, without its padding of zeros.

        Returns:
            Octets; empty if no packet arrived within `READ_MS`.

        Raises:
            BrickError: the brick is disconnected.
        """
        endpoint = self._address.endpoint_in
        try:
            return bytes(self._device.read(endpoint, PACKET, READ_MS)).rstrip(b"\0")
        except usb.core.USBTimeoutError:
            return b""
        except usb.core.USBError as error:
            raise self._usb_error(endpoint, error) from error

    def write(self, octets: bytes) -> int:
        """Write one packet of octets.

        Returns:
            Number of octets accepted; 0 if none were within `WRITE_MS`.

        Raises:
            BrickError: the brick is disconnected.
        """
        endpoint = self._address.endpoint_out
        try:
            return int(self._device.write(endpoint, octets[:PACKET], WRITE_MS))
        except usb.core.USBTimeoutError:
            return 0
        except usb.core.USBError as error:
            raise self._usb_error(endpoint, error) from error

    def _claim(self) -> None:
        address = self._address
        try:
            usb.util.claim_interface(self._device, address.interface)
            there = {
                endpoint.bEndpointAddress
                for interface in self._device.get_active_configuration()
                if interface.bInterfaceNumber == address.interface
                for endpoint in interface
            }
        except usb.core.USBError as error:
            raise BrickError(f"brick {address}: {_why_not_claimed(error)}") from error
        for endpoint in (address.endpoint_out, address.endpoint_in):
            if endpoint not in there:
                where = f"interface {address.interface} of brick {address}"
                raise BrickError(f"{where} has no endpoint {endpoint:#04x}")

    def _usb_error(self, endpoint: int, error: usb.core.USBError) -> BrickError:
        if error.errno == errno.EPIPE:
            try:
                self._device.clear_halt(endpoint)
            except usb.core.USBError as worse:
                error = worse
        return BrickError(f"USB: {error.strerror}")


def _why_not_claimed(error: usb.core.USBError) -> str:
    match error.errno:
        case errno.EBUSY:
            return "another program has claimed it"
        case errno.EACCES:
            return "no permission; a udev rule gives it, see adapters/mocup/brick/README.md"
        case _:
            return f"USB: {error.strerror}"


MIN_RETRY_S: Final = 0.2
MAX_RETRY_S: Final = 2.0
"""Maximum pause between two searches for the brick."""
OUTGOING: Final = 32
INCOMING: Final = 256
KEEP_ALIVE_S: Final = 0.1
"""Period of the heartbeat to the brick."""
OWNER_TIMEOUT_S: Final = 1.0
"""Timeout of the session's owner; after it the brick receives no heartbeats."""
MAX_TIMEOUTS: Final = 10
"""Consecutive write timeouts after which the brick is treated as dead: 2 s in total."""
_POLL_S: Final = 0.1
_RESYNCHRONISE: Final = b"#"
_LOG: Final = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class OctetsReceived:
    """Octets received from the brick."""

    octets: bytes


@dataclass(frozen=True, slots=True)
class BrickConnected:
    """The brick is connected; `connection_number` numbers the connections from 1."""

    connection_number: int


@dataclass(frozen=True, slots=True)
class BrickDisconnected:
    """The brick is disconnected; queued messages are dropped."""

    reason: str


SessionEvent = OctetsReceived | BrickConnected | BrickDisconnected


@dataclass(slots=True)
class _Connection:
    """One connection to the brick.

    Attributes:
        over: set by either thread to end the connection.
        why: causes of its end, first one first; empty when the session ended.
        spoke: whether any octets were received.
    """

    brick: Brick
    over: Event = field(default_factory=Event)
    why: list[str] = field(default_factory=list)
    spoke: bool = False


class BrickSession:
    """A session with a brick that may disconnect and reconnect.

    Received octets wait for `events` in a bounded queue. While it is full, the brick is not read,
    and USB blocks it.

    Args:
        wake: called on a thread of the session when an event is queued.
        keep_alive: heartbeat sent to the brick every `KEEP_ALIVE_S` while the owner is alive.
    """

    def __init__(
        self, claim: Callable[[], Brick], wake: Callable[[], None], keep_alive: bytes = b""
    ) -> None:
        self._claim = claim
        self._wake = wake
        self._keep_alive = keep_alive
        self._alive_until_s = monotonic() + OWNER_TIMEOUT_S
        self._events: Queue[SessionEvent] = Queue(INCOMING)
        self._stops: deque[tuple[int, bytes]] = deque()
        self._outgoing: deque[tuple[int, bytes]] = deque()
        self._connected = False
        self._visits = self._durable = 0
        self._cut_short = False
        self._changed = Condition()
        self._closing = Event()
        self._thread = Thread(target=self._run, name="nxt-read")

    def start(self) -> None:
        """Start to search for the brick."""
        self._thread.start()

    def close(self) -> None:
        """Release the brick and end the threads."""
        self._closing.set()
        self._thread.join()

    @property
    def connected(self) -> bool:
        """Whether a brick is connected."""
        return self._connected

    def feed_watchdog(self) -> None:
        """Reset the owner's watchdog; call it more often than every `OWNER_TIMEOUT_S`."""
        self._alive_until_s = monotonic() + OWNER_TIMEOUT_S

    def send(self, octets: bytes, visit: int, commit: int = 0) -> bool:
        """Queue a message for the brick. Never blocks.

        Args:
            octets: the message.
            visit: number of the connection that it is meant for.
            commit: it is written once this commit was released.

        Returns:
            False if no brick is connected, the connection is another one, or the queue is full.
        """
        with self._changed:
            there = self._connected and visit == self._visits
            if there and len(self._outgoing) < OUTGOING:
                self._outgoing.append((commit, octets))
                self._changed.notify()
                return True
        return False

    def stop(self, octets: bytes) -> bool:
        """Send a stop at once and drop all queued messages. Never blocks.

        A message that is being written is cut off.

        Returns:
            False if no brick is connected, or too many stops are queued.
        """
        with self._changed:
            if not self._connected or len(self._stops) >= OUTGOING:
                return False
            self._outgoing.clear()
            self._stops.append((0, octets))
            self._changed.notify()
            return True

    def release(self, commit: int) -> None:
        """Release the messages that wait for commits up to this one."""
        with self._changed:
            self._durable = commit
            self._changed.notify()

    def events(self) -> list[SessionEvent]:
        """Remove and return the events since the last call. Never blocks."""
        taken: list[SessionEvent] = []
        while len(taken) < INCOMING:
            try:
                taken.append(self._events.get_nowait())
            except Empty:
                break
        return taken

    def _run(self) -> None:
        wait_s, logged = MIN_RETRY_S, ""
        while not self._closing.is_set():
            try:
                with closing(self._claim()) as brick:
                    logged = ""
                    visit = _Connection(brick)
                    self._serve(visit)
                    if visit.spoke:
                        wait_s = MIN_RETRY_S
            except BrickError as error:
                if str(error) != logged:
                    logged = str(error)
                    _LOG.warning("%s; searching for it again", logged)
            except Exception as error:
                _LOG.error("searching for the brick raised %r", error, exc_info=error)
            self._closing.wait(wait_s)
            wait_s = min(2 * wait_s, MAX_RETRY_S)

    def _serve(self, visit: _Connection) -> None:
        writer = Thread(target=self._run_thread, args=(visit, self._write), name="nxt-write")
        _LOG.info("brick connected")
        with self._changed:
            self._visits += 1
        self._put(BrickConnected(self._visits))
        with self._changed:
            self._connected = True
        writer.start()
        self._run_thread(visit, self._read)
        with self._changed:
            self._connected = False
            # After a reconnect the brick must not execute old commands.
            self._stops.clear()
            self._outgoing.clear()
        writer.join()
        if visit.why:
            _LOG.warning("brick disconnected: %s; searching for it again", visit.why[0])
            self._put(BrickDisconnected(visit.why[0]))

    def _run_thread(self, visit: _Connection, work: Callable[[_Connection], None]) -> None:
        try:
            work(visit)
        except BrickError as error:
            visit.why.append(str(error))
        except Exception as error:
            visit.why.append(repr(error))
            _LOG.error("a thread of the brick raised %r", error, exc_info=error)
        visit.over.set()

    def _read(self, visit: _Connection) -> None:
        while not (visit.over.is_set() or self._closing.is_set()):
            if octets := visit.brick.read():
                visit.spoke = True
                self._put(OctetsReceived(octets))

    def _write(self, visit: _Connection) -> None:
        kept_alive_s = -inf
        while not visit.over.is_set():
            now_s = monotonic()
            if now_s - kept_alive_s >= KEEP_ALIVE_S and now_s < self._alive_until_s:
                kept_alive_s = now_s
                self._write_whole(visit, self._keep_alive)
            with self._changed:
                waiting = self._changed.wait_for(self._next, _POLL_S)
                stops = bool(self._stops)
                octets = waiting.popleft()[1] if waiting else b""
            self._write_whole(visit, octets, stops)

    def _next(self) -> deque[tuple[int, bytes]] | None:
        waiting = self._stops or self._outgoing
        return waiting if waiting and waiting[0][0] <= self._durable else None

    def _write_whole(self, visit: _Connection, octets: bytes, is_stop: bool = False) -> None:
        """Write a message unless a stop cuts it off; the next message then starts with `#`."""
        if not octets:
            return
        if self._cut_short:
            octets = _RESYNCHRONISE + octets
        timeouts = 0
        while octets and not visit.over.is_set() and (is_stop or not self._stops):
            self._cut_short = True
            taken = visit.brick.write(octets)
            octets = octets[taken:]
            timeouts = 0 if taken else timeouts + 1
            if timeouts >= MAX_TIMEOUTS:
                raise BrickError("it accepts no data")
        if not octets:
            self._cut_short = False

    def _put(self, event: SessionEvent) -> None:
        while not self._closing.is_set():
            try:
                self._events.put(event, timeout=_POLL_S)
            except Full:
                self._wake()
                continue
            self._wake()
            return
