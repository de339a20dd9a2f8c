"""Types of area MAL, written by adapters.mal.generate from mal.xml."""

# ruff: noqa: N815 - names are those of the specification

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from adapters.mal.values import Typed


class InteractionType(Enum):
    """An interaction pattern."""

    SEND = 1
    SUBMIT = 2
    REQUEST = 3
    INVOKE = 4
    PROGRESS = 5
    PUBSUB = 6


class SessionType(Enum):
    """What a session shows."""

    LIVE = 1
    SIMULATION = 2
    REPLAY = 3


class QoSLevel(Enum):
    """How hard a message is tried."""

    BESTEFFORT = 1
    ASSURED = 2
    QUEUED = 3
    TIMELY = 4


class MOArea(Enum):
    """Area numbers in use."""

    MAL = 1
    COM = 2
    COMMON = 3
    MC = 4
    MPS = 5
    SM = 7
    MDPD = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Object:
    """The base of MO objects: composites with an identity of their own.

    Attributes:
        objectIdentity: Which object this is.
    """

    objectIdentity: ObjectIdentity


@dataclass(frozen=True, slots=True, kw_only=True)
class Subscription:
    """What a consumer wants to be notified of.

    Attributes:
        subscriptionId: Name of the subscription, the consumer's choice.
        domain: Domain of the updates, with wildcards; NULL for all.
        selectedKeys: Names of the keys to be sent; NULL for all.
        filters: Filters on keys, all of which must match; NULL for none.
    """

    subscriptionId: str
    domain: tuple[str, ...] | None = None
    selectedKeys: tuple[str, ...] | None = None
    filters: tuple[SubscriptionFilter, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SubscriptionFilter:
    """What one key may be.

    Attributes:
        name: Name of the key.
        values: Values of which one must match.
    """

    name: str
    values: tuple[Typed, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateHeader:
    """Where an update comes from and what it is of.

    Attributes:
        source: Who published it.
        domain: Domain, outermost part first.
        keyValues: Values of the keys, in their order.
    """

    source: str | None = None
    domain: tuple[str, ...] | None = None
    keyValues: tuple[NullableAttribute, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class IdBooleanPair:
    """A name with yes or no.

    Attributes:
        id: The name.
        value: Yes or no.
    """

    id: str
    value: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Two attributes.

    Attributes:
        first: The first.
        second: The second.
    """

    first: Typed | None = None
    second: Typed | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedValue:
    """An attribute with a name.

    Attributes:
        name: The name.
        value: The attribute.
    """

    name: str
    value: Typed | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class File:
    """What is known of a file, with its content or without.

    Attributes:
        name: Its name.
        mimeType: Its media type.
        creationDate: When it was made. (ns since 1970 UTC)
        modificationDate: When it was last changed. (ns since 1970 UTC)
        size: Its size in octets.
        content: Its content.
        metaData: Whatever else is known.
    """

    name: str
    mimeType: str | None = None
    creationDate: int | None = None
    modificationDate: int | None = None
    size: int | None = None
    content: bytes | None = None
    metaData: tuple[NamedValue, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectIdentity:
    """What tells one MO object from all others.

    Attributes:
        domain: The domain it lives in.
        key: Its name there.
        version: Its version.
    """

    domain: tuple[str, ...]
    key: str
    version: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceId:
    """A service, by its numbers.

    Attributes:
        keyArea: Number of the area.
        keyService: Number of the service.
        keyAreaVersion: Version of the area.
    """

    keyArea: int
    keyService: int
    keyAreaVersion: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NullableAttribute:
    """An attribute in a list that has no NULL.

    Attributes:
        value: The attribute.
    """

    value: Typed | None = None
