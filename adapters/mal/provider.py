"""`Provider`, a server: receives messages, calls handlers, and sends their results."""

import asyncio
import inspect
import logging
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass
from functools import partial
from ssl import SSLContext
from typing import Any, Final

from adapters.mal.admission import Connections, PeerLimits
from adapters.mal.attribute_codec import Encoding
from adapters.mal.broker import Admit, Broker, Publisher, PublishPolicy
from adapters.mal.codec import Codec, Header, encode_message
from adapters.mal.connection import Connection, LinkTraffic, MalUri
from adapters.mal.errors import DecodeError, EncodeError, MalError, StandardError
from adapters.mal.specification import (
    REPLY,
    InteractionStage,
    Names,
    Operation,
    Pattern,
    Specification,
)
from adapters.mal.tls import address_to_listen, is_loopback
from adapters.mal.values import NamedValue
from adapters.system import OPERATING_SYSTEM, System, utc_ns

_LOG: Final = logging.getLogger(__name__)
Parts = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class CallContext:
    """Context of a handler's call, in addition to the parts of the message.

    Attributes:
        transaction_id: The interaction, numbered by the caller.
        supplements: Named attributes of the header.
        timestamp_ns: Time of sending by the caller's clock, ns since 1970 UTC, if it is stated.
    """

    service: str
    operation: str
    from_uri: str | None
    transaction_id: int
    supplements: tuple[NamedValue, ...]
    connection: Connection
    timestamp_ns: int | None = None

    @property
    def peer_name(self) -> str | None:
        """The name in the caller's certificate; None without one."""
        return self.connection.peer_name


Handler = Callable[..., Awaitable[Parts | None] | Parts | None]
"""Called as `handler(call, *parts)`, or `handler(interaction, *parts)` for INVOKE and PROGRESS;
returns None, a tuple of parts, or an awaitable of either."""


@dataclass(frozen=True, slots=True)
class ReplyPath:
    """Return path to the sender of a message: replies and errors of all later stages."""

    connection: Connection
    header: Header
    codec: Codec
    system: System

    def send(self, operation: Operation, stage: InteractionStage, parts: Parts | None) -> None:
        """Send a reply.

        Raises:
            EncodeError: The parts do not match the stage.
        """
        body = self.codec.encode(operation.parts[stage], parts or ())
        self.connection.send(encode_message(self.header.reply(stage, utc_ns(self.system)), body))

    def refuse(self, error: MalError, stage: InteractionStage | None = None) -> None:
        """Send an error in place of the reply of a stage, by default the first."""
        if self.header.stage is InteractionStage.SEND:
            _LOG.info("SEND from %s dropped: %s", self.header.from_uri, error)
            return
        try:
            body = self.codec.encode_error(error)
        except EncodeError:
            _LOG.exception("error %d: its extra information cannot be encoded", error.number)
            body = self.codec.encode_error(MalError(error.number))
        stage = stage or REPLY[self.header.stage]
        header = self.header.reply(stage, utc_ns(self.system), is_error=True)
        self.connection.send(encode_message(header, body))

    def fail_internally(self, stage: InteractionStage | None = None) -> None:
        """Log the exception being handled, and answer INTERNAL."""
        header = self.header
        _LOG.exception("no answer to operation %d of service %d", header.operation, header.service)
        self.refuse(MalError(StandardError.INTERNAL), stage)


class UpdateError(MalError):
    """Ends a PROGRESS with an error of UPDATE; other errors are those of ACK or RESPONSE."""


