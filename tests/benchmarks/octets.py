"""MRS messages as octets on a plain socket, so that nothing of a client is measured."""

import socket
from itertools import count
from typing import Any, Self

from adapters.mal import Codec, Header, InteractionStage, MalUri, encode_message
from adapters.mal.codec import decode_message
from adapters.mrs.spec import header_of, invocation, mrs_specification
from executive.commands.catalogue import Command, Request
from executive.values.reports import Identity

_NUMBERS = count(1)


class Octets:
    """One connection with an executive."""

    def __init__(self, port: int, source: str = "bench") -> None:
        self._specification = mrs_specification()
        self._codec = Codec(self._specification)
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=60.0)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._source, self._to = source, f"maltcp://127.0.0.1:{port}/MRS"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._socket.close()

    def command(self, request: Request, number: int | None = None) -> bytes:
        """Return the octets of a command: a new one, unless its number is given."""
        identity = Identity(self._source, next(_NUMBERS) if number is None else number)
        call, command = (
            invocation(request),
            Command(identity, request, "direct", report_started=False),
        )
        header = header_of(command)
        return self.message(
            call.service, call.operation, InteractionStage.SUBMIT, header, *call.parts
        )

    def message(self, service: str, name: str, stage: InteractionStage, *values: Any) -> bytes:
        operation = self._specification.operation(service, name)
        body = self._codec.encode(operation.parts[stage], values)
        to = str(MalUri.parse(self._to).broker) if stage is InteractionStage.REGISTER else self._to
        from_uri = "maltcp://127.0.0.1:1/bench"
        return encode_message(Header.of(operation, stage, next(_NUMBERS), from_uri, to), body)

    def send(self, message: bytes) -> None:
        self._socket.sendall(message)

    def reply(self) -> bool:
        """Read a message; return whether it is no error."""
        start = self._exactly(4)
        header, _ = decode_message(start + self._exactly(int.from_bytes(start, "big") - 4))
        return not header.is_error

    def request(self, request: Request) -> bool:
        """Send a new command and return whether it was taken."""
        self.send(self.command(request))
        return self.reply()

    def _exactly(self, count: int) -> bytes:
        found = bytearray()
        while len(found) < count:
            piece = self._socket.recv(count - len(found))
            if not piece:
                raise ConnectionError("the executive hung up")
            found += piece
        return bytes(found)
