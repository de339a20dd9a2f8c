"""The brick on USB (6.2): claimed by libusb through pyusb, and looked for again when it is gone.

Two threads, so that a brick that is slow or dead holds up nobody: one looks and listens, and for
as long as a brick is there another writes.
"""

import errno
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from queue import Empty, Full, Queue
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Final, Self

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
        except usb.core.USBError as error:
            self.close()
            raise BrickError(f"brick {address}: {_why_not_claimed(error)}") from error
        except BrickError:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

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
        usb.util.claim_interface(self._device, address.interface)
        configuration = self._device.get_active_configuration()
        there = {
            endpoint.bEndpointAddress
            for interface in configuration
            if interface.bInterfaceNumber == address.interface
            for endpoint in interface
        }
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
MOST_TIMEOUTS: Final = 10
"""A brick that takes nothing for so many writes in a row is taken for dead."""
_LOOK_S: Final = 0.1
_RESYNCHRONISE: Final = b"#"
_LOG: Final = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Heard:
    """Octets that the brick said."""

    octets: bytes


@dataclass(frozen=True, slots=True)
class Found:
    """A brick is there, for the so many-th time, from 1."""

    visit: int


@dataclass(frozen=True, slots=True)
class Lost:
    """The brick is gone, and with it what was on its way there."""

    why: str


SessionEvent = Heard | Found | Lost


@dataclass(slots=True)
class _Visit:
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
    """

    def __init__(self, claim: Callable[[], Brick], wake: Callable[[], None]) -> None:
        self._claim = claim
        self._wake = wake
        self._events: Queue[SessionEvent] = Queue(INCOMING)
        self._outgoing: Queue[bytes] = Queue(OUTGOING)
        self._connected = False
        self._visits = 0
        self._cut_short = False
        self._lock = Lock()
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

    def send(self, octets: bytes, visit: int | None = None) -> bool:
        """Have octets written. Never blocks.

        Args:
            octets: what is for the brick.
            visit: the time that it is there for which they are meant; None for whichever it is.

        Returns:
            False where no brick is, or not as meant, or too much waits.
        """
        with self._lock:
            if not self._connected or visit not in (None, self._visits):
                return False
            try:
                self._outgoing.put_nowait(octets)
            except Full:
                return False
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
                with self._claim() as brick:
                    said = ""
                    visit = _Visit(brick)
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

    def _serve(self, visit: _Visit) -> None:
        writer = Thread(target=self._until_over, args=(visit, self._write), name="nxt-write")
        _LOG.info("the brick is there")
        with self._lock:
            self._visits += 1
        self._put(Found(self._visits))
        with self._lock:
            self._connected = True
        writer.start()
        self._until_over(visit, self._read)
        with self._lock:
            self._connected = False
        writer.join()
        self._forget_what_waits()
        if visit.why:
            _LOG.warning("the brick is gone: %s; it is looked for again", visit.why[0])
            self._put(Lost(visit.why[0]))

    def _until_over(self, visit: _Visit, work: Callable[[_Visit], None]) -> None:
        try:
            work(visit)
        except BrickError as error:
            visit.why.append(str(error))
        except Exception as error:
            visit.why.append(repr(error))
            _LOG.error("a thread of the brick raised %r", error, exc_info=error)
        visit.over.set()

    def _read(self, visit: _Visit) -> None:
        while not (visit.over.is_set() or self._closing.is_set()):
            if octets := visit.brick.read():
                visit.spoke = True
                self._put(Heard(octets))

    def _write(self, visit: _Visit) -> None:
        if self._cut_short:
            self._write_whole(visit, _RESYNCHRONISE)
        while not visit.over.is_set():
            try:
                octets = self._outgoing.get(timeout=_LOOK_S)
            except Empty:
                continue
            self._write_whole(visit, octets)

    def _write_whole(self, visit: _Visit, octets: bytes) -> None:
        self._cut_short = True
        timeouts = 0
        while octets and not visit.over.is_set():
            taken = visit.brick.write(octets)
            octets = octets[taken:]
            timeouts = 0 if taken else timeouts + 1
            if timeouts >= MOST_TIMEOUTS:
                raise BrickError("it takes nothing any more")
        self._cut_short = bool(octets)

    def _forget_what_waits(self) -> None:
        """Drop commands that a brick did not get: come back, it is not to obey old ones."""
        while not self._outgoing.empty():
            self._outgoing.get_nowait()

    def _put(self, event: SessionEvent) -> None:
        while not self._closing.is_set():
            try:
                self._events.put(event, timeout=_LOOK_S)
            except Full:
                self._wake()
                continue
            self._wake()
            return
