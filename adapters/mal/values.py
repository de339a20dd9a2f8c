"""Types of the MAL area (CCSDS 521.0-B-3) that this stack uses; field names are the standard's."""

# ruff: noqa: N815 - names are those of the specification

from dataclasses import dataclass
from enum import Enum
from typing import Any


class AttributeType(Enum):
    """Attribute types with their short forms (CCSDS 521.0-B-3); also an enumeration of the MAL."""

    BLOB = 1
    BOOLEAN = 2
    DURATION = 3
    FLOAT = 4
    DOUBLE = 5
    IDENTIFIER = 6
    OCTET = 7
    UOCTET = 8
    SHORT = 9
    USHORT = 10
    INTEGER = 11
    UINTEGER = 12
    LONG = 13
    ULONG = 14
    STRING = 15
    TIME = 16
    FINETIME = 17
    URI = 18
    OBJECTREF = 19


@dataclass(frozen=True, slots=True)
class TypedAttribute:
    """An attribute with its type, where the specification has Attribute or Element.

    Attributes:
        type: The encoded attribute type.
        value: The plain Python value (times in ns since 1970 UTC, durations in s).
    """

    type: AttributeType
    value: Any


@dataclass(frozen=True, slots=True)
class TypedList:
    """A list where the specification has Element, e.g. an error's extra information.

    Attributes:
        type: Type of the elements: an attribute type, the class of a composite or enumeration, or
            None if each element has its own type.
    """

    type: AttributeType | type | None
    values: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class ObjectRef:
    """A reference to an MO object (CCSDS 521.0-B-3).

    Attributes:
        domain: The domain of the object, outermost part first.
        type: The type id of the object, 64 bits.
        key: The object's name within its domain and type.
    """

    domain: tuple[str, ...]
    type: int
    key: str
    version: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedValue:
    """An attribute with a name."""

    name: str
    value: TypedAttribute | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class NullableAttribute:
    """A nullable attribute in a list, since lists have no NULL elements."""

    value: TypedAttribute | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceId:
    """A service, identified by its numbers."""

    keyArea: int
    keyService: int
    keyAreaVersion: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SubscriptionFilter:
    """A filter on one key; any of the values must match."""

    name: str
    values: tuple[TypedAttribute, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Subscription:
    """A subscription of a consumer.

    Attributes:
        subscriptionId: Name of the subscription, chosen by the consumer.
        domain: Domain of the updates, with wildcards; NULL for all.
        selectedKeys: Names of the keys to send; NULL for all.
        filters: Filters on keys; all must match; NULL for none.
    """

    subscriptionId: str
    domain: tuple[str, ...] | None = None
    selectedKeys: tuple[str, ...] | None = None
    filters: tuple[SubscriptionFilter, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateHeader:
    """Source, domain (outermost part first) and key values (in their order) of an update."""

    source: str | None = None
    domain: tuple[str, ...] | None = None
    keyValues: tuple[NullableAttribute, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectIdentity:
    """Unique identity of an MO object."""

    domain: tuple[str, ...]
    key: str
    version: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Object:
    """Base of MO objects: composites with an identity."""

    objectIdentity: ObjectIdentity