class Interaction:
    """Interface of a handler to one INVOKE or PROGRESS.

    The handler is `async def`, calls `acknowledge` once, `update` any number of times (PROGRESS
    only), and returns the parts of the response. It raises MalError to end the interaction with an
    error in place of the next message. It is cancelled when the consumer's connection is lost and
    when the provider closes.
    """

    def __init__(
        self,
        call: CallContext,
        operation: Operation,
        back: ReplyPath,
        warn: Callable[[ReplyPath, MalError], None],
    ) -> None:
        self.call = call
        self._operation = operation
        self._back = back
        self._warn = warn
        self._acknowledged = False
        self._stages = (InteractionStage.INVOKE_ACK, InteractionStage.INVOKE_RESPONSE)
        if operation.pattern is Pattern.PROGRESS:
            self._stages = (InteractionStage.PROGRESS_ACK, InteractionStage.PROGRESS_RESPONSE)

    def acknowledge(self, *parts: Any) -> None:
        """Send the acknowledgement.

        Raises:
            EncodeError: The parts do not match the acknowledgement.
            RuntimeError: It was sent before.
        """
        if self._acknowledged:
            raise RuntimeError("acknowledged already")
        self._back.send(self._operation, self._stages[0], parts)
        self._acknowledged = True

    async def update(self, *parts: Any, patience_s: float | None = None) -> None:
        """Send an update, once the write buffer of the connection has space.

        Other tasks of the loop run first, however fast the consumer is.

        Args:
            parts: The parts of the update.
            patience_s: Timeout of the consumer; None for no timeout.

        Raises:
            TimeoutError: The consumer did not accept it in time.
            EncodeError: The parts do not match the update.
            RuntimeError: The interaction is not acknowledged, or no PROGRESS.
        """
        if not self._acknowledged or self._operation.pattern is not Pattern.PROGRESS:
            raise RuntimeError("an update needs an acknowledged PROGRESS")
        await self.call.connection.drain(patience_s)
        self._back.send(self._operation, InteractionStage.PROGRESS_UPDATE, parts)

    async def run(self, handler: Handler, parts: tuple[Any, ...]) -> None:
        """Run a handler, and send the response or error."""
        try:
            answer = handler(self, *parts)
            if not asyncio.iscoroutine(answer):
                raise TypeError(f"{handler!r} is not async")
            result = await answer
            if not self._acknowledged:
                raise RuntimeError("no acknowledgement before the response")
            self._back.send(self._operation, self._stages[1], result)
        except asyncio.CancelledError:
            self._refuse(MalError(StandardError.SHUTDOWN))
        except MalError as error:
            self._refuse(error)
        except Exception:
            self._back.fail_internally(self._stages[self._acknowledged])

    def _refuse(self, error: MalError) -> None:
        self._warn(self._back, error)
        stage = self._stages[self._acknowledged]
        if stage is InteractionStage.PROGRESS_RESPONSE and isinstance(error, UpdateError):
            stage = InteractionStage.PROGRESS_UPDATE
        self._back.refuse(error, stage)


_UNREADABLE: Final = {
    error.value
    for error in (
        StandardError.BAD_ENCODING,
        StandardError.DESTINATION_UNKNOWN,
        StandardError.UNSUPPORTED_AREA,
        StandardError.UNSUPPORTED_AREA_VERSION,
        StandardError.UNSUPPORTED_SERVICE,
        StandardError.UNSUPPORTED_OPERATION,
    )
}
_ANSWERED_SEPARATELY: Final = (
    InteractionStage.SEND,
    InteractionStage.INVOKE,
    InteractionStage.PROGRESS,
    InteractionStage.PUBLISH,
)
"""Messages without a reply, or without one directly after the handler."""


