"""Runs `rover-nxt` with an emulated brick: `python -m sim.brick.nxt --usb-socket PATH`.

The host's end of the cable is a backend of pyusb whose bus has one brick, or none.
"""

import errno
import os
import select
import socket
from array import array
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import click
from usb.backend import IBackend
from usb.core import USBError, USBTimeoutError

from adapters.mocup.brick.process import brick_options, serve_brick
from adapters.process import process
from sim.brick.plug import CLAIMED, PACKET

CLAIM_MS: Final = 1000
VENDOR: Final = 0x0694
PRODUCT: Final = 0x0002
OUT: Final = 0x01
IN: Final = 0x82
_ENDPOINTS: Final = (OUT, IN)
_BULK: Final = 2

_DEVICE: Final = {
    **{"bLength": 18, "bDescriptorType": 1, "bcdUSB": 0x0200, "bMaxPacketSize0": 8},
    **{"idVendor": VENDOR, "idProduct": PRODUCT, "bcdDevice": 0, "bNumConfigurations": 1},
    **dict.fromkeys(("bDeviceClass", "bDeviceSubClass", "bDeviceProtocol"), 0),
    **dict.fromkeys(("iManufacturer", "iProduct", "iSerialNumber"), 0),
    **{"address": 1, "bus": 1, "port_number": None, "port_numbers": None, "speed": None},
}
_CONFIGURATION: Final = {
    **{"bLength": 9, "bDescriptorType": 2, "wTotalLength": 32, "bNumInterfaces": 1},
    **{"bConfigurationValue": 1, "iConfiguration": 0, "bmAttributes": 0xC0, "bMaxPower": 0},
    "extra_descriptors": [],
}
_INTERFACE: Final = {
    **{"bLength": 9, "bDescriptorType": 4, "bInterfaceNumber": 0, "bAlternateSetting": 0},
    **{"bNumEndpoints": len(_ENDPOINTS), "iInterface": 0, "extra_descriptors": []},
    **dict.fromkeys(("bInterfaceClass", "bInterfaceSubClass", "bInterfaceProtocol"), 0xFF),
}
_ENDPOINT: Final = {
    **{"bLength": 7, "bDescriptorType": 5, "bmAttributes": _BULK, "wMaxPacketSize": PACKET},
    **{"bInterval": 0, "bRefresh": 0, "bSynchAddress": 0, "extra_descriptors": []},
}


class SocketBackend(IBackend):  # type: ignore[misc]  # pyusb ships no types
    """A USB bus with the brick of a socket, connected while the socket exists."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def enumerate_devices(self) -> Iterator[Path]:
        """Yield the brick, if it is connected."""
        if self._path.exists():
            yield self._path

    def get_device_descriptor(self, dev: Path) -> SimpleNamespace:
        """Return the descriptor of LEGO's NXT."""
        return SimpleNamespace(**_DEVICE)

    def get_configuration_descriptor(self, dev: Path, config: int) -> SimpleNamespace:
        """Return the only configuration."""
        _require_first(config)
        return SimpleNamespace(**_CONFIGURATION)

    def get_interface_descriptor(
        self, dev: Path, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        """Return the only interface."""
        _require_first(intf, alt, config)
        return SimpleNamespace(**_INTERFACE)

    def get_endpoint_descriptor(
        self, dev: Path, ep: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        """Return one of the two endpoints."""
        return SimpleNamespace(**_ENDPOINT, bEndpointAddress=_ENDPOINTS[ep])

    def open_device(self, dev: Path) -> socket.socket:
        """Connect to the brick."""
        host = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            host.connect(str(dev))
        except OSError as error:
            host.close()
            raise _usb_error(errno.ENODEV) from error
        host.setblocking(False)
        return host

    def close_device(self, dev_handle: socket.socket) -> None:
        """Disconnect."""
        dev_handle.close()

    def get_configuration(self, dev_handle: socket.socket) -> int:
        """Return the only configuration's value."""
        return 1

    def claim_interface(self, dev_handle: socket.socket, intf: int) -> None:
        """Wait until the brick confirms the claim."""
        _require_first(intf)
        try:
            claimed = _receive(dev_handle, CLAIM_MS) == CLAIMED
        except USBError as error:
            raise _usb_error(errno.EBUSY) from error
        if not claimed:
            raise _usb_error(errno.EIO)

    def release_interface(self, dev_handle: socket.socket, intf: int) -> None:
        """Ignore the call: closing the device releases it."""

    def bulk_write(
        self, dev_handle: socket.socket, ep: int, intf: int, data: "array[int]", timeout: int
    ) -> int:
        """Write one packet."""
        _wait(dev_handle, select.POLLOUT, timeout)
        try:
            return dev_handle.send(data.tobytes()[:PACKET])
        except OSError as error:
            raise _usb_error(errno.ENODEV) from error

    def bulk_read(
        self, dev_handle: socket.socket, ep: int, intf: int, buff: "array[int]", timeout: int
    ) -> int:
        """Read one packet."""
        packet = _receive(dev_handle, timeout)
        buff[: len(packet)] = array("B", packet)
        return len(packet)

    def clear_halt(self, dev_handle: socket.socket, ep: int) -> None:
        """Ignore the call: this bus does not stall."""


def _receive(host: socket.socket, timeout_ms: int) -> bytes:
    _wait(host, select.POLLIN, timeout_ms)
    try:
        packet = host.recv(PACKET)
    except OSError as error:
        raise _usb_error(errno.ENODEV) from error
    if not packet:
        raise _usb_error(errno.ENODEV)
    return packet


def _wait(host: socket.socket, what: int, timeout_ms: int) -> None:
    poll = select.poll()
    poll.register(host, what)
    if not poll.poll(timeout_ms):
        raise USBTimeoutError(os.strerror(errno.ETIMEDOUT), errno=errno.ETIMEDOUT)


def _usb_error(number: int) -> USBError:
    return USBError(os.strerror(number), errno=number)


def _require_first(*indices: int) -> None:
    if any(indices):
        raise IndexError(indices)


@process("python -m sim.brick.nxt")
@click.option(
    "--usb-socket",
    type=click.Path(path_type=Path),
    required=True,
    metavar="PATH",
    help="Socket of the brick.",
)
@brick_options
def main(ros_arguments: tuple[str, ...], usb_socket: Path, **options: Any) -> None:
    """Run rover-nxt on the bus of a socket."""
    serve_brick(SocketBackend(usb_socket), ros_arguments, **options)


if __name__ == "__main__":
    main()
