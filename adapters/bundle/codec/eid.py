"""Endpoint identifiers: `ipn:1.2`, `dtn://name/service`, and the null endpoint `dtn:none`."""

import re
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

from adapters.bundle.codec import cbor

_DTN, _IPN = 1, 2  # URI scheme codes (RFC 9171, 4.2.5.1)
_IPN_TEXT: Final = re.compile(r"ipn:(?:(\d{1,10})\.)?(\d{1,20})\.(\d{1,20})", re.ASCII)
_DTN_TEXT: Final = re.compile(r"dtn:(//[!-~]+)", re.ASCII)
_MAX_TEXT_LENGTH: Final = 1024  # chosen, not measured


@dataclass(frozen=True, slots=True)
class Ipn:
    """Endpoint of the ipn scheme (RFC 9758).

    Attributes:
        allocator: allocator identifier; 0 is the default allocator.
        three_elements: whether the encoding has the allocator as a separate element. A received
            EID is forwarded in the encoding it had.
    """

    node: int
    service: int
    allocator: int = 0
    three_elements: bool = field(default=False, compare=False)

    def __str__(self) -> str:
        allocator = f"{self.allocator}." if self.allocator else ""
        return f"ipn:{allocator}{self.node}.{self.service}"


@dataclass(frozen=True, slots=True)
class Dtn:
    """Endpoint of the dtn scheme (RFC 9171, 4.2.5.1.1); the empty name is the null endpoint."""

    name: str = ""

    def __str__(self) -> str:
        return f"dtn:{self.name}" if self.name else "dtn:none"


Eid = Ipn | Dtn
NONE: Final[Eid] = Dtn()


def is_null(eid: Eid) -> bool:
    """Return whether this is the null endpoint, `dtn:none` or `ipn:0.0`.

    Node 0 of the default allocator is null with any service number (RFC 9758, 3.4.1).
    """
    return eid == NONE if isinstance(eid, Dtn) else not (eid.node or eid.allocator)


def node_of(eid: Eid) -> Eid:
    """Return the endpoint of the node itself, `ipn:5.0` for `ipn:5.1`."""
    if isinstance(eid, Ipn):
        return Ipn(eid.node, 0, eid.allocator)
    return Dtn("//" + eid.name[2:].split("/")[0] + "/") if eid.name else eid


def parse_eid(text: str) -> Eid:
    """Parse the text form of an endpoint identifier.

    Raises:
        ValueError: the text is no endpoint identifier.
    """
    if text == "dtn:none":
        return NONE
    if found := _IPN_TEXT.fullmatch(text):
        allocator, node, service = (int(number or 0) for number in found.groups())
        if max(node, service) <= cbor.MAX_UNSIGNED and allocator < 2**32:
            return Ipn(node, service, allocator, three_elements=bool(allocator))
    if (found := _DTN_TEXT.fullmatch(text)) and len(text) <= _MAX_TEXT_LENGTH:
        return Dtn(found[1])
    raise ValueError(f"not an endpoint such as ipn:1.2 or dtn://name/service: {text!r}")


def encode_eid(eid: Eid) -> bytes:
    """Encode an endpoint identifier (RFC 9171, 4.2.5.1)."""
    if isinstance(eid, Dtn):
        return b"\x82\x01" + (cbor.text(eid.name) if eid.name else b"\x00")
    node, service = cbor.unsigned(eid.node), cbor.unsigned(eid.service)
    if eid.three_elements or eid.allocator:
        return b"\x82\x02\x83" + cbor.unsigned(eid.allocator) + node + service
    return b"\x82\x02\x82" + node + service


def read_eid(reader: cbor.Reader) -> Eid:
    """Read an endpoint identifier (RFC 9171, 4.2.5.1).

    Raises:
        DecodeError: the scheme is neither dtn nor ipn, or the endpoint is malformed.
    """
    reader.array_of(2)
    scheme = reader.unsigned()
    if scheme == _IPN:
        if reader.array_of(2, 3) == 2:
            return Ipn(reader.unsigned(), reader.unsigned())
        allocator, node, service = reader.unsigned(), reader.unsigned(), reader.unsigned()
        return Ipn(node, service, allocator, three_elements=True)
    if scheme != _DTN:
        raise reader.fail(f"endpoint of unknown scheme {scheme}, neither dtn (1) nor ipn (2)")
    if not reader.is_text():
        if reader.unsigned():
            raise reader.fail("dtn endpoint is neither text nor 0")
        return NONE
    name = reader.text()
    if not _DTN_TEXT.fullmatch(f"dtn:{name}") or len(name) > _MAX_TEXT_LENGTH:
        raise reader.fail("malformed dtn endpoint")
    return Dtn(name)


@lru_cache(256)
def decode_eid(octets: bytes) -> Eid:
    """Decode octets that are exactly one endpoint identifier.

    Raises:
        DecodeError: the octets are no endpoint identifier, or more follows.
    """
    reader = cbor.Reader(octets)
    eid = read_eid(reader)
    reader.finish()
    return eid
