"""The camera of the simulated rover as a stream over UDP, sent only where somebody listens."""

import secrets
import socket
from contextlib import suppress

from sim.rtp_jpeg import LARGEST, RtpJpegSender, carries


class VideoError(ValueError):
    """There can be no such stream; the text says why."""


class VideoStream:
    """Sends pictures to one address.

    A computer where nobody listens refuses datagrams. While that is so, one empty datagram for each
    picture asks whether it still is, and no picture needs to be rendered.
    """

    def __init__(self, host: str, port: int, width: int, height: int) -> None:
        """Begin; the first question whether somebody listens comes with the first picture.

        Args:
            host: where to.
            port: its UDP port.
            width: pixels of each picture.
            height: pixels of each picture.

        Raises:
            VideoError: there is no such host, or RTP carries no pictures of this size.
        """
        if not carries(width, height):
            raise VideoError(
                f"RTP carries no JPEG of {width} x {height}: multiples of 8 up to {LARGEST} it does"
            )
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise VideoError(f"no video to {host}: {error.strerror}") from error
        family, kind, *_, address = min(found, key=lambda entry: entry[0] != socket.AF_INET)
        self._socket = socket.socket(family, kind)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.connect(address)
        self._socket.setblocking(False)
        self._sender = RtpJpegSender(source=secrets.randbits(32))
        self._refused = True

    @property
    def watched(self) -> bool:
        """Whether the next picture would be heard, as far as is known."""
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        refused, self._refused = self._refused or error != 0, False
        if refused:
            with suppress(OSError):
                self._socket.send(b"")
        return not refused

    def send(self, jpeg: bytes, time_s: float) -> None:
        """Send a picture; what cannot be sent is lost.

        Args:
            jpeg: a picture of the size that was told.
            time_s: when it was taken.
        """
        try:
            for packet in self._sender.packets(jpeg, time_s):
                self._socket.send(packet)
        except OSError:
            self._refused = True

    def close(self) -> None:
        """Let go of the socket."""
        self._socket.close()
