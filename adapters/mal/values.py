"""The types of the MAL itself that this stack and its users handle; field names are its own."""

# ruff: noqa: N815 - names are those of the specification

from dataclasses import dataclass
from enum import Enum
from typing import Any


class AttributeType(Enum):
    """The attribute types, by their short forms; the MAL has an enumeration of the same."""

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
    """An attribute that must carry its type: the specification says Attribute or Element.

    Attributes:
        type: The attribute type it travels as.
        value: The plain Python value (times in ns since 1970 UTC, durations in s).
    """

    type: AttributeType
    value: Any


@dataclass(frozen=True, slots=True)
class TypedList:
    """A list where the specification says Element, for instance an error's extra information.

    Attributes:
        type: What the elements are: an attribute type, the class of a composite or enumeration,
            or None for a list whose elements each carry their own type.
        values: The elements.
    """

    type: AttributeType | type | None
    values: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class ObjectRef:
    """A reference to an MO object (CCSDS 521.0-B-3).

    Attributes:
        domain: The domain the object lives in, outermost part first.
        type: The type id of the object, 64 bits.
        key: The object's name within its domain and type.
        version: The object's version.
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
    """An attribute in a list that has no NULL."""

    value: TypedAttribute | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceId:
    """A service, by its numbers."""

    keyArea: int
    keyService: int
    keyAreaVersion: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SubscriptionFilter:
    """The values of one key, of which one must match."""

    name: str
    values: tuple[TypedAttribute, ...]


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
class UpdateHeader:
    """Source, domain (outermost part first) and key values (in their order) of an update."""

    source: str | None = None
    domain: tuple[str, ...] | None = None
    keyValues: tuple[NullableAttribute, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectIdentity:
    """What tells one MO object from all others."""

    domain: tuple[str, ...]
    key: str
    version: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Object:
    """The base of MO objects: composites with an identity of their own.

    Attributes:
        objectIdentity: Which object this is.
    """

    objectIdentity: ObjectIdentity
