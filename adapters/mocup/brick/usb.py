"""The brick on USB (6.2): claimed by libusb through pyusb, and looked for again when it is gone.

Two threads, so that a brick that is slow or dead holds up nobody: one looks and listens, and for
as long as a brick is there another writes.
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
"""Octets of the brick's packets, both ways."""
READ_MS: Final = 100
"""How long one read waits; who ends the session waits this long for it."""
WRITE_MS: Final = 200
"""How long one write waits for the brick to take a packet."""


class BrickError(Exception):
    """The brick cannot be had, or no longer; the text says why in words for people."""


@dataclass(frozen=True, slots=True)
class UsbAddress:
    """Where the brick is.

    Attributes:
        vendor_id, product_id: by which it is found.
        interface: what is claimed of it.
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
    """Return what speaks USB on this machine.

    Raises:
        StartError: nothing does; the text says how to get it.
    """
    backend = usb.backend.libusb1.get_backend()
    if backend is None:
        raise StartError("libusb 1.0 is not here: apt install libusb-1.0-0")
    return backend


class Brick:
    """One claimed brick. `read` and `write` may be called by two threads at once.

    Args:
        address: where it is.
        backend: what speaks USB.
    """

    def __init__(self, address: UsbAddress, backend: IBackend) -> None:
        """Find and claim it.

        Raises:
            BrickError: it is not there, or another program has it.
        """
        self._address = address
        try:
            found = usb.core.find(
                idVendor=address.vendor_id, idProduct=address.product_id, backend=backend
            )
        except usb.core.USBError as error:
            raise BrickError(f"USB cannot be looked through: {error.strerror}") from error
        if found is None:
            raise BrickError(f"no brick {address} is plugged in")
        self._device = found
        try:
            self._claim()
        except BrickError:
            self.close()
            raise

    def close(self) -> None:
        """Release it; also one that is gone."""
        usb.util.dispose_resources(self._device)

    def read(self) -> bytes:
        """Return what came in one packet, without the zeros that fill it up.

        Returns:
            Octets; none when no packet came for `READ_MS`.

        Raises:
            BrickError: the brick is gone.
        """
        endpoint = self._address.endpoint_in
        try:
            return bytes(self._device.read(endpoint, PACKET, READ_MS)).rstrip(b"\0")
        except usb.core.USBTimeoutError:
            return b""
        except usb.core.USBError as error:
            raise self._fault(endpoint, error) from error

    def write(self, octets: bytes) -> int:
        """Write one packet of octets.

        Returns:
            How many the brick has taken; 0 when it took none for `WRITE_MS`.

        Raises:
            BrickError: the brick is gone.
        """
        endpoint = self._address.endpoint_out
        try:
            return int(self._device.write(endpoint, octets[:PACKET], WRITE_MS))
        except usb.core.USBTimeoutError:
            return 0
        except usb.core.USBError as error:
            raise self._fault(endpoint, error) from error

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

    def _fault(self, endpoint: int, error: usb.core.USBError) -> BrickError:
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


FIRST_WAIT_S: Final = 0.2
LONGEST_WAIT_S: Final = 2.0
"""A brick that is plugged in is noticed at the latest after this."""
OUTGOING: Final = 32
INCOMING: Final = 256
KEEP_ALIVE_S: Final = 0.1
"""How often the brick is told that its host lives."""
OWNER_SILENT_S: Final = 1.0
"""A session whose owner was silent for so long no longer keeps the brick alive."""
MOST_TIMEOUTS: Final = 10
"""A brick that takes nothing for so many writes in a row is taken for dead."""
_LOOK_S: Final = 0.1
_RESYNCHRONISE: Final = b"#"
_LOG: Final = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class OctetsReceived:
    """Octets that the brick said."""

    octets: bytes


@dataclass(frozen=True, slots=True)
class BrickConnected:
    """A brick is there, for the so many-th time, from 1."""

    visit: int


@dataclass(frozen=True, slots=True)
class BrickDisconnected:
    """The brick is gone, and with it what was on its way there."""

    why: str


SessionEvent = OctetsReceived | BrickConnected | BrickDisconnected


@dataclass(slots=True)
class _Connection:
    """One time that a brick is there.

    Attributes:
        over: set when the brick is to be left, by either thread.
        why: what ended it, first things first; empty when the session ended.
        spoke: whether the brick said anything.
    """

    brick: Brick
    over: Event = field(default_factory=Event)
    why: list[str] = field(default_factory=list)
    spoke: bool = False


class BrickSession:
    """A brick that may come and go.

    What it says waits for `events` in a bounded queue: when nobody takes it, the brick is no longer
    read, and USB holds it back.

    Args:
        claim: finds and claims the brick.
        wake: called on a thread of the session when an event waits.
        keep_alive: what the brick is told every `KEEP_ALIVE_S` while the owner lives.
    """

    def __init__(
        self, claim: Callable[[], Brick], wake: Callable[[], None], keep_alive: bytes = b""
    ) -> None:
        self._claim = claim
        self._wake = wake
        self._keep_alive = keep_alive
        self._alive_until_s = monotonic() + OWNER_SILENT_S
        self._events: Queue[SessionEvent] = Queue(INCOMING)
        self._stops: deque[bytes] = deque()
        self._outgoing: deque[bytes] = deque()
        self._connected = False
        self._visits = 0
        self._cut_short = False
        self._changed = Condition()
        self._closing = Event()
        self._thread = Thread(target=self._run, name="nxt-read")

    def start(self) -> None:
        """Begin to look for the brick."""
        self._thread.start()

    def close(self) -> None:
        """Release the brick and end the threads."""
        self._closing.set()
        self._thread.join()

    @property
    def connected(self) -> bool:
        """Whether a brick is there."""
        return self._connected

    def alive(self) -> None:
        """Take note that the owner lives; call it more often than every `OWNER_SILENT_S`."""
        self._alive_until_s = monotonic() + OWNER_SILENT_S

    def send(self, octets: bytes, visit: int) -> bool:
        """Have a message written after what waits. Never blocks.

        Args:
            octets: what is for the brick.
            visit: the time that it is there for which they are meant.

        Returns:
            False where no brick is, or not as meant, or too much waits.
        """
        with self._changed:
            there = self._connected and visit == self._visits
            if there and len(self._outgoing) < OUTGOING:
                self._outgoing.append(octets)
                self._changed.notify()
                return True
        return False

    def stop(self, octets: bytes) -> bool:
        """Have a stop written at once, and nothing that waits. Never blocks.

        A message that is being written is cut off.

        Returns:
            False where no brick is, or too many stops wait.
        """
        with self._changed:
            if not self._connected or len(self._stops) >= OUTGOING:
                return False
            self._outgoing.clear()
            self._stops.append(octets)
            self._changed.notify()
            return True

    def events(self) -> list[SessionEvent]:
        """Take what happened since. Never blocks."""
        taken: list[SessionEvent] = []
        while len(taken) < INCOMING:
            try:
                taken.append(self._events.get_nowait())
            except Empty:
                break
        return taken

    def _run(self) -> None:
        wait_s, said = FIRST_WAIT_S, ""
        while not self._closing.is_set():
            try:
                with closing(self._claim()) as brick:
                    said = ""
                    visit = _Connection(brick)
                    self._serve(visit)
                    if visit.spoke:
                        wait_s = FIRST_WAIT_S
            except BrickError as error:
                if str(error) != said:
                    said = str(error)
                    _LOG.warning("%s; it is looked for again", said)
            except Exception as error:
                _LOG.error("looking for the brick raised %r", error, exc_info=error)
            self._closing.wait(wait_s)
            wait_s = min(2 * wait_s, LONGEST_WAIT_S)

    def _serve(self, visit: _Connection) -> None:
        writer = Thread(target=self._until_over, args=(visit, self._write), name="nxt-write")
        _LOG.info("the brick is there")
        with self._changed:
            self._visits += 1
        self._put(BrickConnected(self._visits))
        with self._changed:
            self._connected = True
        writer.start()
        self._until_over(visit, self._read)
        with self._changed:
            self._connected = False
            # Come back, the brick is not to obey old commands.
            self._stops.clear()
            self._outgoing.clear()
        writer.join()
        if visit.why:
            _LOG.warning("the brick is gone: %s; it is looked for again", visit.why[0])
            self._put(BrickDisconnected(visit.why[0]))

    def _until_over(self, visit: _Connection, work: Callable[[_Connection], None]) -> None:
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
                self._changed.wait_for(lambda: self._stops or self._outgoing, _LOOK_S)
                stops = bool(self._stops)
                waiting = self._stops or self._outgoing
                octets = waiting.popleft() if waiting else b""
            self._write_whole(visit, octets, stops)

    def _write_whole(self, visit: _Connection, octets: bytes, is_stop: bool = False) -> None:
        """Write a message, unless it is cut off by a stop; the next ends what was cut off."""
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
            if timeouts >= MOST_TIMEOUTS:
                raise BrickError("it takes nothing any more")
        if not octets:
            self._cut_short = False

    def _put(self, event: SessionEvent) -> None:
        while not self._closing.is_set():
            try:
                self._events.put(event, timeout=_LOOK_S)
            except Full:
                self._wake()
                continue
            self._wake()
            return
