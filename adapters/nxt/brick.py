"""The brick on USB, by libusb through pyusb: found, claimed, written, read, released (6.2)."""

import errno
from dataclasses import dataclass
from types import TracebackType
from typing import Final, Self

import usb.backend.libusb1
import usb.core
import usb.util
from usb.backend import IBackend

PACKET: Final = 64
"""Octets of the brick's packets, both ways."""
READ_MS: Final = 100
"""How long one read waits; who ends the session waits this long for it."""
WRITE_MS: Final = 200
"""How long one write waits for the brick to take a packet."""


class BrickError(Exception):
    """The brick cannot be had, or no longer; the text says why in words for people."""


class NoLibusbError(Exception):
    """libusb is not installed; the text says how to get it."""


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
        NoLibusbError: nothing does.
    """
    backend = usb.backend.libusb1.get_backend()
    if backend is None:
        raise NoLibusbError("libusb 1.0 is not here: apt install libusb-1.0-0")
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
            return "no permission; a udev rule gives it, see adapters/nxt/README.md"
        case _:
            return f"USB: {error.strerror}"
