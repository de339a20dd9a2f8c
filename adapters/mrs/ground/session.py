"""`RoverSession`: connections to a rover, restored after losses; `SessionAuthority` of a client."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from socket import gaierror
from typing import Any, Final
from urllib.parse import urlsplit

from adapters.mal import SCHEME, MalError, MalUri, StandardError
from adapters.mrs.ground.rover_consumer import Dialer, RoverConsumer, repeated
from adapters.mrs.spec import NAME, PORT, AuthorityStatus, describe_error
from adapters.mrs.transport import TransportMismatchError, TransportSettings
from adapters.system import OPERATING_SYSTEM, System

_LOG: Final = logging.getLogger(__name__)

RECONNECT_S: Final = 0.2
"""Period of reconnection attempts; chosen, not measured."""
SET_UP_ATTEMPTS: Final = 6
"""Attempts of directory and subscriptions on a link that may lose whole messages; chosen."""


NOTICEABLE_S: Final = 1.0
"""Round-trip time above which an operator acts on an old picture of the rover; chosen."""


@dataclass(frozen=True, slots=True)
class LinkDelay:
    """Round-trip time of a link between ground and rover.

    Attributes:
        declared_s: as declared to the client, s; 0 without a declaration.
        measured_s: of the last answered heartbeat, s; None before the first.
    """

    declared_s: float = 0.0
    measured_s: float | None = None

    @property
    def round_trip_s(self) -> float:
        """The measured round-trip time, s; the declared one until it is measured."""
        return self.declared_s if self.measured_s is None else self.measured_s

    @property
    def one_way_s(self) -> float:
        """Time from one end to the other, s: half of the round trip."""
        return self.round_trip_s / 2

    @property
    def is_noticeable(self) -> bool:
        """Whether the declared one is noticeable; a slow answer does not change this."""
        return self.declared_s >= NOTICEABLE_S


Connected = tuple[RoverConsumer, asyncio.Future[None]]


class UnknownHostError(ConnectionError):
    """The host name of an address cannot be resolved."""


def parse_address(text: str) -> MalUri:
    """Parse the address of a rover: `maltcp://host:port/name`, `host:port` or `host`.

    Raises:
        ValueError: it is none of these.
    """
    if text.lower().startswith(f"{SCHEME}:"):
        return MalUri.parse(text)
    parts = urlsplit(f"//{text}")
    if not parts.hostname or parts.path or parts.username:
        raise ValueError(f"{text!r} is not host, host:port or {SCHEME}://host:port/name")
    return MalUri(parts.hostname, parts.port or PORT, NAME)


class RoverSession:
    """Keeps a consumer connected to all services of a rover.

    `open` makes the first connection.

    Args:
        uri: address of the rover's directory, which lists all other addresses.
        name: the last part of the consumer's own URI.
        terms: encoding and certificates, the same as the rover's.
        restore: called with every new consumer before its first use.
        on_failure: called once, if reconnection failed.
        timeout_s: timeout of a connection attempt and of each reply.
        patience_s: maximum time of reconnection attempts after a loss; 0 for none.
        system: clock of messages.
    """

    def __init__(
        self,
        uri: MalUri,
        name: str,
        terms: TransportSettings,
        restore: Callable[[RoverConsumer], Awaitable[None]] | None,
        on_failure: Callable[[ConnectionError], None] | None,
        timeout_s: float,
        patience_s: float,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self.uri = uri
        self._name = name
        self._terms, self._system = terms, system
        self._timeout_s = timeout_s
        self._dialer = Dialer(name, terms, timeout_s, system)
        self._restore = restore
        self._on_failure = on_failure
        self._patience_s = patience_s
        self._consumer: RoverConsumer | None = None
        self._settled = asyncio.Event()
        self._fault: ConnectionError | None = None
        self._keeper: asyncio.Task[None] | None = None

    def separate(self) -> "RoverSession":
        """Return a session with the same rover over separate connections."""
        rest = (self._timeout_s, self._patience_s, self._system)
        return RoverSession(self.uri, self._name, self._terms, None, None, *rest)

    async def open(self, *, patiently: bool = False) -> None:
        """Connect for the first time.

        On a link with a noticeable delay the directory's address is used for all services until
        its answer, also after a loss, so that a stop arrives after one light time.

        Args:
            patiently: whether to retry as after a loss.

        Raises:
            ConnectionError: no rover answers there.
        """
        end_s = asyncio.get_running_loop().time() + self._patience_s
        begun = await (self._reconnect(end_s, None) if patiently else self._connect())
        self._keeper = asyncio.create_task(self._restore_losses(*begun))

    async def consumer(self) -> RoverConsumer:
        """Return the consumer, once it is connected.

        Raises:
            ConnectionError: the reconnection failed, or the session is closed.
        """
        await self._settled.wait()
        if self._consumer is None:
            raise self._fault or ConnectionError("the session is closed")
        return self._consumer

    async def drop(self, consumer: RoverConsumer) -> None:
        """Close a consumer without answers, so that it is not used again."""
        if consumer is self._consumer and self._fault is None:
            self._settled.clear()
        await consumer.close()

    async def close(self) -> None:
        """Close all connections, even if this is cancelled."""
        try:
            if self._keeper is not None:
                self._keeper.cancel()
                await asyncio.gather(self._keeper, return_exceptions=True)
        finally:
            consumer, self._consumer = self._consumer, None
            self._settled.set()
            if consumer is not None:
                await consumer.close()

    async def _restore_losses(self, consumer: RoverConsumer, set_up: asyncio.Future[None]) -> None:
        loop = asyncio.get_running_loop()
        end_s: float | None = None
        while True:
            try:
                await set_up
                if end_s is not None:
                    _LOG.warning("connection with %s recovered", self.uri)
                end_s = None
                await consumer.wait_lost()
                fault = ConnectionError(f"the connection with {self.uri} was lost")
            except ConnectionError as error:
                if end_s is None and not (consumer.has_answered and _is_loss(error.__cause__)):
                    return self._fail(error)
                fault = error
            self._settled.clear()
            await consumer.close()
            if end_s is None:
                end_s = loop.time() + self._patience_s
                waits = f": it is tried again for {self._patience_s:g} s" * (self._patience_s > 0)
                _LOG.warning("connection with %s lost%s", self.uri, waits)
            else:
                await asyncio.sleep(RECONNECT_S)
            try:
                consumer, set_up = await self._reconnect(end_s, fault)
            except ConnectionError as error:
                return self._fail(error)

    def _fail(self, fault: ConnectionError) -> None:
        self._consumer, self._fault = None, fault
        self._settled.set()
        if self._on_failure is not None:
            self._on_failure(fault)

    async def _reconnect(self, end_s: float, fault: ConnectionError | None) -> Connected:
        """Connect, with attempts until a time of the loop; raises the last fault."""
        loop = asyncio.get_running_loop()
        while fault is None or loop.time() < end_s:
            try:
                return await self._connect()
            except ConnectionError as error:
                fault = error
                await asyncio.sleep(RECONNECT_S)
        raise fault

    async def _connect(self) -> Connected:
        """Return a consumer with its set-up, which has ended unless the delay is noticeable."""
        try:
            consumer = RoverConsumer(await self._dialer.connect(self.uri), self._dialer)
        except MalError as error:
            raise self._no_answer(error) from error
        set_up: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        if self._terms.round_trip_s < NOTICEABLE_S or self._restore is None:
            await self._set_up(consumer, at_once=False)
            set_up.set_result(None)
        else:
            set_up = asyncio.ensure_future(self._set_up(consumer, at_once=True))
            for _ in range(2):  # directory and subscriptions are requested before any command
                await asyncio.sleep(0)
        self._consumer = consumer
        self._settled.set()
        return consumer, set_up

    async def _set_up(self, consumer: RoverConsumer, *, at_once: bool) -> None:
        restore = self._restore or _restore_nothing
        try:
            if at_once:
                restoring = repeated(partial(restore, consumer), SET_UP_ATTEMPTS)
                await asyncio.gather(consumer.discover(self.uri, SET_UP_ATTEMPTS), restoring)
            else:
                await consumer.discover(self.uri)
            if not at_once or consumer.is_distributed:
                await restore(consumer)
        except BaseException as error:
            await consumer.close()
            if isinstance(error, MalError):
                raise self._wrong_answer(error) from error
            raise

    def _no_answer(self, error: MalError) -> ConnectionError:
        if error.number == StandardError.AUTHENTICATION_FAILED.value:
            why = str(getattr(error.extra, "value", error)).removeprefix(f"{self.uri}: ")
            return TransportMismatchError(f"{self.uri} is not trusted: {why}")
        cause = error.__cause__
        if isinstance(cause, gaierror):
            return UnknownHostError(f"unknown host {self.uri.host}")
        if self._terms.certificates is None or isinstance(cause, ConnectionRefusedError):
            return ConnectionError(f"no answer at {self.uri}")
        return TransportMismatchError(f"no TLS answer at {self.uri}: perhaps it uses clear text")

    def _wrong_answer(self, error: MalError) -> ConnectionError:
        if _is_loss(error):
            if error.extra is not None:
                text = f"{self.uri} does not answer like a rover: {error.extra.value}"
                return ConnectionError(f"{text}; the rover is at {self.uri.host}:{PORT}")
            if self._terms.certificates is None:
                return TransportMismatchError(f"{self.uri} closed the connection: is TLS needed?")
            return TransportMismatchError(
                f"{self.uri} closed the connection: it does not trust this certificate"
            )
        text = f"{self.uri} does not answer like a rover: {describe_error(error)}"
        if error.number == StandardError.BAD_ENCODING.value:
            return TransportMismatchError(
                f"{text}; does it use another encoding than {self._terms.encoding.value}?"
            )
        return ConnectionError(text)


def _is_loss(error: BaseException | None) -> bool:
    return isinstance(error, MalError) and error.number == StandardError.DESTINATION_LOST.value


async def _restore_nothing(_: RoverConsumer) -> None:
    pass


RENEWALS: Final = 3
"""Renewals within the time of a lease, so that one lost answer does not end it."""

SendAuthorityRequest = Callable[..., Awaitable[AuthorityStatus]]


class SessionAuthority:
    """Requests the authority of a rover, and renews it.

    Its methods raise MalError if the rover refuses, with the holder's name, and ConnectionError if
    the link does not recover in time.

    Args:
        send_request: calls an operation of the service Authority.
        renews: whether to renew the lease periodically; otherwise only each request renews it.

    Attributes:
        epoch: epoch of the authority that commands claim; None for no claim.
    """

    def __init__(
        self, send_request: SendAuthorityRequest, source: str, *, renews: bool = True
    ) -> None:
        self._send_request = send_request
        self._renews = renews
        self.source = source
        self.epoch: int | None = None
        self._renewing: asyncio.Task[None] | None = None

    async def status(self) -> AuthorityStatus:
        """Return the status of the authority, with its holder."""
        return await self._send_request("getAuthority")

    async def ensure(self) -> None:
        """Request the authority if commands need it; ignored if the rover lacks the service."""
        try:
            status = await self.status()
        except MalError:
            return
        if status.needed:
            await self.request()

    async def request(self) -> AuthorityStatus:
        """Request the authority. If another source holds it, its holder is notified."""
        return self._held(await self._send_request("requestAuthority", self.source))

    async def take(self) -> AuthorityStatus:
        """Take the authority over from its holder, if the rover's settings allow this source to."""
        return self._held(await self._send_request("takeAuthority", self.source))

    async def hand_over(self, to: str, lease_s: float | None = None) -> AuthorityStatus:
        """Hand the authority over, with a lease in s; None for the default lease."""
        epoch = (await self.request()).epoch
        status = await self._send_request("handOver", self.source, epoch, to, lease_s)
        self.detach()
        return status

    async def release(self) -> AuthorityStatus:
        """Release the authority."""
        epoch = self.epoch if self.epoch is not None else (await self.status()).epoch
        status = await self._send_request("releaseAuthority", self.source, epoch)
        self.detach()
        return status

    def detach(self) -> None:
        """Stop claiming and renewing it; it ends with its lease."""
        self.epoch = None
        if self._renewing is not None:
            self._renewing.cancel()
            self._renewing = None

    async def wait_lost(self) -> None:
        """Wait until the authority is lost."""
        if self._renewing is not None:
            await asyncio.wait((self._renewing,))

    def _held(self, status: AuthorityStatus) -> AuthorityStatus:
        self.epoch = status.epoch
        if self._renews and self._renewing is None:
            self._renewing = asyncio.create_task(self._renew(status.lease))
        return status

    async def _renew(self, lease_s: float) -> None:
        try:
            while True:
                await asyncio.sleep(lease_s / RENEWALS)
                status: Any = await self._send_request("requestAuthority", self.source)
                self.epoch, lease_s = status.epoch, status.lease
        except (MalError, ConnectionError):
            self.epoch = self._renewing = None
