"""`Broker` of a provider: subscriptions, matching, publishers in other processes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

from adapters.mal.admission import Quota
from adapters.mal.codec import Codec, Header, encode_message, encode_timestamp, restamped
from adapters.mal.connection import Connection
from adapters.mal.errors import MalError, StandardError, too_many
from adapters.mal.specification import ATTRIBUTES, InteractionStage, Names, Operation
from adapters.mal.values import (
    AttributeType,
    NullableAttribute,
    Subscription,
    SubscriptionFilter,
    TypedAttribute,
    UpdateHeader,
)
from adapters.system import System, utc_ns

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

Keys = dict[str, TypedAttribute | None]
"""Key values of an update by key name, in the order of the operation."""


def matches(subscription: Subscription, domain: tuple[str, ...] | None, keys: Keys) -> bool:
    """Whether an update matches a subscription: its domain and all filters."""
    return domain_matches(subscription.domain, domain) and all(
        _filter_matches(key_filter, keys) for key_filter in subscription.filters or ()
    )


def domain_matches(wanted: Sequence[str] | None, domain: Sequence[str] | None) -> bool:
    """Whether the domain of an update matches that of a subscription.

    NULL matches every domain, an empty domain every domain except NULL. A `*` matches one part; at
    the beginning or the end it matches any number of parts. As in mo-services-java 12.
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
        all(part in (_ANY, own) for part, own in zip(inner, domain[start:], strict=False))
        for start in range(first, last + 1)
    )


def _filter_matches(key_filter: SubscriptionFilter, keys: Keys) -> bool:
    if key_filter.name not in keys:
        return False
    value = keys[key_filter.name]
    return not key_filter.values or any(
        _value_matches(wanted, value) for wanted in key_filter.values
    )


def _value_matches(wanted: TypedAttribute | None, value: TypedAttribute | None) -> bool:
    if wanted is None:
        return value is None
    if wanted.type in _TEXTS:
        return wanted.value == _ANY or (
            value is not None and value.type in _TEXTS and wanted.value == value.value
        )
    return (wanted.type in _SIGNED and wanted.value == 0) or wanted == value


SUBSCRIPTION_SIZE: Final = 8192
"""Maximum size of one subscription: its characters, plus 16 for each name or value. Each update is
compared with all of them, so that an unbounded subscription could block the loop."""
_EACH: Final = 16


@dataclass(slots=True, eq=False)
class _Subscriber:
    """A consumer with its subscriptions, by names of service and operation and by subscription id.

    All its notifications have the transaction id of its first registration, as in
    mo-services-java.
    """

    connection: Connection
    uri: str | None
    broker_uri: str | None
    transaction_id: int
    subscriptions: dict[Names, dict[str, Subscription]] = field(default_factory=dict)
    _heads: dict[Names, bytes] = field(default_factory=dict)

    def head(self, operation: Operation) -> bytes:
        """Return the header of its notifications, as a message without a body."""
        names = operation.names
        if names not in self._heads:
            header = Header.of(
                operation,
                InteractionStage.NOTIFY,
                self.transaction_id,
                self.broker_uri,
                self.uri,
                0,
            )
            self._heads[names] = encode_message(header, b"")
        return self._heads[names]


Admit = Callable[..., None]
"""Called as `admit(connection, update_header, keys, *parts)`; raises MalError to reject."""


@dataclass(frozen=True, slots=True)
class PublishPolicy:
    """Policy of an operation for publishers in other processes.

    Attributes:
        droppable: Whether its updates may be dropped for a slow subscriber.
        admit: Called with each update before it is distributed.
    """

    droppable: bool
    admit: Admit


@dataclass(frozen=True, slots=True)
class _Registration:
    """A publisher of one operation: its URI and connection."""

    connection: Connection
    uri: str | None
    operation: Operation


