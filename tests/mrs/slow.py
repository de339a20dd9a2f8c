"""A subscriber that reads when it is told to, and not before."""

import socket
from collections.abc import Iterator
from typing import Any, Self

from adapters.mal import Codec, Header, MalUri, Stage, Subscription, encode_message
from adapters.mal.message import decode_message
from adapters.mrs.spec.specification import mrs_specification
from adapters.mrs.spec.types import Notification, ParameterValue

ROOM_OCTETS = 4096
ANSWER_S = 60.0
OWN_URI = "maltcp://127.0.0.1:1/slow"


class SlowSubscriber:
    """A plain socket with little room, subscribed to all that a rover tells."""

    def __init__(self, rover: str) -> None:
        """Connect and subscribe."""
        uri = MalUri.parse(rover)
        self._broker = str(uri.broker)
        self._codec = Codec(mrs_specification())
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM_OCTETS)
        self._socket.settimeout(ANSWER_S)
        self._socket.connect((uri.host, uri.port))
        self._octets = bytearray()
        for number, (service, operation) in enumerate(
            (("Notification", "monitorNotification"), ("Monitoring", "monitorValue")), 1
        ):
            self._subscribe(number, service, operation)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def read(self) -> Iterator[Notification | ParameterValue]:
        """What comes, until the rover hangs up or has nothing more to say for long."""
        while message := self._message():
            header, body = decode_message(message)
            operation = mrs_specification().resolve(
                header.area, header.area_version, header.service, header.operation
            )
            _, _, value = self._codec.decode(operation.parts[header.stage], body)
            yield value

    def _subscribe(self, number: int, service: str, operation: str) -> None:
        found = mrs_specification().operation(service, operation)
        header = Header.of(found, Stage.REGISTER, number, OWN_URI, self._broker)
        wanted: tuple[Any, ...] = (Subscription(subscriptionId="slow"),)
        body = self._codec.encode(found.parts[Stage.REGISTER], wanted)
        self._socket.sendall(encode_message(header, body))
        acknowledgement, _ = decode_message(self._message())
        assert acknowledgement.stage is Stage.REGISTER_ACK
        assert not acknowledgement.is_error

    def _message(self) -> bytes:
        """The next message, or nothing if the rover hung up."""
        while len(self._octets) < 4 or len(self._octets) < int.from_bytes(self._octets[:4], "big"):
            try:
                more = self._socket.recv(1 << 16)
            except ConnectionResetError:
                more = b""
            if not more:
                return b""
            self._octets += more
        length = int.from_bytes(self._octets[:4], "big")
        message = bytes(self._octets[:length])
        del self._octets[:length]
        return message
