"""The two check sums of bundles (RFC 9171, 4.2.1): CRC-16/X.25 and CRC-32C (Castagnoli)."""

import struct
from binascii import crc_hqx
from enum import IntEnum
from typing import Final


class Crc(IntEnum):
    """Which check sum a block carries, by its code on the wire."""

    NONE = 0
    CRC16 = 1
    CRC32C = 2


CRC_OCTETS: Final = {Crc.NONE: 0, Crc.CRC16: 2, Crc.CRC32C: 4}


def crc16(octets: bytes) -> bytes:
    """Return CRC-16/X.25, big-endian.

    X.25 works on mirrored octets; with octets and result mirrored it is the CRC that the standard
    library has in C.
    """
    mirrored = crc_hqx(octets.translate(_MIRRORED), 0xFFFF) ^ 0xFFFF
    return bytes((_MIRRORED[mirrored & 0xFF], _MIRRORED[mirrored >> 8]))


def crc32c(octets: bytes) -> bytes:
    """Return CRC-32C, big-endian."""
    crc = 0xFFFFFFFF
    table = _CASTAGNOLI
    for octet in octets:
        crc = table[(crc ^ octet) & 0xFF] ^ (crc >> 8)
    return struct.pack(">I", crc ^ 0xFFFFFFFF)


def check_sum(kind: Crc, octets: bytes) -> bytes:
    """Return the check sum of this kind; none is no octets."""
    if kind is Crc.CRC16:
        return crc16(octets)
    return crc32c(octets) if kind is Crc.CRC32C else b""


def _mirrored(octet: int) -> int:
    return int(f"{octet:08b}"[::-1], 2)


def _castagnoli(octet: int) -> int:
    for _ in range(8):
        octet = (octet >> 1) ^ (0x82F63B78 if octet & 1 else 0)
    return octet


_MIRRORED: Final = bytes(map(_mirrored, range(256)))
_CASTAGNOLI: Final = tuple(map(_castagnoli, range(256)))
