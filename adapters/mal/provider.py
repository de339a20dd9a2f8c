"""The provider's side: takes messages, calls handlers, and sends what they return."""

import asyncio
import inspect
from collections import Counter
from collections.abc import Awaitable
from functools import partial
from ssl import SSLContext
from typing import Any, Final

from adapters.mal.attribute_codec import Encoding
from adapters.mal.broker import Admit, Broker, Publisher, PublishPolicy
from adapters.mal.codec import Codec
from adapters.mal.connection import Connection, MalUri
from adapters.mal.errors import DecodeError, MalError, StandardError
from adapters.mal.interaction import Call, Handler, Interaction, Parts, ReplyPath
from adapters.mal.message import MESSAGE_CAP, Header
from adapters.mal.specification import REPLY, Operation, Pattern, Specification, Stage
from adapters.mal.tls import is_loopback
from adapters.mal.values import AttributeType, Typed

INTERACTION_CAP: Final = 256
"""INVOKE and PROGRESS interactions under way over one connection, at most."""
HANDSHAKE_S: Final = 5.0
"""How long a peer may take to begin with TLS."""
_ANSWERED_ELSEWHERE: Final = (Stage.SEND, Stage.INVOKE, Stage.PROGRESS, Stage.PUBLISH)
"""What no reply follows, or not as soon as the handler is called."""


