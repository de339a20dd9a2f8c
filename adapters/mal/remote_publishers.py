"""Publishers in other processes, who publish through this broker."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from adapters.mal.binding import ATTRIBUTES
from adapters.mal.broker import Broker
from adapters.mal.connection import Connection
from adapters.mal.errors import MalError, StandardError
from adapters.mal.header import Header
from adapters.mal.mal_area import NullableAttribute, UpdateHeader
from adapters.mal.matching import Keys
from adapters.mal.specification import Operation
from adapters.mal.values import AttributeType, Typed

PUBLISHER_CAP: Final = 256
"""Registrations of publishers over one connection, at most."""

Admit = Callable[..., None]
"""Called as `admit(connection, update_header, keys, *parts)`; raises MalError to refuse."""


@dataclass(frozen=True, slots=True)
class Openness:
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


class RemotePublishers:
    """Knows who may publish what. A publisher whose connection is lost is forgotten."""

    def __init__(self, broker: Broker) -> None:
        """Begin without publishers."""
        self._broker = broker
        self._keys: dict[_Registration, dict[str, AttributeType]] = {}

    def register(
        self,
        connection: Connection,
        header: Header,
        operation: Operation,
        names: tuple[str, ...],
        types: tuple[Any, ...],
    ) -> None:
        """Let a publisher publish an operation with these keys, in this order.

        Args:
            connection: Where it is.
            header: Of its PUBLISH_REGISTER.
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
        registration = _Registration(connection, header.from_uri, operation)
        others = sum(known.connection is connection for known in self._keys)
        if others == PUBLISHER_CAP and registration not in self._keys:
            raise MalError(StandardError.TOO_MANY)
        self._keys[registration] = {name: keys[name] for name in names}

    def deregister(self, connection: Connection, header: Header, operation: Operation) -> None:
        """Forget a publisher; one that is not there is none."""
        self._keys.pop(_Registration(connection, header.from_uri, operation), None)

    def drop(self, connection: Connection) -> None:
        """Forget everybody behind a connection."""
        for known in [known for known in self._keys if known.connection is connection]:
            del self._keys[known]

    def publish(
        self,
        connection: Connection,
        header: Header,
        operation: Operation,
        update: UpdateHeader,
        parts: tuple[Any, ...],
        openness: Openness,
    ) -> None:
        """Notify every subscription that an update matches.

        Raises:
            MalError: INCORRECT_STATE, it is not registered; UNKNOWN, the key values are not
                those of its keys; or what the operation's `admit` raises.
        """
        kinds = self._keys.get(_Registration(connection, header.from_uri, operation))
        if kinds is None:
            raise MalError(StandardError.INCORRECT_STATE)
        keys = _keys(kinds, update.keyValues)
        openness.admit(connection, update, keys, *parts)
        self._broker.publish(operation, update, keys, parts, openness.droppable)


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
