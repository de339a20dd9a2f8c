"""Forwards the camera's stream: what any source sends to a UDP port goes on to the ground.

While it is on (VIDEO ON), each datagram of up to 64 KiB is sent on at once, unchanged and in its
order (thesis 5.1.3), by a thread of its own. One that the destination refuses, or to which there is
no route, is lost and counted.
"""

import errno
import logging
import os
import selectors
import socket
import threading
from typing import Any, Final

from executive.settings import HIGHEST_PORT, VideoSettings

SocketAddress = tuple[Any, ...]
_DATAGRAM: Final = socket.SOCK_DGRAM


class Destination:
    """A host and a UDP port. A name is looked up on a thread of its own; IPv4 is preferred."""

    def __init__(self, host: str, port: int) -> None:
        self.host, self.port = host, port
        self._found: tuple[socket.AddressFamily, SocketAddress] | None = None
        self._fault = ""
        self._search: threading.Thread | None = None
        if not self._look_up(socket.AI_NUMERICHOST):
            self._begin()

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"

    def address(self) -> tuple[socket.AddressFamily, SocketAddress]:
        """Return the address with its family. Never waits: where none is known, it looks again.

        Raises:
            OSError: there is no such host, or it is still being looked up.
        """
        if self._found is not None:
            return self._found
        if self._search is not None and self._search.is_alive():
            raise OSError(errno.EAGAIN, f"{self.host} is being looked up: try again in a moment")
        self._begin()
        raise OSError(
            errno.EHOSTUNREACH,
            f"there is no host {self.host} ({self._fault}); it is looked up anew",
        )

    def _begin(self) -> None:
        self._search = threading.Thread(target=self._look_up, name="host", daemon=True)
        self._search.start()

    def _look_up(self, flags: int = 0) -> bool:
        try:
            found = socket.getaddrinfo(self.host, self.port, type=_DATAGRAM, flags=flags)
        except OSError as error:
            self._fault = error.strerror or str(error)
            return False
        best = min(found, key=lambda entry: entry[0] != socket.AF_INET)
        self._found = (best[0], best[4])
        return True


LONGEST: Final = 1 << 16
"""Octets that the longest datagram has room in."""
_LOG: Final = logging.getLogger(__name__)


class ForwardingThread:
    """Sends every datagram on as it came, in its order, until it is closed.

    Attributes:
        datagrams, octets: what was sent on.
        lost: datagrams that could not be sent.
    """

    def __init__(
        self, source: socket.socket, sink: socket.socket, destination: SocketAddress
    ) -> None:
        self.datagrams = self.octets = self.lost = 0
        self._source, self._sink = source, sink
        self._destination = destination
        self._wanted = True
        self._wake_receiver, self._wake_sender = socket.socketpair()
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
        self._wake_sender.close()
        self._thread.join()

    def _run(self) -> None:
        with self._source, self._sink, self._wake_receiver, selectors.DefaultSelector() as ready:
            ready.register(self._source, selectors.EVENT_READ)
            ready.register(self._wake_receiver, selectors.EVENT_READ)
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


class VideoForwarder:
    """Implements `executive.values.ports.Video`: while it is on, its port is open, else it is not.

    It looks into no datagram, so any stream over UDP will do.
    """

    def __init__(self, settings: VideoSettings) -> None:
        self._listen = (settings.listen_host, settings.listen_port)
        self._destination = Destination(settings.to_host, settings.to_port)
        self._relay: ForwardingThread | None = None

    @property
    def on(self) -> bool:
        """Whether it forwards."""
        return self._relay is not None and self._relay.runs

    def switch(self, on: bool) -> None:
        """Forward from now on, or no more; returns at once.

        Raises:
            OSError: the port is taken, there is no such host, or it would forward to itself.
        """
        if on and self.on:
            return
        self.close()
        if on:
            self._start()

    def close(self) -> None:
        """Be off."""
        relay, self._relay = self._relay, None
        if relay is not None:
            relay.close()
            _LOG.info(
                "video off: %d datagrams, %d octets forwarded, %d datagrams lost",
                relay.datagrams,
                relay.octets,
                relay.lost,
            )

    def _start(self) -> None:
        family, destination = self._destination.address()
        source = self._open()
        try:
            _refuse_loop(source, destination)
            sink = socket.socket(family, socket.SOCK_DGRAM)
        except OSError:
            source.close()
            raise
        sink.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._relay = ForwardingThread(source, sink, destination)
        _LOG.info("video on: from UDP %s:%d to %s", *self._listen, self._destination)

    def _open(self) -> socket.socket:
        host, port = self._listen
        source = socket.socket(
            socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM
        )
        try:
            source.bind(self._listen)
        except OSError as error:
            source.close()
            why = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
            raise OSError(error.errno, f"cannot listen at UDP {host}:{port}: {why}") from error
        return source


def _refuse_loop(source: socket.socket, destination: SocketAddress) -> None:
    host, port = source.getsockname()[:2]
    if destination[1] == port and (
        destination[0] == host or (host in ("0.0.0.0", "::") and _is_here(source, destination[0]))
    ):
        raise OSError(errno.ELOOP, f"{destination[0]}:{port} is where it listens: a loop")


def _is_here(source: socket.socket, host: str) -> bool:
    """Whether what is sent to a host arrives on this computer; broadcasts do."""
    with socket.socket(source.family, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, 0))
        except OSError:
            return False
    return True


def parse_address(text: str) -> tuple[str, int]:
    """Return host and port of `HOST:PORT`; an IPv6 address stands in brackets.

    Raises:
        ValueError: it is not that.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) <= HIGHEST_PORT:
        raise ValueError(f"{text!r} is not HOST:PORT, with a port of 1 to {HIGHEST_PORT}")
    return host.strip("[]"), int(port)
