"""Forwards the camera's stream: what any source sends to a UDP port goes on to the ground."""

import errno
import logging
import os
import socket
from typing import Final

from adapters.video.destination import Destination, SocketAddress
from adapters.video.relay import Relay
from executive.settings import VideoSettings

_LOG: Final = logging.getLogger(__name__)


class VideoForwarder:
    """Implements `executive.ports.Video`: while it is on, its port is open, else it is not.

    It looks into no datagram, so any stream over UDP will do.
    """

    def __init__(self, settings: VideoSettings) -> None:
        """Be off."""
        self._listen = (settings.listen_host, settings.listen_port)
        self._destination = Destination(settings.to_host, settings.to_port)
        self._relay: Relay | None = None

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
        self._relay = Relay(source, sink, destination)
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
