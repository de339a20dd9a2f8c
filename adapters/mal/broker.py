"""The broker of a provider: subscriptions, publishers in other processes, and matching."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from adapters.mal.binding import ATTRIBUTES
from adapters.mal.codec import Codec
from adapters.mal.connection import Connection
from adapters.mal.errors import MalError, StandardError
from adapters.mal.interaction import ReplyPath
from adapters.mal.message import Header, encode_message
from adapters.mal.specification import Operation, Stage
from adapters.mal.values import (
    AttributeType,
    NullableAttribute,
    Subscription,
    SubscriptionFilter,
    Typed,
    UpdateHeader,
)

_ANY: Final = "*"
_TEXTS: Final = (AttributeType.IDENTIFIER, AttributeType.STRING, AttributeType.URI)
_SIGNED: Final = (
    AttributeType.OCTET,
    AttributeType.SHORT,
    AttributeType.INTEGER,
    AttributeType.LONG,
    AttributeType.FLOAT,
    AttributeType.DOUBLE,
)

Keys = dict[str, Typed | None]
"""The key values of an update by the names of the keys, in their order."""


def matches(subscription: Subscription, domain: tuple[str, ...] | None, keys: Keys) -> bool:
    """Whether an update is for a subscription: its domain and all of its filters match."""
    return domain_matches(subscription.domain, domain) and all(
        _filter_matches(key_filter, keys) for key_filter in subscription.filters or ()
    )


def domain_matches(wanted: Sequence[str] | None, domain: Sequence[str] | None) -> bool:
    """Whether a domain is wanted.

    A wanted domain that is NULL takes every domain, an empty one every domain but NULL. A `*`
    stands for one part, at the beginning or the end for any number of parts.
    """
    if wanted is None or domain is None:
        return wanted is None
    if not wanted:
        return True
    open_front, open_end = wanted[0] == _ANY, wanted[-1] == _ANY
    inner = wanted[open_front : len(wanted) - open_end]
    slack = len(domain) - len(inner)
    if slack < 0 or (slack and not open_front and not open_end):
        return False
    first = slack if open_front and not open_end else 0
    last = slack if open_front else 0
    return any(
        all(part in (_ANY, there) for part, there in zip(inner, domain[start:], strict=False))
        for start in range(first, last + 1)
    )


def _filter_matches(key_filter: SubscriptionFilter, keys: Keys) -> bool:
    if key_filter.name not in keys:
        return False
    value = keys[key_filter.name]
    return not key_filter.values or any(
        _value_matches(wanted, value) for wanted in key_filter.values
    )


def _value_matches(wanted: Typed | None, value: Typed | None) -> bool:
    if wanted is None:
        return value is None
    if wanted.type in _TEXTS:
        return wanted.value == _ANY or (
            value is not None and value.type in _TEXTS and wanted.value == value.value
        )
    return (wanted.type in _SIGNED and wanted.value == 0) or wanted == value


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


PUBLISHER_CAP: Final = 256
"""Registrations of publishers over one connection, at most."""

Admit = Callable[..., None]
"""Called as `admit(connection, update_header, keys, *parts)`; raises MalError to refuse."""


@dataclass(frozen=True, slots=True)
class PublishPolicy:
    """How an operation is open to publishers in other processes.

    Attributes:
        droppable: Whether its updates may be dropped for a subscriber that is too slow.
        admit: Called with each update before it is sent on.
    """

    droppable: bool
    admit: Admit


@dataclass(frozen=True, slots=True)
class _Registration:
    """One publisher of one operation: who it is, and over which connection it came."""

    connection: Connection
    uri: str | None
    operation: Operation


class Broker:
    """Knows the subscribers and the remote publishers of one provider, while they are connected."""

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self._subscribers: dict[tuple[Connection, str | None], _Subscriber] = {}
        self._publishers: dict[_Registration, dict[str, AttributeType]] = {}

    def register(self, back: ReplyPath, operation: Operation, subscription: Subscription) -> None:
        """Add a subscription, or replace the one of the same id.

        Raises:
            MalError: TOO_MANY subscriptions over this connection, or too much in this one.
        """
        if _size(subscription) > SUBSCRIPTION_SIZE:
            raise MalError(StandardError.TOO_MANY)
        connection, header = back.connection, back.header
        others = [s for (known, _), s in self._subscribers.items() if known is connection]
        if sum(len(subscriber.subscriptions) for subscriber in others) >= SUBSCRIPTION_CAP:
            raise MalError(StandardError.TOO_MANY)
        subscriber = self._subscribers.setdefault(
            (connection, header.from_uri),
            _Subscriber(connection, header.from_uri, header.to_uri, header.transaction_id),
        )
        key = (operation.service_name, operation.name, subscription.subscriptionId)
        subscriber.subscriptions[key] = subscription

    def deregister(self, back: ReplyPath, operation: Operation, ids: tuple[str, ...]) -> None:
        """Remove subscriptions; those that are not there are none."""
        known = (back.connection, back.header.from_uri)
        subscriber = self._subscribers.get(known)
        if subscriber is None:
            return
        for subscription_id in ids:
            key = (operation.service_name, operation.name, subscription_id)
            subscriber.subscriptions.pop(key, None)
        if not subscriber.subscriptions:
            del self._subscribers[known]

    def drop(self, connection: Connection) -> None:
        """Forget everybody behind a connection."""
        for key in [key for key in self._subscribers if key[0] is connection]:
            del self._subscribers[key]
        for known in [known for known in self._publishers if known.connection is connection]:
            del self._publishers[known]

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

    def register_publisher(
        self, back: ReplyPath, operation: Operation, names: tuple[str, ...], types: tuple[Any, ...]
    ) -> None:
        """Let a publisher in another process publish an operation with these keys, in this order.

        Args:
            back: The way to the publisher.
            operation: What it will publish.
            names: The names of the keys.
            types: The MAL's AttributeType of each.

        Raises:
            MalError: UNKNOWN, these are not the keys of the operation; TOO_MANY publishers.
        """
        keys = {key.name: ATTRIBUTES[key.type] for key in operation.keys}
        given = [AttributeType(kind.value) for kind in types]
        if sorted(names) != sorted(keys) or [keys[name] for name in names] != given:
            wanted = ", ".join(f"{name} {kind.name}" for name, kind in keys.items())
            raise _unknown(f"the keys of {operation.name} are {wanted}")
        registration = _Registration(back.connection, back.header.from_uri, operation)
        others = sum(known.connection is back.connection for known in self._publishers)
        if others == PUBLISHER_CAP and registration not in self._publishers:
            raise MalError(StandardError.TOO_MANY)
        self._publishers[registration] = {name: keys[name] for name in names}

    def deregister_publisher(self, back: ReplyPath, operation: Operation) -> None:
        """Forget a publisher; one that is not there is none."""
        self._publishers.pop(_Registration(back.connection, back.header.from_uri, operation), None)

    def publish_for(
        self,
        back: ReplyPath,
        operation: Operation,
        update: UpdateHeader,
        parts: tuple[Any, ...],
        policy: PublishPolicy,
    ) -> None:
        """Publish what a publisher in another process sent.

        Raises:
            MalError: INCORRECT_STATE, it is not registered; UNKNOWN, the key values are not
                those of its keys; or what the operation's `admit` raises.
        """
        kinds = self._publishers.get(
            _Registration(back.connection, back.header.from_uri, operation)
        )
        if kinds is None:
            raise MalError(StandardError.INCORRECT_STATE)
        keys = _keys(kinds, update.keyValues)
        policy.admit(back.connection, update, keys, *parts)
        self.publish(operation, update, keys, parts, policy.droppable)

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


def _keys(kinds: dict[str, AttributeType], values: tuple[NullableAttribute, ...] | None) -> Keys:
    keys: dict[str, Typed | None] = {}
    if len(values or ()) != len(kinds):
        raise _unknown(f"{len(kinds)} key values wanted, {len(values or ())} given")
    for (name, kind), given in zip(kinds.items(), values or (), strict=True):
        if given.value is not None and given.value.type is not kind:
            raise _unknown(f"key {name} is a {kind.name}, not a {given.value.type.name}")
        keys[name] = given.value
    return keys


def _unknown(why: str) -> MalError:
    return MalError(StandardError.UNKNOWN, Typed(AttributeType.STRING, why))
