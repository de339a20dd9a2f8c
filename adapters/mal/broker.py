"""The broker of a provider: subscriptions, publishers in other processes, and matching."""

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


def _value_matches(wanted: TypedAttribute | None, value: TypedAttribute | None) -> bool:
    if wanted is None:
        return value is None
    if wanted.type in _TEXTS:
        return wanted.value == _ANY or (
            value is not None and value.type in _TEXTS and wanted.value == value.value
        )
    return (wanted.type in _SIGNED and wanted.value == 0) or wanted == value


SUBSCRIPTION_SIZE: Final = 8192
"""Of one subscription, at most: characters, and 16 for each name or value. All of them are compared
with each update, so that without a bound one consumer could keep the loop."""
_EACH: Final = 16


@dataclass(slots=True, eq=False)
class _Subscriber:
    """A consumer with its subscriptions, by the names of service and operation, and their own id.

    Its notifications all carry the transaction id of its first registration, as those of
    mo-services-java do.
    """

    connection: Connection
    uri: str | None
    broker_uri: str | None
    transaction_id: int
    subscriptions: dict[Names, dict[str, Subscription]] = field(default_factory=dict)
    _heads: dict[Names, bytes] = field(default_factory=dict)

    def head(self, operation: Operation) -> bytes:
        """The header of its notifications, as a message without a body."""
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


class _Update:
    """An update on its way to the subscribers, encoded as it is wanted."""

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
        """Make the notifications of those who are behind one connection."""
        for subscriber in list(subscribers.values()):
            for subscription in list(subscriber.subscriptions.get(self.names, {}).values()):
                if matches(subscription, self._header.domain, self._keys):
                    head = subscriber.head(self._operation)
                    yield restamped(head, self._timestamp, self.body(subscription))

    def body(self, subscription: Subscription) -> bytes:
        """Encode it for a subscription.

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
    """Knows the subscribers and the remote publishers of one provider, while they are connected.

    An update is made into messages for a connection when its peer takes them, in its turn: who
    registered much, or never reads, does not make others wait.
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
        """Call back when somebody has subscribed to an operation."""
        self._on_subscribed[operation.service_name, operation.name] = on_subscribed

    def has_subscribers(self, operation: Operation) -> bool:
        """Whether anybody is subscribed to an operation."""
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
        """Add a subscription, or replace the one of the same id.

        Raises:
            MalError: TOO_MANY subscriptions, or too much in this one.
        """
        if _size(subscription) > SUBSCRIPTION_SIZE:
            raise too_many(f"at most {SUBSCRIPTION_SIZE} characters in a subscription")
        names = operation.names
        subscriber = self._subscribers.get(connection, {}).get(header.from_uri) or _Subscriber(
            connection, header.from_uri, header.to_uri, header.transaction_id
        )
        if subscription.subscriptionId not in subscriber.subscriptions.get(names, {}):
            self._subscriptions.take(connection)
        self._subscribers.setdefault(connection, {})[header.from_uri] = subscriber
        own = subscriber.subscriptions.setdefault(names, {})
        own[subscription.subscriptionId] = subscription
        if names in self._on_subscribed:
            self._on_subscribed[names]()

    def deregister(
        self, connection: Connection, header: Header, operation: Operation, ids: tuple[str, ...]
    ) -> None:
        """Remove subscriptions; those that are not there are none."""
        subscribers = self._subscribers.get(connection, {})
        subscriber = subscribers.get(header.from_uri)
        if subscriber is None:
            return
        names = operation.names
        own = subscriber.subscriptions.get(names, {})
        for subscription_id in ids:
            if own.pop(subscription_id, None) is not None:
                self._subscriptions.take(connection, -1)
        if not own:
            subscriber.subscriptions.pop(names, None)
        if not subscriber.subscriptions:
            del subscribers[header.from_uri]
        if not subscribers:
            del self._subscribers[connection]

    def drop(self, connection: Connection) -> None:
        """Forget everybody behind a connection."""
        self._subscribers.pop(connection, None)
        for known in [known for known in self._publishers if known.connection is connection]:
            del self._publishers[known]
        self._subscriptions.drop(connection)
        self._publications.drop(connection)

    def publish(
        self,
        operation: Operation,
        update: UpdateHeader,
        keys: Keys,
        parts: tuple[Any, ...],
        droppable: bool,
    ) -> None:
        """Notify every subscription that an update matches.

        Raises:
            EncodeError: A value does not fit the specification; noticed when somebody subscribed.
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
        """Let a publisher in another process publish an operation with these keys, in this order.

        Raises:
            MalError: UNKNOWN, these are not the keys of the operation; TOO_MANY publishers.
        """
        keys = {key.name: ATTRIBUTES[key.type] for key in operation.keys}
        given = [AttributeType(kind.value) for kind in types]
        if sorted(names) != sorted(keys) or [keys[name] for name in names] != given:
            wanted = ", ".join(f"{name} {kind.name}" for name, kind in keys.items())
            raise _unknown(f"the keys of {operation.name} are {wanted}")
        registration = _Registration(connection, header.from_uri, operation)
        if registration not in self._publishers:
            self._publications.take(connection)
        self._publishers[registration] = {name: keys[name] for name in names}

    def deregister_publisher(
        self, connection: Connection, header: Header, operation: Operation
    ) -> None:
        """Forget a publisher; one that is not there is none."""
        if self._publishers.pop(_Registration(connection, header.from_uri, operation), None):
            self._publications.take(connection, -1)

    def publish_for(
        self,
        connection: Connection,
        header: Header,
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
    """Publishes the updates of one PUBSUB operation; to be called on the provider's loop."""

    def __init__(self, broker: Broker, operation: Operation) -> None:
        self._broker = broker
        self._operation = operation
        self._kinds = {key.name: ATTRIBUTES[key.type] for key in operation.keys}

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody is subscribed."""
        return self._broker.has_subscribers(self._operation)

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
            name: None if value is None else TypedAttribute(kind, value)
            for (name, kind), value in zip(self._kinds.items(), keys, strict=True)
        }
        update = UpdateHeader(source=source, domain=domain)
        self._broker.publish(self._operation, update, typed, parts, droppable)


def _keys(kinds: dict[str, AttributeType], values: tuple[NullableAttribute, ...] | None) -> Keys:
    keys: dict[str, TypedAttribute | None] = {}
    if len(values or ()) != len(kinds):
        raise _unknown(f"{len(kinds)} key values wanted, {len(values or ())} given")
    for (name, kind), given in zip(kinds.items(), values or (), strict=True):
        if given.value is not None and given.value.type is not kind:
            raise _unknown(f"key {name} is a {kind.name}, not a {given.value.type.name}")
        keys[name] = given.value
    return keys


def _unknown(why: str) -> MalError:
    return MalError(StandardError.UNKNOWN, why)
