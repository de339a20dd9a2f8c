"""`VideoStream`: the simulated camera as RTP/JPEG (RFC 2435) over UDP, as a camera server sends it.

Pictures are sent only while a receiver listens.
"""

import secrets
import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from executive.settings import SettingsError

MAX_SCAN_OCTETS: Final = 1200
"""Maximum payload of a packet in octets, to avoid fragmentation in any network."""
KIND: Final = 26
CLOCK_HZ: Final = 90_000
MAX_SIDE_PX: Final = 2040
"""Maximum side of a picture in pixels, by the 8-bit header fields (RFC 2435, 3.1)."""
TABLE: Final = 64
"""Length of a quantization table in octets."""
_TABLES_IN_STREAM: Final = 255  # Q for tables in every picture (RFC 2435, 3.1.4)
_MARKER: Final = 0x80
_TYPES: Final = {0x21: 0, 0x22: 1}
_QUANTIZATION, _FRAME, _SCAN = 0xDB, 0xC0, 0xDA


@dataclass(frozen=True, slots=True)
class Jpeg:
    """Parts of a JPEG file that RTP transports.

    Attributes:
        sampling: sampling factors of luminance, as in the frame header.
        tables: the quantization tables, one after the other.
    """

    width: int
    height: int
    sampling: int
    tables: bytes
    scan: bytes


class RtpJpegSender:
    """Splits pictures into the packets of one stream."""

    def __init__(self, source: int) -> None:
        self._source = source.to_bytes(4)
        self._sequence = 0

    def packets(self, jpeg: bytes, time_s: float) -> Iterator[bytes]:
        """Yield the packets of a picture.

        Raises:
            ValueError: RTP cannot transport such a picture.
        """
        picture = read_jpeg(jpeg)
        time = (round(time_s * CLOCK_HZ) % (1 << 32)).to_bytes(4)
        for offset in range(0, len(picture.scan), MAX_SCAN_OCTETS):
            part = picture.scan[offset : offset + MAX_SCAN_OCTETS]
            last = offset + MAX_SCAN_OCTETS >= len(picture.scan)
            yield b"".join(
                (
                    bytes((0x80, KIND | (_MARKER if last else 0))),
                    self._sequence.to_bytes(2),
                    time,
                    self._source,
                    _header(picture, offset),
                    part,
                )
            )
            self._sequence = (self._sequence + 1) % (1 << 16)


def carries(width: int, height: int) -> bool:
    """Return whether RTP transports pictures of a size, in pixels."""
    return all(0 < side <= MAX_SIDE_PX and side % 8 == 0 for side in (width, height))


def read_jpeg(octets: bytes) -> Jpeg:
    """Parse a JPEG file.

    Raises:
        ValueError: RTP cannot transport this kind of JPEG.
    """
    tables, at = b"", 2
    width = height = sampling = 0
    while octets[at : at + 1] == b"\xff":
        marker, length = octets[at + 1], int.from_bytes(octets[at + 2 : at + 4])
        content = octets[at + 4 : at + 2 + length]
        at += 2 + length
        if marker == _QUANTIZATION:
            tables += b"".join(
                content[start + 1 : start + 65] for start in range(0, len(content), 65)
            )
        elif marker == _FRAME:
            height, width = int.from_bytes(content[1:3]), int.from_bytes(content[3:5])
            sampling = content[7]
        elif marker == _SCAN:
            break
    if not carries(width, height) or sampling not in _TYPES:
        raise ValueError(f"RTP carries no JPEG of {width} x {height}, sampled {sampling:#x}")
    return Jpeg(width, height, sampling, tables, octets[at:].removesuffix(b"\xff\xd9"))


def _header(picture: Jpeg, offset: int) -> bytes:
    head = bytes((0, *offset.to_bytes(3), _TYPES[picture.sampling], _TABLES_IN_STREAM))
    size = bytes((picture.width // 8, picture.height // 8))
    if offset:
        return head + size
    return head + size + b"\0\0" + len(picture.tables).to_bytes(2) + picture.tables


class VideoStream:
    """Sends pictures to one address.

    A computer without a receiver refuses datagrams. While it does, one empty datagram is sent for
    each picture as a probe, and no picture is rendered.
    """

    def __init__(self, host: str, port: int, width: int, height: int) -> None:
        """Open the stream; the first probe for a receiver is sent with the first picture.

        Raises:
            SettingsError: the host is unknown, or RTP transports no pictures of this size.
        """
        if not carries(width, height):
            raise SettingsError(
                f"RTP carries no JPEG of {width} x {height}: only multiples of 8 up to"
                f" {MAX_SIDE_PX}"
            )
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise SettingsError(f"no video to {host}: {error.strerror}") from error
        family, kind, *_, address = min(found, key=lambda entry: entry[0] != socket.AF_INET)
        self._socket = socket.socket(family, kind)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.connect(address)
        self._socket.setblocking(False)
        self._sender = RtpJpegSender(source=secrets.randbits(32))
        self._refused = True

    @property
    def watched(self) -> bool:
        """Whether a receiver listens, by the last probe."""
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        refused, self._refused = self._refused or error != 0, False
        if refused:
            with suppress(OSError):
                self._socket.send(b"")
        return not refused

    def send(self, jpeg: bytes, time_s: float) -> None:
        """Send a picture; packets that cannot be sent are lost."""
        try:
            for packet in self._sender.packets(jpeg, time_s):
                self._socket.send(packet)
        except OSError:
            self._refused = True

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
