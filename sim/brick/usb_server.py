"""The brick's end of the cable. Never blocks: it is asked once a period."""

import logging
import socket
from pathlib import Path
from typing import Final

from sim.brick.usb_packets import PACKET, cable
from sim.mocup import SimulatedMocup

_LOG: Final = logging.getLogger(__name__)


class CableError(Exception):
    """The cable cannot be laid; the text says why."""


class BrickUsb:
    """Joins the brick of a simulated rover to one host at a time.

    Packets to the host are filled up with zeros. A brick that has too much to say takes no more
    packets until it is fetched; one that is unplugged gives up what it does.

    Args:
        rover: whose brick it is.
        path: where the host finds it.
    """

    def __init__(self, rover: SimulatedMocup, path: Path) -> None:
        """Wait for a host.

        Raises:
            CableError: the path is taken, or no socket can be made there.
        """
        self._rover = rover
        self._path = path
        self._host: socket.socket | None = None
        self._listener = cable()
        self._listener.setblocking(False)
        try:
            if path.is_socket() and not _answers(path):
                path.unlink()
            self._listener.bind(str(path))
            self._listener.listen(1)
        except OSError as error:
            self._listener.close()
            raise CableError(f"{path}: {error.strerror or error}") from error

    def close(self) -> None:
        """Pull the cable out, and leave nothing behind."""
        self._unplug()
        self._listener.close()
        self._path.unlink(missing_ok=True)

    def exchange(self) -> None:
        """Carry the packets that wait, both ways."""
        if self._host is None:
            self._rover.brick.give()
            self._plug_in()
        while self._host is not None and not self._rover.brick.full:
            if not self._receive(self._host):
                break
        while self._host is not None and (packet := self._rover.brick.peek(PACKET)):
            if not self._send(self._host, packet):
                break

    def _plug_in(self) -> None:
        try:
            self._host, _ = self._listener.accept()
        except BlockingIOError:
            return
        self._host.setblocking(False)
        _LOG.info("the brick is plugged in")

    def _unplug(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None
            self._rover.brick.unplug()
            _LOG.info("the brick is unplugged")

    def _receive(self, host: socket.socket) -> bool:
        try:
            packet = host.recv(PACKET)
        except BlockingIOError:
            return False
        except OSError:
            packet = b""
        if packet:
            self._rover.hear(packet)
        else:
            self._unplug()
        return bool(packet)

    def _send(self, host: socket.socket, octets: bytes) -> bool:
        try:
            host.send(octets.ljust(PACKET, b"\0"))
        except BlockingIOError:
            return False
        except OSError:
            self._unplug()
            return False
        self._rover.brick.give(len(octets))
        return True


def _answers(path: Path) -> bool:
    """Return whether somebody listens there."""
    with cable() as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return False
    return True
