"""Self-delimiting numeric values (RFC 6256), the numbers of LTP and TCPCL."""

from typing import Final

from adapters.bundle.codec.errors import DecodeError

GREATEST: Final = 2**64 - 1
_MOST_OCTETS: Final = 10


def encode_sdnv(value: int) -> bytes:
    """Encode a number of at most 64 bits."""
    if value < 0x80:
        return bytes((value,))
    octets = [value & 0x7F]
    while value := value >> 7:
        octets.append(0x80 | (value & 0x7F))
    return bytes(reversed(octets))


def read_sdnv(octets: bytes, at: int) -> tuple[int, int] | None:
    """Read a number; None if the octets end before it does.

    Returns:
        The number and the index after it.

    Raises:
        DecodeError: it has more than 64 bits.
    """
    value = 0
    for index in range(at, min(len(octets), at + _MOST_OCTETS)):
        octet = octets[index]
        value = (value << 7) | (octet & 0x7F)
        if not octet & 0x80:
            if value > GREATEST:
                break
            return value, index + 1
    else:
        if len(octets) < at + _MOST_OCTETS:
            return None
    raise DecodeError(f"octet {at}: a number of more than 64 bits")
