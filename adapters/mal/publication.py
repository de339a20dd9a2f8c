"""The publisher's side of a PUBSUB whose broker is in another process."""

from typing import Any

from adapters.mal.binding import ATTRIBUTES
from adapters.mal.errors import MalError
from adapters.mal.exchange import Exchange
from adapters.mal.mal_area import NullableAttribute, UpdateHeader
from adapters.mal.pending import Parts
from adapters.mal.specification import Operation, Stage
from adapters.mal.values import Typed


class Publication:
    """A publisher of one operation, registered with a broker.

    The broker answers a publication only if it refuses it: the next call then raises its error.
    """

    def __init__(self, exchange: Exchange, operation: Operation) -> None:
        """Not to be called; see `Consumer.publication`."""
        self.operation = operation
        self._exchange = exchange
        self._names = (operation.service_name, operation.name)
        self._kinds = [ATTRIBUTES[key.type] for key in operation.keys]
        self._number = exchange.new_number()
        self._error: MalError | None = None

    async def publish(
        self,
        *parts: Any,
        keys: tuple[Any, ...],
        domain: tuple[str, ...],
        source: str | None = None,
    ) -> None:
        """Publish an update, and return when the connection takes more.

        Args:
            parts: The parts of the update, without the update header.
            keys: A plain value or None for each subscription key of the operation, in order.
            domain: The domain of the update, outermost part first.
            source: Who publishes.

        Raises:
            EncodeError: A value does not fit the specification.
            MalError: The broker refused an earlier update; this one is not sent.
                DESTINATION_LOST: the connection is gone.
            ValueError: There are more or fewer keys than the operation has.
        """
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        update = UpdateHeader(
            source=source,
            domain=domain,
            keyValues=tuple(
                NullableAttribute(value=None if value is None else Typed(kind, value))
                for kind, value in zip(self._kinds, keys, strict=True)
            ),
        )
        _, _, message = self._exchange.message(
            *self._names, Stage.PUBLISH, (update, *parts), number=self._number
        )
        self._exchange.connection.send(message)
        await self._exchange.connection.drained()

    async def register(self) -> None:
        """Tell the broker; to be called once."""
        types = tuple(self._kinds)
        names = tuple(key.name for key in self.operation.keys)
        await self._exchange.single(
            *self._names, Stage.PUBLISH_REGISTER, (names, types), number=self._number
        )
        self._exchange.keep(self._number, self)

    async def close(self) -> None:
        """Deregister.

        Raises:
            MalError: The broker's answer, DELIVERY_TIMEDOUT, or DESTINATION_LOST.
        """
        self._exchange.forget(self._number)
        await self._exchange.single(*self._names, Stage.PUBLISH_DEREGISTER, ())

    def expects(self, stage: Stage) -> bool:
        """Whether it is about an update."""
        return stage is Stage.PUBLISH

    def take(self, _stage: Stage, _parts: Parts, _octets: int) -> None:
        """Nobody publishes to a publisher."""

    def fail(self, error: MalError) -> None:
        """Keep an error for the next call."""
        self._error = error