class _Update:
    """An update for subscribers; encoded once for each distinct subscription."""

    def __init__(
        self,
        codec: Codec,
        operation: Operation,
        header: UpdateHeader,
        keys: Keys,
        parts: tuple[Any, ...],
        timestamp_ns: int,
    ) -> None:
        self.names = operation.names
        self._codec = codec
        self._operation = operation
        self._header = header
        self._keys = keys
        self._parts = parts
        self._timestamp = encode_timestamp(timestamp_ns)
        self._bodies: dict[tuple[str, tuple[str, ...] | None], bytes] = {}

    def messages(self, subscribers: Mapping[str | None, _Subscriber]) -> Iterator[bytes]:
        """Yield the notifications of all subscribers of one connection."""
        for subscriber in list(subscribers.values()):
            for subscription in list(subscriber.subscriptions.get(self.names, {}).values()):
                if matches(subscription, self._header.domain, self._keys):
                    head = subscriber.head(self._operation)
                    yield restamped(head, self._timestamp, self.body(subscription))

    def body(self, subscription: Subscription) -> bytes:
        """Return the encoded body for a subscription.

        Raises:
            EncodeError: A value does not fit the specification.
        """
        alike = (subscription.subscriptionId, subscription.selectedKeys)
        if alike not in self._bodies:
            selected = subscription.selectedKeys
            cut = UpdateHeader(
                source=self._header.source,
                domain=self._header.domain,
                keyValues=tuple(
                    NullableAttribute(value=value)
                    for name, value in self._keys.items()
                    if selected is None or name in selected
                ),
            )
            values = (subscription.subscriptionId, cut, *self._parts)
            self._bodies[alike] = self._codec.encode(
                self._operation.parts[InteractionStage.NOTIFY], values
            )
        return self._bodies[alike]


class Broker:
    """Manages the subscribers and remote publishers of one provider, while they are connected.

    An update is encoded for a connection when its peer accepts data, in fair turns: a peer with
    many subscriptions, or one that never reads, does not delay other peers.
    """

    def __init__(
        self, codec: Codec, subscriptions: Quota, publishers: Quota, system: System
    ) -> None:
        self._codec = codec
        self._system = system
        self._subscriptions = subscriptions
        self._publications = publishers
        self._subscribers: dict[Connection, dict[str | None, _Subscriber]] = {}
        self._publishers: dict[_Registration, dict[str, AttributeType]] = {}
        self._on_subscribed: dict[Names, Callable[[], None]] = {}

    def watch(self, operation: Operation, on_subscribed: Callable[[], None]) -> None:
        """Register a callback for new subscriptions to an operation."""
        self._on_subscribed[operation.service_name, operation.name] = on_subscribed

    def has_subscribers(self, operation: Operation) -> bool:
        """Whether an operation has subscribers."""
        names = operation.names
        return any(
            names in subscriber.subscriptions
            for behind in self._subscribers.values()
            for subscriber in behind.values()
        )

    def register(
        self,
        connection: Connection,
        header: Header,
        operation: Operation,
        subscription: Subscription,
    ) -> None:
        """Add a subscription, or replace the one with the same id.

        Raises:
            MalError: TOO_MANY subscriptions, or this one is too large.
        """
        if _size(subscription) > SUBSCRIPTION_SIZE:
            raise too_many(f"at most {SUBSCRIPTION_SIZE} characters in a subscription")
        names = operation.names
        subscriber = self._subscribers.get(connection, {}).get(header.from_uri) or _Subscriber(
            connection, header.from_uri, header.to_uri, header.transaction_id
        )
        if subscription.subscriptionId not in subscriber.subscriptions.get(names, {}):
            self._subscriptions.reserve(connection)
        self._subscribers.setdefault(connection, {})[header.from_uri] = subscriber
        own = subscriber.subscriptions.setdefault(names, {})
        own[subscription.subscriptionId] = subscription
        if names in self._on_subscribed:
            self._on_subscribed[names]()

    def deregister(
        self, connection: Connection, header: Header, operation: Operation, ids: tuple[str, ...]
    ) -> None:
        """Remove subscriptions; unknown ids are ignored."""
        subscribers = self._subscribers.get(connection, {})
        subscriber = subscribers.get(header.from_uri)
        if subscriber is None:
            return
        names = operation.names
        own = subscriber.subscriptions.get(names, {})
        for subscription_id in ids:
            if own.pop(subscription_id, None) is not None:
                self._subscriptions.reserve(connection, -1)
        if not own:
            subscriber.subscriptions.pop(names, None)
        if not subscriber.subscriptions:
            del subscribers[header.from_uri]
        if not subscribers:
            del self._subscribers[connection]

    def drop(self, connection: Connection) -> None:
        """Remove all subscribers and publishers of a connection."""
        self._subscribers.pop(connection, None)
        for known in [known for known in self._publishers if known.connection is connection]:
            del self._publishers[known]
        self._subscriptions.release(connection)
        self._publications.release(connection)

    def publish(
        self,
        operation: Operation,
        update: UpdateHeader,
        keys: Keys,
        parts: tuple[Any, ...],
        droppable: bool,
    ) -> None:
        """Notify all matching subscriptions of an update.

        Raises:
            EncodeError: A value does not match the specification; detected only with subscribers.
        """
        if not self._subscribers:
            return
        names, event = operation.names, None
        for connection, subscribers in list(self._subscribers.items()):
            for subscriber in subscribers.values():
                if own := subscriber.subscriptions.get(names):
                    if event is None:
                        now_ns = utc_ns(self._system)
                        event = _Update(self._codec, operation, update, keys, parts, now_ns)
                        event.body(next(iter(own.values())))
                    connection.notify(partial(event.messages, subscribers), droppable)
                    break

    def register_publisher(
        self,
        connection: Connection,
        header: Header,
        operation: Operation,
        names: tuple[str, ...],
        types: tuple[Any, ...],
    ) -> None:
        """Register a publisher in another process, with its keys in this order.

        Raises:
            MalError: UNKNOWN, the operation has other keys; TOO_MANY publishers.
        """
        keys = {key.name: ATTRIBUTES[key.type] for key in operation.keys}
        given = [AttributeType(kind.value) for kind in types]
        if sorted(names) != sorted(keys) or [keys[name] for name in names] != given:
            wanted = ", ".join(f"{name} {kind.name}" for name, kind in keys.items())
            raise _unknown_error(f"the keys of {operation.name} are {wanted}")
        registration = _Registration(connection, header.from_uri, operation)
        if registration not in self._publishers:
            self._publications.reserve(connection)
        self._publishers[registration] = {name: keys[name] for name in names}

    def deregister_publisher(
        self, connection: Connection, header: Header, operation: Operation
    ) -> None:
        """Remove a publisher; an unknown one is ignored."""
        if self._publishers.pop(_Registration(connection, header.from_uri, operation), None):
            self._publications.reserve(connection, -1)

    def publish_for(
        self,
        connection: Connection,
        header: Header,
        operation: Operation,
        update: UpdateHeader,
        parts: tuple[Any, ...],
        policy: PublishPolicy,
    ) -> None:
        """Publish an update of a publisher in another process.

        Raises:
            MalError: INCORRECT_STATE, it is not registered; UNKNOWN, the key values do not match
                its keys; or the error of the operation's `admit`.
        """
        kinds = self._publishers.get(_Registration(connection, header.from_uri, operation))
        if kinds is None:
            raise MalError(StandardError.INCORRECT_STATE)
        keys = _keys(kinds, update.keyValues)
        policy.admit(connection, update, keys, *parts)
        self.publish(operation, update, keys, parts, policy.droppable)


