"""What a bundle consists of (RFC 9171, 4.2 and 4.3), as values."""

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final

from adapters.bundle.crc import Crc
from adapters.bundle.eid import Eid

DTN_EPOCH_UTC_MS: Final = 946_684_800_000
PAYLOAD_NUMBER: Final = 1


class Flag(IntFlag):
    """Bundle processing control flags (4.2.3)."""

    FRAGMENT = 0x1
    ADMINISTRATIVE = 0x2
    MUST_NOT_FRAGMENT = 0x4
    ACKNOWLEDGE = 0x20
    REPORT_TIMES = 0x40
    REPORT_RECEPTION = 0x4000
    REPORT_FORWARDING = 0x10000
    REPORT_DELIVERY = 0x20000
    REPORT_DELETION = 0x40000


REPORTS: Final = int(
    Flag.REPORT_RECEPTION | Flag.REPORT_FORWARDING | Flag.REPORT_DELIVERY | Flag.REPORT_DELETION
)


class BlockFlag(IntFlag):
    """Block processing control flags (4.2.4)."""

    REPLICATE = 0x1
    REPORT_IF_UNKNOWN = 0x2
    DELETE_BUNDLE_IF_UNKNOWN = 0x4
    DISCARD_IF_UNKNOWN = 0x10


class BlockType(IntEnum):
    """The blocks that RFC 9171 and RFC 9172 define."""

    PAYLOAD = 1
    PREVIOUS_NODE = 6
    BUNDLE_AGE = 7
    HOP_COUNT = 10
    INTEGRITY = 11
    CONFIDENTIALITY = 12


@dataclass(frozen=True, slots=True)
class Creation:
    """When a bundle was made, in milliseconds since 2000, and its number within that time."""

    time_ms: int
    sequence: int


@dataclass(frozen=True, slots=True)
class Part:
    """Which octets of an application data unit a fragment carries: from where, and of how many."""

    offset: int
    total: int


@dataclass(frozen=True, slots=True)
class Primary:
    """The primary block.

    Attributes:
        flags: a sum of `Flag`s; unknown ones are kept.
        part: for a fragment only.
    """

    destination: Eid
    source: Eid
    report_to: Eid
    creation: Creation
    lifetime_ms: int
    flags: int = 0
    crc: Crc = Crc.CRC32C
    part: Part | None = None


@dataclass(frozen=True, slots=True)
class Block:
    """A canonical block.

    Attributes:
        type: a `BlockType`, or one that is not known here.
        flags: a sum of `BlockFlag`s.
    """

    type: int
    number: int
    data: bytes
    flags: int = 0
    crc: Crc = Crc.NONE


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle; the payload is the last of its blocks."""

    primary: Primary
    blocks: tuple[Block, ...]

    @property
    def payload(self) -> bytes:
        """The application data, or the part of it that a fragment carries."""
        return self.blocks[-1].data

    def block(self, kind: BlockType) -> Block | None:
        """Return the first block of a type, if there is one."""
        return next((block for block in self.blocks if block.type == kind), None)