class Provider:
    """Serves operations by handlers, and PUBSUB ones through its own broker.

    Handlers are called on the loop, directly when the octets arrive. Any exception of a handler
    other than MalError is answered with INTERNAL and logged with its traceback.
    """

    def __init__(
        self,
        specification: Specification,
        name: str,
        encoding: Encoding = Encoding.FIXED,
        not_served: MalError | None = None,
        limits: PeerLimits | None = None,
        logged: Collection[int] = (),
        system: System = OPERATING_SYSTEM,
    ) -> None:
        """Create a provider without handlers.

        Args:
            specification: Services that it may serve.
            name: The last part of its URI.
            encoding: The body encoding, the same for all consumers.
            not_served: The answer to an operation without handler or publisher; if None,
                UNSUPPORTED_OPERATION.
            limits: Resource bounds of all consumers; those of `PeerLimits` if None.
            logged: Numbers of handlers' errors that are logged, in addition to decoding errors.
            system: Clock of messages, and sockets.
        """
        limits = limits or PeerLimits()
        self._specification = specification
        self._name = name
        self._codec = Codec(specification, encoding, limits.elements)
        self._not_served = not_served or MalError(StandardError.UNSUPPORTED_OPERATION)
        self._logged = {*_UNREADABLE, self._not_served.number, *logged}
        self._connections = connections = Connections(
            limits, self._receive, self._reject_oversized, self._lose, _LOG.warning, system
        )
        self._interactions = connections.quota(
            "active interactions", limits.interactions, limits.share
        )
        self._broker = Broker(
            self._codec,
            connections.quota("subscriptions", limits.subscriptions, limits.share),
            connections.quota("publishers", limits.publishers, limits.share),
            system,
        )
        self._system = system
        self._handlers: dict[Names, Handler] = {}
        self._published: set[Names] = set()
        self._opened: dict[Names, PublishPolicy] = {}
        self._running: set[asyncio.Future[Any]] = set()
        self._uri = MalUri("", 0, name)
        self._names = (self._uri.name, self._uri.broker.name)

    def serve(self, service: str, operation: str, handler: Handler) -> None:
        """Register the handler of an operation; any pattern except PUBSUB.

        For INVOKE and PROGRESS it is `async def handler(interaction, *parts)`; the others receive
        the `CallContext`. The result of a SEND's handler is ignored.

        Raises:
            KeyError: The operation does not exist.
            ValueError: It is a PUBSUB.
        """
        if self._specification.operation(service, operation).pattern is Pattern.PUBSUB:
            raise ValueError(f"{service}.{operation} is a PUBSUB: it has no handler")
        self._handlers[service, operation] = handler

    def publisher(
        self, service: str, operation: str, on_subscribed: Callable[[], None] = lambda: None
    ) -> Publisher:
        """Open a PUBSUB operation for subscribers, and return the publisher of its updates.

        Raises:
            KeyError: The operation does not exist.
            ValueError: It has another pattern.
        """
        found = self._pubsub(service, operation)
        self._published.add((service, operation))
        self._broker.watch(found, on_subscribed)
        return Publisher(self._broker, found)

    def open(
        self, service: str, operation: str, droppable: bool = False, admit: Admit = lambda *_: None
    ) -> None:
        """Open a PUBSUB operation of this broker for publishers in other processes.

        Its updates may be `droppable`, see `Publisher.publish`; `admit` may reject each of them.

        Raises:
            KeyError: The operation does not exist.
            ValueError: It has another pattern.
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
        """Start listening.

        Args:
            host: The address to listen on.
            port: The TCP port; 0 takes a free one.
            tls: TLS context with the trusted authorities; see `Certificates.for_provider`.
            clear_text: Whether to allow no TLS on an address that other hosts can reach.

        Raises:
            OSError: The address is not available.
            ValueError: Other hosts can reach the address, without TLS or `clear_text`.
        """
        host = address_to_listen(host)
        if tls is None and not clear_text and not is_loopback(host):
            raise ValueError(
                f"{host} is reachable from other hosts: give TLS certificates,"
                " or allow clear text, which any host may read and send"
            )
        self._uri = MalUri(host, await self._connections.listen(host, port, tls), self._name)

    def set_priority_check(self, is_priority: Callable[[Connection], bool]) -> None:
        """Set the check for connections with priority, which are never aborted for other peers."""
        self._connections.is_priority = is_priority

    @property
    def traffic(self) -> LinkTraffic:
        """The traffic of its consumers."""
        return self._connections.traffic

    @property
    def uri(self) -> MalUri:
        """Its URI, once started."""
        return self._uri

    async def close(self) -> None:
        """Stop listening, answer SHUTDOWN to active requests, and close all connections."""
        await self._connections.stop()
        for answer in self._running:
            answer.cancel()
        await asyncio.gather(*self._running, return_exceptions=True)
        await self._connections.close()

    def _pubsub(self, service: str, operation: str) -> Operation:
        found = self._specification.operation(service, operation)
        if found.pattern is not Pattern.PUBSUB:
            raise ValueError(f"{service}.{operation} is a {found.pattern.name}, not a PUBSUB")
        return found

    def _lose(self, connection: Connection) -> None:
        self._interactions.release(connection)
        self._broker.drop(connection)

    def _reject_oversized(self, connection: Connection, header: Header, error: MalError) -> None:
        """Answer a skipped message."""
        self._connections.warn("%s from %s skipped: %s", header.stage.name, connection.peer, error)
        if header.stage in REPLY and not header.is_error:
            ReplyPath(connection, header, self._codec, self._system).refuse(error)

    def _receive(self, connection: Connection, header: Header, body: bytes) -> None:
        if header.is_error or (
            header.stage not in REPLY and header.stage is not InteractionStage.SEND
        ):
            error = "error " if header.is_error else ""
            connection.refuse(f"{error}{header.stage.name} is no message of a consumer")
            return
        back = ReplyPath(connection, header, self._codec, self._system)
        try:
            operation = self._addressed(header)
            result = self._execute(back, operation, body)
            if inspect.isawaitable(result):
                answer: asyncio.Future[Parts | None] = asyncio.ensure_future(result)
                if header.stage is InteractionStage.REQUEST:
                    self._hold(connection, answer)
                self._running.add(answer)
                answer.add_done_callback(partial(self._on_answer, back, operation))
                return
            _reply(back, operation, result)
        except MalError as error:
            self._warn_of(back, error)
            back.refuse(error)
        except DecodeError as fault:
            bad_encoding = MalError(StandardError.BAD_ENCODING, str(fault))
            self._warn_of(back, bad_encoding)
            back.refuse(bad_encoding)
        except Exception:
            back.fail_internally()

    def _warn_of(self, back: ReplyPath, error: MalError) -> None:
        """Log an undecodable or wrongly addressed message, limited separately for each error."""
        if error.number in self._logged:
            header = back.header
            self._connections.warn(
                f"error {error.number} for %s of operation %d of service %d, area %d version %d,"
                " from %s (%s): %s",
                header.stage.name,
                header.operation,
                header.service,
                header.area,
                header.area_version,
                back.connection.peer,
                header.from_uri,
                error,
            )

    def _addressed(self, header: Header) -> Operation:
        if header.to_uri is None or header.to_uri.rpartition("/")[2] not in self._names:
            text = f"{header.to_uri} is not served here"
            raise MalError(StandardError.DESTINATION_UNKNOWN, text)
        return header.addressed(self._specification)

    def _execute(
        self, back: ReplyPath, operation: Operation, body: bytes
    ) -> Awaitable[Parts | None] | Parts | None:
        name, header = operation.names, back.header
        parts, client = operation.parts[header.stage], (back.connection, header, operation)
        match header.stage:
            case _ if name in self._handlers:
                values = self._codec.decode(parts, body)
                call = CallContext(
                    *name,
                    header.from_uri,
                    header.transaction_id,
                    header.supplements,
                    back.connection,
                    header.timestamp_ns,
                )
                if header.stage not in (InteractionStage.INVOKE, InteractionStage.PROGRESS):
                    return self._handlers[name](call, *values)
                self._begin(
                    Interaction(call, operation, back, self._warn_of), self._handlers[name], values
                )
            case InteractionStage.PUBLISH_REGISTER if name in self._opened:
                self._broker.register_publisher(*client, *self._codec.decode(parts, body))
            case InteractionStage.PUBLISH if name in self._opened:
                update, *rest = self._codec.decode(parts, body)
                self._broker.publish_for(*client, update, tuple(rest), self._opened[name])
            case InteractionStage.PUBLISH_DEREGISTER if name in self._opened:
                self._codec.decode(parts, body)
                self._broker.deregister_publisher(*client)
            case InteractionStage.PUBLISH_REGISTER | InteractionStage.PUBLISH_DEREGISTER:
                raise MalError(StandardError.UNSUPPORTED_OPERATION)
            case InteractionStage.PUBLISH:
                raise MalError(StandardError.INCORRECT_STATE)
            case InteractionStage.REGISTER if name in self._published:
                self._broker.register(*client, *self._codec.decode(parts, body))
            case InteractionStage.DEREGISTER if name in self._published:
                self._broker.deregister(*client, *self._codec.decode(parts, body))
            case _:
                raise MalError(self._not_served.number, self._not_served.extra)
        return None

    def _begin(self, interaction: Interaction, handler: Handler, parts: Parts) -> None:
        """Run the handler of an INVOKE or PROGRESS until it or the connection ends."""
        task = asyncio.ensure_future(interaction.run(handler, parts))
        self._hold(interaction.call.connection, task)
        self._running.add(task)
        task.add_done_callback(self._running.discard)

    def _hold(self, connection: Connection, work: "asyncio.Future[Any]") -> None:
        """Count work of a connection as active until it or the connection ends.

        Raises:
            MalError: TOO_MANY; the work is cancelled.
        """
        try:
            self._interactions.reserve(connection)
        except MalError:
            if not work.cancel() and not work.cancelled():
                work.exception()
            raise

        def cancel(_lost: asyncio.Future[None]) -> None:
            work.cancel()

        def end(_ended: "asyncio.Future[Any]") -> None:
            connection.lost.remove_done_callback(cancel)
            if not connection.lost.done():
                self._interactions.reserve(connection, -1)

        connection.lost.add_done_callback(cancel)
        work.add_done_callback(end)

    def _on_answer(
        self, back: ReplyPath, operation: Operation, answer: asyncio.Future[Parts | None]
    ) -> None:
        self._running.discard(answer)
        try:
            _reply(back, operation, answer.result())
        except MalError as error:
            self._warn_of(back, error)
            back.refuse(error)
        except asyncio.CancelledError:
            back.refuse(MalError(StandardError.SHUTDOWN))
        except Exception:
            back.fail_internally()


def _reply(back: ReplyPath, operation: Operation, parts: Parts | None) -> None:
    if back.header.stage not in _ANSWERED_SEPARATELY:
        back.send(operation, REPLY[back.header.stage], parts)
