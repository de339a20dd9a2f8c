"""MRS commands as octets on a plain socket, so that nothing of a client is measured."""

import socket
from itertools import count

from adapters.mal.codec import Codec
from adapters.mal.message import Header, encode_message
from adapters.mal.specification import Stage
from adapters.mrs.headers import header_of
from adapters.mrs.requests import invocation
from adapters.mrs.specification import mrs_specification
from executive.commands import Command, Identity, Request

_NUMBERS = count(1)


class Octets:
    """A connection to a port of this machine."""

    def __init__(self, port: int) -> None:
        """Connect, without delay of small messages."""
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10.0)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._to = f"maltcp://127.0.0.1:{port}/MRS"

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def message(self, request: Request) -> bytes:
        """Return the octets of a new command."""
        number = next(_NUMBERS)
        command = Command(Identity("bench", number), request, "direct", report_started=False)
        call = invocation(request)
        specification = mrs_specification()
        operation = specification.operation(call.service, call.operation)
        body = Codec(specification).encode(
            operation.parts[Stage.SUBMIT], (header_of(command), *call.parts)
        )
        from_uri = "maltcp://127.0.0.1:1/bench"
        return encode_message(Header.of(operation, Stage.SUBMIT, number, from_uri, self._to), body)

    def send(self, message: bytes) -> None:
        """Send octets."""
        self._socket.sendall(message)

    def reply(self) -> None:
        """Wait for one message and throw it away."""
        length = int.from_bytes(self._exactly(4), "big")
        self._exactly(length - 4)

    def _exactly(self, count: int) -> bytes:
        found = b""
        while len(found) < count:
            piece = self._socket.recv(count - len(found))
            if not piece:
                raise ConnectionError("the executive hung up")
            found += piece
        return found
