"""`VideoForwarder` aboard: sends datagrams of a UDP port (the camera's stream) to the ground.

While it is on (VIDEO ON), a separate thread forwards each datagram of up to 64 KiB at once,
unchanged and in order (thesis 5.1.3). A datagram that the destination refuses, or that has
no route, is lost and counted.
"""

import errno
import logging
import os
import selectors
import socket
import threading
from typing import Any, Final

from executive.settings import MAX_PORT, VideoSettings

SocketAddress = tuple[Any, ...]
_DATAGRAM: Final = socket.SOCK_DGRAM


class Destination:
    """A host and a UDP port. A name is resolved on a thread of its own; IPv4 is preferred."""

    def __init__(self, host: str, port: int) -> None:
        self.host, self.port = host, port
        self._found: tuple[socket.AddressFamily, SocketAddress] | None = None
        self._fault = ""
        self._search: threading.Thread | None = None
        if not self._resolve(socket.AI_NUMERICHOST):
            self._begin()

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"

    def address(self) -> tuple[socket.AddressFamily, SocketAddress]:
        """Return the address with its family. Never waits: if it is unknown, resolves it again.

        Raises:
            OSError: the host is unknown, or is being resolved.
        """
        if self._found is not None:
            return self._found
        if self._search is not None and self._search.is_alive():
            raise OSError(errno.EAGAIN, f"{self.host} is being resolved: try again in a moment")
        self._begin()
        raise OSError(
            errno.EHOSTUNREACH,
            f"unknown host {self.host} ({self._fault}); resolving it again",
        )

    def _begin(self) -> None:
        self._search = threading.Thread(target=self._resolve, name="host", daemon=True)
        self._search.start()

    def _resolve(self, flags: int = 0) -> bool:
        try:
            found = socket.getaddrinfo(self.host, self.port, type=_DATAGRAM, flags=flags)
        except OSError as error:
            self._fault = error.strerror or str(error)
            return False
        best = min(found, key=lambda entry: entry[0] != socket.AF_INET)
        self._found = (best[0], best[4])
        return True


MAX_DATAGRAM_OCTETS: Final = 1 << 16
"""Maximum size of a datagram in octets."""
_LOG: Final = logging.getLogger(__name__)


class ForwardingThread:
    """Forwards every datagram in order until it is closed.

    Attributes:
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
        """Stop; waits for the datagram being forwarded and no other."""
        self._wanted = False
        self._wake_sender.close()
        self._thread.join()

    def _run(self) -> None:
        with self._source, self._sink, self._wake_receiver, selectors.DefaultSelector() as ready:
            ready.register(self._source, selectors.EVENT_READ)
            ready.register(self._wake_receiver, selectors.EVENT_READ)
            buffer = memoryview(bytearray(MAX_DATAGRAM_OCTETS))
            try:
                while self._wanted:
                    ready.select()
                    self._drain(buffer)
            except Exception:
                _LOG.exception("video is no longer forwarded")

    def _drain(self, buffer: memoryview) -> None:
        """Forward the datagrams that have arrived."""
        while self._wanted:
            try:
                length = self._source.recv_into(buffer)
            except BlockingIOError:
                return
            self._send(buffer[:length])

    def _send(self, datagram: memoryview) -> None:
        try:
            self._sink.sendto(datagram, self._destination)
        except OSError as error:  # no route now, or too long: the next one may succeed
            if not self.lost:
                _LOG.warning("video cannot be sent to %s: %s", self._destination[0], error)
            self.lost += 1
        else:
            self.datagrams += 1
            self.octets += len(datagram)


class VideoForwarder:
    """Implements `executive.values.ports.Video`: its port is open while it is on.

    It does not inspect datagrams, so any stream over UDP is possible.
    """

    def __init__(self, settings: VideoSettings) -> None:
        self._listen = (settings.listen_host, settings.listen_port)
        self._destination = Destination(settings.to_host, settings.to_port)
        self._relay: ForwardingThread | None = None

    @property
    def enabled(self) -> bool:
        """Whether it forwards."""
        return self._relay is not None and self._relay.runs

    def set_enabled(self, on: bool) -> None:
        """Switch the forwarding on or off; returns at once.

        Raises:
            OSError: the port is in use, the host is unknown, or it would forward to itself.
        """
        if on and self.enabled:
            return
        self.close()
        if on:
            self._start()

    def close(self) -> None:
        """Switch the forwarding off."""
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
        raise OSError(errno.ELOOP, f"{destination[0]}:{port} is its own port: a loop")


def _is_here(source: socket.socket, host: str) -> bool:
    """Return whether datagrams to a host arrive on this computer; broadcasts do."""
    with socket.socket(source.family, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, 0))
        except OSError:
            return False
    return True


def parse_address(text: str) -> tuple[str, int]:
    """Return host and port of `HOST:PORT`; an IPv6 address is in brackets.

    Raises:
        ValueError: the text does not have this form.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) <= MAX_PORT:
        raise ValueError(f"{text!r} is not HOST:PORT, with a port of 1 to {MAX_PORT}")
    return host.strip("[]"), int(port)
