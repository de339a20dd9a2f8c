"""What pyusb needs to speak to the emulated brick: its backend interface over the cable's socket."""

import errno
import select
import socket
from array import array
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Final

from usb.backend import IBackend
from usb.core import USBError, USBTimeoutError

from sim.brick.usb_packets import PACKET, cable

VENDOR_ID: Final = 0x0694
PRODUCT_ID: Final = 0x0002
ENDPOINT_OUT: Final = 0x01
ENDPOINT_IN: Final = 0x82
_BULK: Final = 2
_VENDOR_CLASS: Final = 0xFF


class CableBackend(IBackend):  # type: ignore[misc]
    """USB with one port, in which an NXT is plugged while the simulation listens at a path.

    What `usb.backend.IBackend` says of each method holds; a device is its path, a handle a socket.
    """

    def __init__(self, path: Path) -> None:
        """Look at a path."""
        super().__init__()
        self._path = path

    def enumerate_devices(self) -> Iterator[Path]:
        """Yield the brick, if it is there."""
        if self._path.is_socket():
            yield self._path

    def get_device_descriptor(self, _: Path) -> SimpleNamespace:
        """Return what an NXT says of itself."""
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0200,
            bDeviceClass=0,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=8,
            idVendor=VENDOR_ID,
            idProduct=PRODUCT_ID,
            bcdDevice=0,
            iManufacturer=0,
            iProduct=0,
            iSerialNumber=0,
            bNumConfigurations=1,
            address=1,
            bus=1,
            port_number=1,
            port_numbers=(1,),
            speed=2,
        )

    def get_configuration_descriptor(self, _: Path, config: int) -> SimpleNamespace:
        """Return its one configuration."""
        _only(config, 1)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=32,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0xC0,
            bMaxPower=0,
            extra_descriptors=[],
        )

    def get_interface_descriptor(
        self, _: Path, interface: int, alternate: int, config: int
    ) -> SimpleNamespace:
        """Return its one interface."""
        _only(interface, 1)
        _only(alternate, 1)
        _only(config, 1)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=2,
            bInterfaceClass=_VENDOR_CLASS,
            bInterfaceSubClass=_VENDOR_CLASS,
            bInterfaceProtocol=_VENDOR_CLASS,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(
        self, _: Path, endpoint: int, interface: int, alternate: int, config: int
    ) -> SimpleNamespace:
        """Return one of its two bulk endpoints."""
        _only(endpoint, 2)
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=(ENDPOINT_OUT, ENDPOINT_IN)[endpoint],
            bmAttributes=_BULK,
            wMaxPacketSize=PACKET,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    def open_device(self, path: Path) -> socket.socket:
        """Plug the cable in."""
        end = cable()
        try:
            end.connect(str(path))
        except OSError as error:
            end.close()
            raise _gone() from error
        return end

    def close_device(self, end: socket.socket) -> None:
        """Pull the cable out."""
        end.close()

    def get_configuration(self, _: socket.socket) -> int:
        """Return the number of its one configuration."""
        return 1

    def set_configuration(self, _: socket.socket, __: int) -> None:
        """It has only one."""

    def claim_interface(self, _: socket.socket, __: int) -> None:
        """Nobody else is on this cable."""

    def release_interface(self, _: socket.socket, __: int) -> None:
        """It is let go with the cable."""

    def clear_halt(self, _: socket.socket, __: int) -> None:
        """It never halts an endpoint."""

    def bulk_write(
        self, end: socket.socket, _: int, __: int, octets: "array[int]", timeout_ms: int
    ) -> int:
        """Write one packet; return how many octets it took."""
        _wait(end, select.POLLOUT, timeout_ms)
        try:
            return end.send(octets.tobytes()[:PACKET], socket.MSG_DONTWAIT)
        except OSError as error:
            raise _gone() from error

    def bulk_read(
        self, end: socket.socket, _: int, __: int, into: "array[int]", timeout_ms: int
    ) -> int:
        """Read one packet into an array; return how many octets it had."""
        _wait(end, select.POLLIN, timeout_ms)
        try:
            octets = end.recv(PACKET, socket.MSG_DONTWAIT)
        except OSError as error:
            raise _gone() from error
        if not octets:
            raise _gone()
        into[: len(octets)] = array("B", octets)
        return len(octets)


def _wait(end: socket.socket, event: int, timeout_ms: int) -> None:
    if end.fileno() < 0:
        raise _gone()
    poll = select.poll()
    poll.register(end, event)
    if not poll.poll(timeout_ms):
        raise USBTimeoutError("Operation timed out", error_code=None, errno=errno.ETIMEDOUT)


def _gone() -> USBError:
    return USBError("No such device (it may have been disconnected)", errno=errno.ENODEV)


def _only(index: int, count: int) -> None:
    if not 0 <= index < count:
        raise IndexError(index)