def _size(subscription: Subscription) -> int:
    texts: list[Any] = [subscription.subscriptionId]
    texts += [*(subscription.domain or ()), *(subscription.selectedKeys or ())]
    for key_filter in subscription.filters or ():
        texts += [
            key_filter.name,
            *(getattr(value, "value", 0) for value in key_filter.values or ()),
        ]
    return sum(_EACH + (len(t) if isinstance(t, str | bytes) else 0) for t in texts)


class Publisher:
    """Publishes the updates of one PUBSUB operation; call it on the provider's loop."""

    def __init__(self, broker: Broker, operation: Operation) -> None:
        self._broker = broker
        self._operation = operation
        self._kinds = {key.name: ATTRIBUTES[key.type] for key in operation.keys}

    @property
    def has_subscribers(self) -> bool:
        """Whether the operation has subscribers."""
        return self._broker.has_subscribers(self._operation)

    def publish(
        self,
        *parts: Any,
        keys: tuple[Any, ...],
        domain: tuple[str, ...],
        source: str | None = None,
        droppable: bool,
    ) -> None:
        """Notify all matching subscriptions.

        Args:
            parts: The parts of the update, without the update header.
            keys: A plain value or None for each subscription key of the operation, in order.
            domain: The domain of the update, outermost part first.
            source: The publisher.
            droppable: Whether it may be dropped for a slow subscriber, oldest first. Otherwise it
                is queued; a subscriber whose queue is full is disconnected.

        Raises:
            EncodeError: A value does not match the specification (detected only with subscribers).
            ValueError: The number of keys differs from the operation's.
        """
        typed = {
            name: None if value is None else TypedAttribute(kind, value)
            for (name, kind), value in zip(self._kinds.items(), keys, strict=True)
        }
        update = UpdateHeader(source=source, domain=domain)
        self._broker.publish(self._operation, update, typed, parts, droppable)


def _keys(kinds: dict[str, AttributeType], values: tuple[NullableAttribute, ...] | None) -> Keys:
    keys: dict[str, TypedAttribute | None] = {}
    if len(values or ()) != len(kinds):
        raise _unknown_error(f"{len(kinds)} key values expected, {len(values or ())} given")
    for (name, kind), given in zip(kinds.items(), values or (), strict=True):
        if given.value is not None and given.value.type is not kind:
            raise _unknown_error(f"key {name} is a {kind.name}, not a {given.value.type.name}")
        keys[name] = given.value
    return keys


def _unknown_error(why: str) -> MalError:
    return MalError(StandardError.UNKNOWN, why)
