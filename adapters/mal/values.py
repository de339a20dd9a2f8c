"""Values that carry their MAL type, and references to objects."""

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
class Typed:
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
