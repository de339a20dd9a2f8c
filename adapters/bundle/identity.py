"""What tells one bundle from every other (RFC 9171, 4.2.7)."""

from dataclasses import dataclass

from adapters.bundle import cbor
from adapters.bundle.eid import Eid, encode_eid, read_eid
from adapters.bundle.values import Creation, Primary


@dataclass(frozen=True, slots=True)
class BundleId:
    """Who made a bundle, and which of theirs it is; all its fragments have the same."""

    source: Eid
    creation: Creation

    def __str__(self) -> str:
        return f"{self.source} {self.creation.time_ms}.{self.creation.sequence}"

    @property
    def key(self) -> bytes:
        """The identity as octets, for the store."""
        creation = self.creation
        return (
            encode_eid(self.source)
            + cbor.unsigned(creation.time_ms)
            + cbor.unsigned(creation.sequence)
        )


def identity_of(primary: Primary) -> BundleId:
    """Return the identity of a bundle."""
    return BundleId(primary.source, primary.creation)


def from_key(key: bytes) -> BundleId:
    """Return the identity that has this key."""
    reader = cbor.Reader(key)
    source = read_eid(reader)
    return BundleId(source, Creation(reader.unsigned(), reader.unsigned()))
