"""`UsbPlug`: the emulated brick's end of its USB cable, a Unix socket with one host at a time."""

import socket
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Final

PACKET: Final = 64
CLAIMED: Final = b"\x01"
"""Sent to a host that has claimed the brick; a second host receives the end of the stream."""
MAX_QUEUED: Final = 1024
"""Maximum number of packets queued for a host that does not read; further ones are lost."""


class UsbPlug:
    """The brick's connection to a host. It never blocks; call `receive` periodically."""

    def __init__(self, path: Path) -> None:
        """Plug in.

        Raises:
            OSError: the socket cannot be created.
        """
        self._path = path
        self._host: socket.socket | None = None
        self._waiting: deque[bytes] = deque()
        path.unlink(missing_ok=True)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.setblocking(False)
        self._listener.bind(str(path))
        self._listener.listen()

    @property
    def connected(self) -> bool:
        """Whether a host has claimed the brick."""
        return self._host is not None

    def receive(self) -> bytes:
        """Return the octets that the host has written since the last call."""
        self._accept()
        octets = b""
        while self._host is not None:
            try:
                packet = self._host.recv(PACKET)
            except BlockingIOError:
                break
            except ConnectionError:
                packet = b""
            if not packet:
                self._hang_up()
            octets += packet
        self._flush()
        return octets

    def send(self, octets: bytes) -> None:
        """Send octets to the host, if there is one, in packets padded with zeros."""
        if self._host is None:
            return
        for start in range(0, len(octets), PACKET):
            if len(self._waiting) < MAX_QUEUED:
                self._waiting.append(octets[start : start + PACKET].ljust(PACKET, b"\0"))
        self._flush()

    def close(self) -> None:
        """Unplug."""
        self._path.unlink(missing_ok=True)
        self._hang_up()
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                host, _ = self._listener.accept()
            except BlockingIOError:
                return
            if self._host is not None:
                host.close()
                continue
            host.setblocking(False)
            self._host = host
            with suppress(OSError):
                host.send(CLAIMED)

    def _flush(self) -> None:
        while self._host is not None and self._waiting:
            try:
                self._host.send(self._waiting[0])
            except BlockingIOError:
                return
            except ConnectionError:
                self._hang_up()
                return
            self._waiting.popleft()

    def _hang_up(self) -> None:
        if self._host is not None:
            self._host.close()
        self._host = None
        self._waiting.clear()