class Provider:
    """Serves operations by handlers, and PUBSUB ones through its own broker.

    Handlers are called on the loop, from within the arrival of the octets. A handler that raises
    anything but MalError is answered for with INTERNAL and a trace in the log.
    """

    def __init__(
        self,
        specification: Specification,
        name: str,
        encoding: Encoding = Encoding.FIXED,
        not_served: MalError | None = None,
        message_cap: int = MESSAGE_CAP,
    ) -> None:
        """Prepare a provider that serves nothing yet.

        Args:
            specification: What may be served.
            name: The last part of its URI.
            encoding: The body encoding, agreed with all consumers.
            not_served: The answer to an operation without handler or publisher; if None,
                UNSUPPORTED_OPERATION.
            message_cap: Octets of the longest message taken.
        """
        self._specification = specification
        self._name = name
        self._codec = Codec(specification, encoding)
        self._not_served = not_served or MalError(StandardError.UNSUPPORTED_OPERATION)
        self._message_cap = message_cap
        self._broker = Broker(self._codec)
        self._handlers: dict[tuple[str, str], Handler] = {}
        self._published: set[tuple[str, str]] = set()
        self._opened: dict[tuple[str, str], PublishPolicy] = {}
        self._connections: set[Connection] = set()
        self._running: set[asyncio.Future[Any]] = set()
        self._interactions: Counter[Connection] = Counter()
        self._server: asyncio.Server | None = None
        self._uri = MalUri("", 0, name)

    def serve(self, service: str, operation: str, handler: Handler) -> None:
        """Let a handler answer an operation: any but PUBSUB.

        That of an INVOKE or PROGRESS is `async def handler(interaction, *parts)`, all others are
        called with the `Call`. What a SEND's returns goes nowhere.

        Raises:
            KeyError: There is no such operation.
            ValueError: It is a PUBSUB.
        """
        if self._specification.operation(service, operation).pattern is Pattern.PUBSUB:
            raise ValueError(f"{service}.{operation} is a PUBSUB, which no handler can serve")
        self._handlers[service, operation] = handler

    def publisher(self, service: str, operation: str) -> Publisher:
        """Open a PUBSUB operation for subscribers, and give what publishes its updates.

        Raises:
            KeyError: There is no such operation.
            ValueError: It is of another pattern.
        """
        found = self._pubsub(service, operation)
        self._published.add((service, operation))
        return Publisher(self._broker, found)

    def open(
        self, service: str, operation: str, droppable: bool = False, admit: Admit = lambda *_: None
    ) -> None:
        """Let publishers in other processes publish a PUBSUB operation through this broker.

        Args:
            service: Name of the service.
            operation: Name of the operation.
            droppable: Whether its updates may be dropped, the oldest first, for a subscriber that
                is too slow; see `Publisher.publish`.
            admit: Called as `admit(connection, update_header, keys, *parts)` with each update
                before it is sent on; raises MalError to refuse it.

        Raises:
            KeyError: There is no such operation.
            ValueError: It is of another pattern.
        """
        self._pubsub(service, operation)
        self._published.add((service, operation))
        self._opened[service, operation] = PublishPolicy(droppable, admit)

    async def start(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        tls: SSLContext | None = None,
        clear_text: bool = False,
    ) -> None:
        """Listen.

        Args:
            host: The address to listen on.
            port: The TCP port; 0 takes a free one.
            tls: How to encrypt, and whom to believe; see `Certificates.for_provider`.
            clear_text: Whether to do without TLS on an address that others can reach.

        Raises:
            OSError: The address cannot be had.
            ValueError: Others can reach the address, and there is neither TLS nor `clear_text`.
        """
        if tls is None and not clear_text and not is_loopback(host):
            raise ValueError(
                f"{host} can be reached from other computers: give TLS certificates,"
                " or say explicitly that anyone may read and send in clear text"
            )
        loop = asyncio.get_running_loop()
        patience_s = None if tls is None else HANDSHAKE_S
        self._server = await loop.create_server(
            self._connection, host, port, ssl=tls, ssl_handshake_timeout=patience_s
        )
        self._uri = MalUri(host, self._server.sockets[0].getsockname()[1], self._name)

    @property
    def uri(self) -> MalUri:
        """Where it is reached, once started."""
        return self._uri

    async def close(self) -> None:
        """Stop listening, answer SHUTDOWN to requests under way, and close all connections."""
        if self._server is not None:
            self._server.close()
        for answer in self._running:
            answer.cancel()
        await asyncio.gather(*self._running, return_exceptions=True)
        await asyncio.gather(*(connection.close() for connection in self._connections))

    def _pubsub(self, service: str, operation: str) -> Operation:
        found = self._specification.operation(service, operation)
        if found.pattern is not Pattern.PUBSUB:
            raise ValueError(f"{service}.{operation} is a {found.pattern.name}, not a PUBSUB")
        return found

    def _connection(self) -> Connection:
        connection = Connection(self._receive, self._message_cap, self._connections.add)
        connection.lost.add_done_callback(lambda _: self._lose(connection))
        return connection

    def _lose(self, connection: Connection) -> None:
        self._connections.discard(connection)
        self._broker.drop(connection)

    def _receive(self, connection: Connection, header: Header, body: bytes) -> None:
        if header.is_error or (header.stage not in REPLY and header.stage is not Stage.SEND):
            error = "error " if header.is_error else ""
            connection.refuse(f"{error}{header.stage.name} is nothing that a consumer sends")
            return
        back = ReplyPath(connection, header, self._codec)
        try:
            operation = self._addressed(header)
            result = self._act(back, operation, body)
            if inspect.isawaitable(result):
                answer: asyncio.Future[Parts | None] = asyncio.ensure_future(result)
                self._running.add(answer)
                answer.add_done_callback(partial(self._answered, back, operation))
                return
            _reply(back, operation, result)
        except MalError as error:
            back.refuse(error)
        except DecodeError as fault:
            text = Typed(AttributeType.STRING, str(fault))
            back.refuse(MalError(StandardError.BAD_ENCODING, text))
        except Exception:
            back.fault()

    def _addressed(self, header: Header) -> Operation:
        names = (self._uri.name, self._uri.broker.name)
        if header.to_uri is None or header.to_uri.rpartition("/")[2] not in names:
            text = f"{header.to_uri} is not here"
            raise MalError(StandardError.DESTINATION_UNKNOWN, Typed(AttributeType.STRING, text))
        operation = self._specification.resolve(
            header.area, header.area_version, header.service, header.operation
        )
        if header.stage not in operation.parts:
            raise MalError(StandardError.UNSUPPORTED_OPERATION)
        return operation

    def _act(
        self, back: ReplyPath, operation: Operation, body: bytes
    ) -> Awaitable[Parts | None] | Parts | None:
        name, header = (operation.service_name, operation.name), back.header
        parts = operation.parts[header.stage]
        match header.stage:
            case Stage.PUBLISH_REGISTER if name in self._opened:
                self._broker.register_publisher(back, operation, *self._codec.decode(parts, body))
            case Stage.PUBLISH if name in self._opened:
                update, *rest = self._codec.decode(parts, body)
                self._broker.publish_for(back, operation, update, tuple(rest), self._opened[name])
            case Stage.PUBLISH_DEREGISTER if name in self._opened:
                self._codec.decode(parts, body)
                self._broker.deregister_publisher(back, operation)
            case Stage.PUBLISH_REGISTER | Stage.PUBLISH_DEREGISTER:
                raise MalError(StandardError.UNSUPPORTED_OPERATION)
            case Stage.PUBLISH:
                raise MalError(StandardError.INCORRECT_STATE)
            case Stage.REGISTER if name in self._published:
                self._broker.register(back, operation, *self._codec.decode(parts, body))
            case Stage.DEREGISTER if name in self._published:
                self._broker.deregister(back, operation, *self._codec.decode(parts, body))
            case _ if name in self._handlers:
                values = self._codec.decode(parts, body)
                call = Call(
                    *name,
                    header.from_uri,
                    header.transaction_id,
                    header.supplements,
                    back.connection,
                )
                if header.stage not in (Stage.INVOKE, Stage.PROGRESS):
                    return self._handlers[name](call, *values)
                self._begin(Interaction(call, operation, back), self._handlers[name], values)
            case _:
                raise MalError(self._not_served.number, self._not_served.extra)
        return None

    def _begin(self, interaction: Interaction, handler: Handler, parts: Parts) -> None:
        """Let a handler serve an INVOKE or PROGRESS until it or the connection ends."""
        connection = interaction.call.connection
        if self._interactions[connection] == INTERACTION_CAP:
            raise MalError(StandardError.TOO_MANY)
        self._interactions[connection] += 1
        task = asyncio.ensure_future(interaction.run(handler, parts))

        def cancel(_lost: asyncio.Future[None]) -> None:
            task.cancel()

        def end(_ended: asyncio.Future[None]) -> None:
            connection.lost.remove_done_callback(cancel)
            self._running.discard(task)
            self._interactions[connection] -= 1
            if not self._interactions[connection]:
                del self._interactions[connection]

        connection.lost.add_done_callback(cancel)
        task.add_done_callback(end)
        self._running.add(task)

    def _answered(
        self, back: ReplyPath, operation: Operation, answer: asyncio.Future[Parts | None]
    ) -> None:
        self._running.discard(answer)
        try:
            _reply(back, operation, answer.result())
        except MalError as error:
            back.refuse(error)
        except asyncio.CancelledError:
            back.refuse(MalError(StandardError.SHUTDOWN))
        except Exception:
            back.fault()


def _reply(back: ReplyPath, operation: Operation, parts: Parts | None) -> None:
    if back.header.stage not in _ANSWERED_ELSEWHERE:
        back.send(operation, REPLY[back.header.stage], parts)
