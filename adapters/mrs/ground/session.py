"""A connection to one rover that is made again when it is lost."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from socket import gaierror
from typing import Final
from urllib.parse import urlsplit

from adapters.mal import SCHEME, MalError, MalUri, StandardError
from adapters.mrs.ground.rover_consumer import Dialer, RoverConsumer
from adapters.mrs.spec import NAME, PORT, describe_error
from adapters.mrs.terms import TransportMismatchError, TransportSettings
from adapters.system import OPERATING_SYSTEM, System

_LOG: Final = logging.getLogger(__name__)

PAUSE_S: Final = 0.2
"""Between two attempts to connect again."""


class UnknownHostError(ConnectionError):
    """The name in an address stands for no computer."""


def parse_address(text: str) -> MalUri:
    """Read where a rover is: `maltcp://host:port/name`, `host:port` or `host`.

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
    """Keeps a consumer connected with all services of a rover.

    Nothing is connected yet.

    Args:
        uri: where the rover's directory is; it tells where the rest is.
        name: the last part of the consumer's own URI.
        terms: what was agreed on with the rover.
        restore: called with every new consumer before anybody else gets it.
        give_up: called once, when the rover did not come back.
        timeout_s: how long to wait for a connection, and for each reply.
        patience_s: how long to go on trying after a loss; 0 for not at all.
        system: the time of messages.
    """

    def __init__(
        self,
        uri: MalUri,
        name: str,
        terms: TransportSettings,
        restore: Callable[[RoverConsumer], Awaitable[None]] | None,
        give_up: Callable[[ConnectionError], None] | None,
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
        self._give_up = give_up
        self._patience_s = patience_s
        self._consumer: RoverConsumer | None = None
        self._settled = asyncio.Event()
        self._fault: ConnectionError | None = None
        self._keeper: asyncio.Task[None] | None = None

    def separate(self) -> "RoverSession":
        """Return a session with the same rover over connections of its own, for one purpose."""
        rest = (self._timeout_s, self._patience_s, self._system)
        return RoverSession(self.uri, self._name, self._terms, None, None, *rest)

    async def open(self, *, patiently: bool = False) -> None:
        """Connect for the first time.

        Args:
            patiently: whether to go on trying, as after a loss.

        Raises:
            ConnectionError: nobody answers as a rover does.
        """
        consumer = await (self._connect_again() if patiently else self._connect())
        self._keeper = asyncio.create_task(self._keep(consumer))

    async def consumer(self) -> RoverConsumer:
        """Return the consumer, once it is connected.

        Raises:
            ConnectionError: the rover did not come back, or the session is closed.
        """
        await self._settled.wait()
        if self._consumer is None:
            raise self._fault or ConnectionError("the session is closed")
        return self._consumer

    async def drop(self, consumer: RoverConsumer) -> None:
        """Let nobody have a consumer again over which nothing comes any more."""
        if consumer is self._consumer and self._fault is None:
            self._settled.clear()
        await consumer.close()

    async def close(self) -> None:
        """Hang up, even if this is cancelled."""
        try:
            if self._keeper is not None:
                self._keeper.cancel()
                await asyncio.gather(self._keeper, return_exceptions=True)
        finally:
            consumer, self._consumer = self._consumer, None
            self._settled.set()
            if consumer is not None:
                await consumer.close()

    async def _keep(self, consumer: RoverConsumer) -> None:
        while True:
            await consumer.lost()
            self._settled.clear()
            await consumer.close()
            _LOG.warning("connection with %s lost", self.uri)
            try:
                if self._patience_s <= 0.0:
                    raise ConnectionError(f"the connection with {self.uri} was lost")
                consumer = await self._connect_again()
            except ConnectionError as fault:
                self._consumer, self._fault = None, fault
                self._settled.set()
                if self._give_up is not None:
                    self._give_up(fault)
                return
            _LOG.warning("connection with %s is back", self.uri)

    async def _connect_again(self) -> RoverConsumer:
        loop = asyncio.get_running_loop()
        end_s = loop.time() + self._patience_s
        while True:
            try:
                return await self._connect()
            except ConnectionError:
                if loop.time() >= end_s:
                    raise
                await asyncio.sleep(PAUSE_S)

    async def _connect(self) -> RoverConsumer:
        try:
            directory = await self._dialer.connect(self.uri)
        except MalError as error:
            raise self._no_answer(error) from error
        consumer = RoverConsumer(directory, self._dialer)
        try:
            await consumer.discover(self.uri)
            if self._restore is not None:
                await self._restore(consumer)
        except BaseException as error:
            await consumer.close()
            if isinstance(error, MalError):
                raise self._wrong_answer(error) from error
            raise
        self._consumer = consumer
        self._settled.set()
        return consumer

    def _no_answer(self, error: MalError) -> ConnectionError:
        if error.number == StandardError.AUTHENTICATION_FAILED.value:
            why = str(getattr(error.extra, "value", error)).removeprefix(f"{self.uri}: ")
            return TransportMismatchError(f"{self.uri} cannot be believed: {why}")
        cause = error.__cause__
        if isinstance(cause, gaierror):
            return UnknownHostError(f"no computer is known by the name {self.uri.host}")
        if self._terms.certificates is None or isinstance(cause, ConnectionRefusedError):
            return ConnectionError(f"nobody answers at {self.uri}")
        return TransportMismatchError(
            f"nobody answers by TLS at {self.uri}: a rover there may speak clear text"
        )

    def _wrong_answer(self, error: MalError) -> ConnectionError:
        if error.number == StandardError.DESTINATION_LOST.value:
            if self._terms.certificates is None:
                return TransportMismatchError(f"{self.uri} hung up: does it ask for certificates?")
            return TransportMismatchError(
                f"{self.uri} hung up: it does not believe this certificate"
            )
        text = f"{self.uri} does not answer as a rover does: {describe_error(error)}"
        if error.number == StandardError.BAD_ENCODING.value:
            return TransportMismatchError(
                f"{text}; is its encoding another than {self._terms.encoding.value}?"
            )
        return ConnectionError(text)
