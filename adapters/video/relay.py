"""One run of forwarding: from a socket that listens to one that sends, on a thread of its own."""

import logging
import selectors
import socket
import threading
from typing import Final

from adapters.video.destination import SocketAddress

LONGEST: Final = 1 << 16
"""Octets that the longest datagram has room in."""
_LOG: Final = logging.getLogger(__name__)


class Relay:
    """Sends every datagram on as it came, in its order, until it is closed.

    Attributes:
        datagrams, octets: what was sent on.
        lost: datagrams that could not be sent.
    """

    def __init__(
        self, source: socket.socket, sink: socket.socket, destination: SocketAddress
    ) -> None:
        """Begin; both sockets are closed at the end."""
        self.datagrams = self.octets = self.lost = 0
        self._source, self._sink = source, sink
        self._destination = destination
        self._wanted = True
        self._alarm, self._bell = socket.socketpair()
        source.setblocking(False)
        sink.setblocking(False)
        self._thread = threading.Thread(target=self._run, name="video", daemon=True)
        self._thread.start()

    @property
    def runs(self) -> bool:
        """Whether it forwards."""
        return self._thread.is_alive()

    def close(self) -> None:
        """End; it waits for the datagram under way and no other."""
        self._wanted = False
        self._bell.close()
        self._thread.join()

    def _run(self) -> None:
        with self._source, self._sink, self._alarm, selectors.DefaultSelector() as ready:
            ready.register(self._source, selectors.EVENT_READ)
            ready.register(self._alarm, selectors.EVENT_READ)
            buffer = memoryview(bytearray(LONGEST))
            try:
                while self._wanted:
                    ready.select()
                    self._drain(buffer)
            except Exception:
                _LOG.exception("video is no longer forwarded")

    def _drain(self, buffer: memoryview) -> None:
        """Send on what has arrived."""
        while self._wanted:
            try:
                length = self._source.recv_into(buffer)
            except BlockingIOError:
                return
            self._send(buffer[:length])

    def _send(self, datagram: memoryview) -> None:
        try:
            self._sink.sendto(datagram, self._destination)
        except OSError as error:  # no way there now, or it is too long: the next may get through
            if not self.lost:
                _LOG.warning("video does not get through to %s: %s", self._destination[0], error)
            self.lost += 1
        else:
            self.datagrams += 1
            self.octets += len(datagram)
