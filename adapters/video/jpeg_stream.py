"""`JpegStream` reassembles JPEG pictures from RTP packets (RFC 3550, RFC 2435) in any order.

The Huffman tables, which RTP leaves out, are those of ITU-T T.81, annex K.3.
"""

from dataclasses import dataclass
from typing import Final

VERSION: Final = 2
FIXED: Final = 12
"""Length of the fixed header in octets, without lists and extension (RFC 3550, 5.1)."""


@dataclass(frozen=True, slots=True)
class RtpPacket:
    """One packet.

    Attributes:
        marker: whether it ends a frame.
        timestamp: time of the frame, in ticks of the format's clock.
        source: stream that it belongs to (SSRC).
    """

    marker: bool
    kind: int
    sequence: int
    timestamp: int
    source: int
    payload: bytes


def read_packet(octets: bytes) -> RtpPacket | None:
    """Return the packet in a datagram, or None if it is none."""
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


KIND: Final = 26
"""Payload type of JPEG in RTP (RFC 3551)."""
CLOCK_HZ: Final = 90_000
SAMPLING: Final = {0: 0x21, 1: 0x22}
"""Sampling of luminance by RFC 2435's type: 4:2:2 and 4:2:0."""
_RESTARTS: Final = 64  # types from 64 on have restart markers (RFC 2435, 3.1.3)
_TABLES_FOLLOW: Final = 128  # Q from 128 on: tables are in the stream (RFC 2435, 3.1.4)


class JpegStream:
    """Reassembles pictures.

    It reads streams that carry their quantization tables, as GStreamer, FFmpeg and rover-sim send
    them; pictures with tables computed from Q (below 128) count as lost.

    Attributes:
        lost: pictures with a missing or invalid part.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._picture: _Picture | None = None
        self._tables: dict[int, tuple[bytes, bytes]] = {}

    def add(self, datagram: bytes) -> bytes | None:
        """Add a datagram; return the JPEG file that it completes, or None."""
        packet = read_packet(datagram)
        if packet is None or packet.kind != KIND:
            return None
        picture = self._picture
        if picture is None or picture.name != (packet.source, packet.timestamp):
            self.lost += picture is not None
            picture = self._picture = _Picture(packet)
        try:
            picture.add(packet, self._tables)
        except (LookupError, ValueError):
            picture.broken = True
        if not picture.complete:
            return None
        self._picture = None
        return picture.file()


class _Picture:
    """An incomplete picture."""

    def __init__(self, packet: RtpPacket) -> None:
        self.name = (packet.source, packet.timestamp)
        self.broken = False
        self._layout: Layout | None = None
        self._parts: dict[int, bytes] = {}
        self._end: int | None = None

    @property
    def complete(self) -> bool:
        return (
            not self.broken
            and self._layout is not None
            and self._end == sum(map(len, self._parts.values()))
        )

    def file(self) -> bytes:
        assert self._layout is not None
        return jpeg_file(self._layout, b"".join(self._parts[at] for at in sorted(self._parts)))

    def add(self, packet: RtpPacket, tables: dict[int, tuple[bytes, bytes]]) -> None:
        head, rest = packet.payload[:8], packet.payload[8:]
        offset, kind, quality = int.from_bytes(head[1:4]), head[4], head[5]
        restart = 0
        if kind >= _RESTARTS:
            restart, rest = int.from_bytes(rest[:2]), rest[4:]
        if offset == 0:
            if quality < _TABLES_FOLLOW:
                raise ValueError(f"tables by formula {quality}")
            length = int.from_bytes(rest[2:4])
            if length:
                tables.clear()
                tables[packet.source] = _tables(rest[1], rest[4 : 4 + length])
            rest = rest[4 + length :]
            self._layout = Layout(
                width=head[6] * 8,
                height=head[7] * 8,
                sampling=SAMPLING[kind % _RESTARTS],
                tables=tables[packet.source],
                restart=restart,
            )
        self._parts[offset] = rest
        if packet.marker:
            self._end = offset + len(rest)


def _tables(precision: int, octets: bytes) -> tuple[bytes, bytes]:
    if precision or len(octets) not in (TABLE, 2 * TABLE):
        raise ValueError("not one or two tables of octets")
    return octets[:TABLE], octets[-TABLE:]


TABLE: Final = 64
"""Length of a quantization table in octets."""
END: Final = b"\xff\xd9"
_HUFFMAN: Final = (
    "0000010501010101010100000000000000000102030405060708090a0b",
    "100002010303020403050504040000017d01020300041105122131410613516107227114328191a1082342b1c115"
    "52d1f02433627282090a161718191a25262728292a3435363738393a434445464748494a535455565758595a6364"
    "65666768696a737475767778797a838485868788898a92939495969798999aa2a3a4a5a6a7a8a9aab2b3b4b5b6b7"
    "b8b9bac2c3c4c5c6c7c8c9cad2d3d4d5d6d7d8d9dae1e2e3e4e5e6e7e8e9eaf1f2f3f4f5f6f7f8f9fa",
    "0100030101010101010101010000000000000102030405060708090a0b",
    "1100020102040403040705040400010277000102031104052131061241510761711322328108144291a1b1c10923"
    "3352f0156272d10a162434e125f11718191a262728292a35363738393a434445464748494a535455565758595a63"
    "6465666768696a737475767778797a82838485868788898a92939495969798999aa2a3a4a5a6a7a8a9aab2b3b4b5"
    "b6b7b8b9bac2c3c4c5c6c7c8c9cad2d3d4d5d6d7d8d9dae2e3e4e5e6e7e8e9eaf2f3f4f5f6f7f8f9fa",
)
"""Class and number of each table, its code lengths, its values."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Data of a picture besides the scan.

    Attributes:
        sampling: sampling factors of luminance, as in the frame header (T.81, B.2.2).
        tables: the quantization tables of luminance and chrominance, in zigzag order.
        restart: units between two restart markers, 0 if there are none.
    """

    width: int
    height: int
    sampling: int
    tables: tuple[bytes, bytes]
    restart: int


def jpeg_file(layout: Layout, scan: bytes) -> bytes:
    """Return a complete JPEG file."""
    components = bytes((1, layout.sampling, 0, 2, 0x11, 1, 3, 0x11, 1))
    size = layout.height.to_bytes(2) + layout.width.to_bytes(2)
    return b"".join(
        (
            b"\xff\xd8",
            *(
                _segment(0xDB, bytes((number,)) + table)
                for number, table in enumerate(layout.tables)
            ),
            _segment(0xC0, b"\x08" + size + b"\x03" + components),
            *(_segment(0xC4, bytes.fromhex(table)) for table in _HUFFMAN),
            _segment(0xDD, layout.restart.to_bytes(2)) if layout.restart else b"",
            _segment(0xDA, bytes((3, 1, 0x00, 2, 0x11, 3, 0x11, 0, 63, 0))),
            scan if scan.endswith(END) else scan + END,
        )
    )


def _segment(marker: int, content: bytes) -> bytes:
    return bytes((0xFF, marker)) + (2 + len(content)).to_bytes(2) + content
