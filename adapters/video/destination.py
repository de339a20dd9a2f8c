"""Where datagrams go: a host that may have to be looked up, which never holds up who asks."""

import errno
import socket
import threading
from typing import Any, Final

SocketAddress = tuple[Any, ...]
_DATAGRAM: Final = socket.SOCK_DGRAM


class Destination:
    """A host and a port. A name is looked up on a thread of its own; IPv4 is preferred.

    Args:
        host: an address, or a name.
        port: the UDP port.
    """

    def __init__(self, host: str, port: int) -> None:
        """Begin to look it up."""
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
