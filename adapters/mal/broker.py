"""The broker of a provider: keeps subscriptions, and notifies whoever an update is for."""

import time
from dataclasses import dataclass, field
from typing import Any, Final

from adapters.mal.binding import ATTRIBUTES
from adapters.mal.codec import Codec
from adapters.mal.connection import Connection
from adapters.mal.errors import MalError, StandardError
from adapters.mal.header import Header, encode_message
from adapters.mal.mal_area import NullableAttribute, Subscription, UpdateHeader
from adapters.mal.matching import Keys, matches
from adapters.mal.specification import Operation, Stage
from adapters.mal.values import Typed

SUBSCRIPTION_CAP: Final = 256
"""Subscriptions over one connection, at most."""
SUBSCRIPTION_SIZE: Final = 8192
"""Of one subscription, at most: characters, and 16 for each name or value. All of them are compared
with each update, so that without a bound one consumer could keep the loop."""
_EACH: Final = 16


@dataclass(slots=True, eq=False)
class _Subscriber:
    """A consumer with its subscriptions, by the names of service and operation and their own id.

    Its notifications all carry the transaction id of its first registration, as those of
    mo-services-java do.
    """

    connection: Connection
    uri: str | None
    broker_uri: str | None
    transaction_id: int
    subscriptions: dict[tuple[str, str, str], Subscription] = field(default_factory=dict)


class Broker:
    """Knows the subscribers of one provider. A subscriber whose connection is lost is forgotten."""

    def __init__(self, codec: Codec) -> None:
        """Begin without subscribers."""
        self._codec = codec
        self._subscribers: dict[tuple[Connection, str | None], _Subscriber] = {}

    def register(
        self,
        connection: Connection,
        header: Header,
        operation: Operation,
        subscription: Subscription,
    ) -> None:
        """Add a subscription, or replace the one of the same id.

        Raises:
            MalError: TOO_MANY subscriptions over this connection, or too much in this one.
        """
        if _size(subscription) > SUBSCRIPTION_SIZE:
            raise MalError(StandardError.TOO_MANY)
        others = [s for (known, _), s in self._subscribers.items() if known is connection]
        if sum(len(subscriber.subscriptions) for subscriber in others) >= SUBSCRIPTION_CAP:
            raise MalError(StandardError.TOO_MANY)
        subscriber = self._subscribers.setdefault(
            (connection, header.from_uri),
            _Subscriber(connection, header.from_uri, header.to_uri, header.transaction_id),
        )
        key = (operation.service_name, operation.name, subscription.subscriptionId)
        subscriber.subscriptions[key] = subscription

    def deregister(
        self, connection: Connection, header: Header, operation: Operation, ids: tuple[str, ...]
    ) -> None:
        """Remove subscriptions; those that are not there are none."""
        subscriber = self._subscribers.get((connection, header.from_uri))
        if subscriber is None:
            return
        for subscription_id in ids:
            key = (operation.service_name, operation.name, subscription_id)
            subscriber.subscriptions.pop(key, None)
        if not subscriber.subscriptions:
            del self._subscribers[connection, header.from_uri]

    def drop(self, connection: Connection) -> None:
        """Forget everybody behind a connection."""
        for key in [key for key in self._subscribers if key[0] is connection]:
            del self._subscribers[key]

    def publish(
        self,
        operation: Operation,
        update: UpdateHeader,
        keys: Keys,
        parts: tuple[Any, ...],
        droppable: bool,
    ) -> None:
        """Notify every subscription that an update matches."""
        bodies: dict[tuple[str, tuple[str, ...] | None], bytes] = {}
        for subscriber in list(self._subscribers.values()):
            for (service, name, _), subscription in subscriber.subscriptions.items():
                if (service, name) == (operation.service_name, operation.name) and matches(
                    subscription, update.domain, keys
                ):
                    alike = (subscription.subscriptionId, subscription.selectedKeys)
                    if alike not in bodies:
                        bodies[alike] = self._body(operation, subscription, update, keys, parts)
                    message = encode_message(_header(operation, subscriber), bodies[alike])
                    subscriber.connection.notify(message, droppable)

    def _body(
        self,
        operation: Operation,
        subscription: Subscription,
        update: UpdateHeader,
        keys: Keys,
        parts: tuple[Any, ...],
    ) -> bytes:
        selected = subscription.selectedKeys
        cut = UpdateHeader(
            source=update.source,
            domain=update.domain,
            keyValues=tuple(
                NullableAttribute(value=value)
                for name, value in keys.items()
                if selected is None or name in selected
            ),
        )
        values = (subscription.subscriptionId, cut, *parts)
        return self._codec.encode(operation.parts[Stage.NOTIFY], values)


def _size(subscription: Subscription) -> int:
    texts: list[Any] = [subscription.subscriptionId]
    texts += [*(subscription.domain or ()), *(subscription.selectedKeys or ())]
    for key_filter in subscription.filters or ():
        texts += [
            key_filter.name,
            *(getattr(value, "value", 0) for value in key_filter.values or ()),
        ]
    return sum(_EACH + (len(t) if isinstance(t, str | bytes) else 0) for t in texts)


def _header(operation: Operation, subscriber: _Subscriber) -> Header:
    return Header.of(
        operation,
        Stage.NOTIFY,
        subscriber.transaction_id,
        from_uri=subscriber.broker_uri,
        to_uri=subscriber.uri,
        timestamp_ns=time.time_ns(),
    )


class Publisher:
    """Publishes the updates of one PUBSUB operation; to be called on the provider's loop."""

    def __init__(self, broker: Broker, operation: Operation) -> None:
        """Publish an operation's updates through a broker."""
        self._broker = broker
        self._operation = operation
        self._kinds = {key.name: ATTRIBUTES[key.type] for key in operation.keys}

    def publish(
        self,
        *parts: Any,
        keys: tuple[Any, ...],
        domain: tuple[str, ...],
        source: str | None = None,
        droppable: bool,
    ) -> None:
        """Notify all subscribers that this update is for.

        Args:
            parts: The parts of the update, without the update header.
            keys: A plain value or None for each subscription key of the operation, in order.
            domain: The domain of the update, outermost part first.
            source: Who publishes.
            droppable: Whether it may be dropped, the oldest first, for a subscriber that is too
                slow. One that may not waits; the subscriber is disconnected when too many wait.

        Raises:
            EncodeError: A value does not fit the specification (noticed when somebody subscribed).
            ValueError: There are more or fewer keys than the operation has.
        """
        typed = {
            name: None if value is None else Typed(kind, value)
            for (name, kind), value in zip(self._kinds.items(), keys, strict=True)
        }
        update = UpdateHeader(source=source, domain=domain)
        self._broker.publish(self._operation, update, typed, parts, droppable)
