"""The data of the extension blocks (RFC 9171, 4.4): previous node, bundle age, hop count."""

from dataclasses import dataclass

from adapters.bundle import cbor


@dataclass(frozen=True, slots=True)
class HopCount:
    """How many nodes may forward a bundle, and how many have."""

    limit: int
    count: int


def encode_age(age_ms: int) -> bytes:
    """Encode the age of a bundle, in milliseconds."""
    return cbor.unsigned(age_ms)


def decode_age(data: bytes) -> int:
    """Return the age of a bundle, in milliseconds.

    Raises:
        DecodeError: it is none.
    """
    reader = cbor.Reader(data)
    age_ms = reader.unsigned()
    reader.finish()
    return age_ms


def encode_hop_count(hops: HopCount) -> bytes:
    """Encode a hop count."""
    return cbor.array(2) + cbor.unsigned(hops.limit) + cbor.unsigned(hops.count)


def decode_hop_count(data: bytes) -> HopCount:
    """Decode a hop count.

    Raises:
        DecodeError: it is none, or its limit is not between 1 and 255.
    """
    reader = cbor.Reader(data)
    reader.array_of(2)
    hops = HopCount(reader.unsigned(), reader.unsigned())
    reader.finish()
    if not 1 <= hops.limit <= 255:
        raise reader.fail(f"hop limit {hops.limit}")
    return hops
