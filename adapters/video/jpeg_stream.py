"""JPEG pictures out of RTP packets (RFC 2435), whatever their order; what is incomplete is lost."""

from typing import Final

from adapters.video.jpeg_file import TABLE, Layout, jpeg_file
from adapters.video.rtp import RtpPacket, read_packet

KIND: Final = 26
"""JPEG among RTP's payload types (RFC 3551)."""
CLOCK_HZ: Final = 90_000
SAMPLING: Final = {0: 0x21, 1: 0x22}
"""Of luminance, by RFC 2435's type: 4:2:2 and 4:2:0."""
_RESTARTS: Final = 64
_TABLES_FOLLOW: Final = 128


class JpegStream:
    """Puts pictures together.

    It reads streams that carry their quantization tables, as GStreamer, FFmpeg and rover-sim send
    them; pictures whose tables go by a formula (Q below 128) count as lost.

    Attributes:
        lost: pictures of which something was missing or made no sense.
    """

    def __init__(self) -> None:
        """Know nothing of any stream."""
        self.lost = 0
        self._picture: _Picture | None = None
        self._tables: dict[int, tuple[bytes, bytes]] = {}

    def add(self, datagram: bytes) -> bytes | None:
        """Take a datagram; return the JPEG file that it completes, if it does."""
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
    """A picture that is not complete yet."""

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
