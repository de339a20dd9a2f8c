"""RTP packets (RFC 3550, section 5.1), as far as a receiver of video needs them."""

from dataclasses import dataclass
from typing import Final

VERSION: Final = 2
FIXED: Final = 12
"""Octets of the header without lists and extension."""


@dataclass(frozen=True, slots=True)
class RtpPacket:
    """One packet.

    Attributes:
        marker: whether it ends a frame.
        timestamp: when the frame was taken, in ticks of the format's clock.
        source: which stream it belongs to (SSRC).
    """

    marker: bool
    kind: int
    sequence: int
    timestamp: int
    source: int
    payload: bytes


def read_packet(octets: bytes) -> RtpPacket | None:
    """Return the packet that a datagram holds, or None if it holds none."""
    if len(octets) < FIXED or octets[0] >> 6 != VERSION:
        return None
    start = FIXED + 4 * (octets[0] & 0x0F)
    if octets[0] & 0x10:
        start += 4 + 4 * int.from_bytes(octets[start + 2 : start + 4])
    end = len(octets) - (octets[-1] if octets[0] & 0x20 else 0)
    if start > end:
        return None
    return RtpPacket(
        marker=bool(octets[1] & 0x80),
        kind=octets[1] & 0x7F,
        sequence=int.from_bytes(octets[2:4]),
        timestamp=int.from_bytes(octets[4:8]),
        source=int.from_bytes(octets[8:12]),
        payload=octets[start:end],
    )
