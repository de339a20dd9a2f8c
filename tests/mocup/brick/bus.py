"""A USB bus in the test, behind pyusb's own backend interface, on which everything can go wrong."""

import errno
import os
from array import array
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from threading import Condition

from usb.core import USBError, USBTimeoutError

from adapters.mocup.brick.usb import UsbAddress
from sim.brick.nxt import IN, OUT, PRODUCT, VENDOR, SocketBackend

ADDRESS = UsbAddress(VENDOR, PRODUCT, 0, OUT, IN)
TIMEOUT = errno.ETIMEDOUT


def fault(number: int) -> USBError:
    kind = USBTimeoutError if number == TIMEOUT else USBError
    return kind(os.strerror(number), errno=number)


class Bus(SocketBackend):
    """Has one brick of LEGO's, or none.

    Attributes:
        plugged: whether the brick is there.
        refuses: errno of every claim; 0 claims.
        packets: what reads find, in order: octets, or the errno of a fault; afterwards they wait.
        faults: errnos of the next writes, 0 for one that succeeds.
        max_accepted: octets that a write takes at most.
        written: what the brick took, packet by packet.
        claims, released, opened, closed, cleared: what was done to it.
    """

    def __init__(self) -> None:
        super().__init__(Path("nowhere"))
        self.plugged = True
        self.refuses = 0
        self.packets: deque[bytes | int] = deque()
        self.faults: deque[int] = deque()
        self.max_accepted = 64
        self.written: list[bytes] = []
        self.claims = 0
        self.released = 0
        self.opened = 0
        self.closed = 0
        self.cleared: list[int] = []
        self._changed = Condition()

    def sends(self, *packets: bytes | int) -> None:
        with self._changed:
            self.packets += packets
            self._changed.notify_all()

    def plug(self, plugged: bool) -> None:
        with self._changed:
            self.plugged = plugged
            self._changed.notify_all()

    def enumerate_devices(self) -> Iterator[Path]:
        if self.plugged:
            yield Path("brick")

    def open_device(self, dev: Path) -> object:  # type: ignore[override]
        self.opened += 1
        return object()

    def close_device(self, dev_handle: object) -> None:
        self.closed += 1

    def get_configuration(self, dev_handle: object) -> int:
        return 1

    def claim_interface(self, dev_handle: object, intf: int) -> None:
        if self.refuses:
            raise fault(self.refuses)
        self.claims += 1

    def release_interface(self, dev_handle: object, intf: int) -> None:
        self.released += 1
        if not self.plugged:
            raise fault(errno.ENODEV)

    def clear_halt(self, dev_handle: object, ep: int) -> None:
        self.cleared.append(ep)

    def bulk_write(
        self, dev_handle: object, ep: int, intf: int, data: "array[int]", timeout: int
    ) -> int:
        assert (ep, intf) == (OUT, 0)
        assert len(data) <= 64
        with self._changed:
            if not self.plugged:
                raise fault(errno.ENODEV)
            if self.faults and (number := self.faults.popleft()):
                raise fault(number)
            taken = data.tobytes()[: self.max_accepted]
            self.written.append(taken)
            return len(taken)

    def bulk_read(
        self, dev_handle: object, ep: int, intf: int, buff: "array[int]", timeout: int
    ) -> int:
        assert (ep, intf, len(buff)) == (IN, 0, 64)
        with self._changed:
            self._changed.wait_for(lambda: self.packets or not self.plugged, timeout / 1000)
            if not self.plugged:
                raise fault(errno.ENODEV)
            packet = self.packets.popleft() if self.packets else TIMEOUT
        if isinstance(packet, int):
            raise fault(packet)
        buff[: len(packet)] = array("B", packet)
        return len(packet)
