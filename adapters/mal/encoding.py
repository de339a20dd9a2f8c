"""The body encodings, and how each attribute type is put into them."""

from enum import Enum
from typing import Final

from adapters.mal.values import AttributeType


class Encoding(Enum):
    """How bodies are written; both sides agree on it beforehand, the header does not tell."""

    FIXED = "fixed"
    VARIABLE = "variable"
    SPLIT = "split"


PRIMITIVE: Final = {
    AttributeType.BLOB: "blob",
    AttributeType.BOOLEAN: "boolean",
    AttributeType.DURATION: "double",
    AttributeType.FLOAT: "single",
    AttributeType.DOUBLE: "double",
    AttributeType.IDENTIFIER: "string",
    AttributeType.OCTET: "octet",
    AttributeType.UOCTET: "uoctet",
    AttributeType.SHORT: "short",
    AttributeType.USHORT: "ushort",
    AttributeType.INTEGER: "integer",
    AttributeType.UINTEGER: "uinteger",
    AttributeType.LONG: "long",
    AttributeType.ULONG: "ulong",
    AttributeType.STRING: "string",
    AttributeType.TIME: "time",
    AttributeType.FINETIME: "finetime",
    AttributeType.URI: "string",
    AttributeType.OBJECTREF: "objectref",
}
"""Attribute type to the method of `reader.Reader` and `writer.Writer` that carries it."""

EPOCH_DAYS: Final = 4383
"""Days from 1958-01-01, the CCSDS epoch of CDS time codes, to 1970-01-01."""
DAY_MS: Final = 86_400_000
MS_NS: Final = 1_000_000
MAX_DEPTH: Final = 64
"""Composites inside composites, at most."""
MAX_ELEMENTS: Final = 1 << 20
"""List elements in one message, at most: an element may cost no octet at all (a false bit)."""
