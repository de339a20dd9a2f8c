"""Self-delimiting numeric values (SDNV, RFC 6256), used by LTP and TCPCL, and their reader."""

from typing import Final

from adapters.bundle.codec.errors import DecodeError

MAX_SDNV: Final = 2**64 - 1
_MAX_OCTETS: Final = 10


class TruncatedError(DecodeError):
    """The octets end within an item."""


def encode_sdnv(value: int) -> bytes:
    """Encode an unsigned number of at most 64 bits."""
    if value < 0x80:
        return bytes((value,))
    octets = [value & 0x7F]
    while value := value >> 7:
        octets.append(0x80 | (value & 0x7F))
    return bytes(reversed(octets))


class SdnvReader:
    """Sequential decoder; each method consumes its item.

    Attributes:
        at: index of the next octet.

    Raises:
        TruncatedError: by every method, if the octets end within an item.
    """

    __slots__ = ("_octets", "at")

    def __init__(self, octets: bytes) -> None:
        self._octets, self.at = octets, 0

    def number(self) -> int:
        """Read a number.

        Raises:
            DecodeError: the number exceeds 64 bits.
        """
        value = 0
        for index in range(self.at, self.at + _MAX_OCTETS):
            if index >= len(self._octets):
                raise TruncatedError(f"octet {self.at}: input ends within a number")
            octet = self._octets[index]
            value = (value << 7) | (octet & 0x7F)
            if octet < 0x80:
                if value > MAX_SDNV:
                    break
                self.at = index + 1
                return value
        raise DecodeError(f"octet {self.at}: number exceeds 64 bits")

    def octet(self) -> int:
        """Read one octet."""
        return self.take(1)[0]

    def take(self, count: int) -> bytes:
        """Read `count` octets."""
        end = self.at + count
        if end > len(self._octets):
            left = len(self._octets) - self.at
            raise TruncatedError(f"octet {self.at}: expected {count} octets, {left} left")
        taken = self._octets[self.at : end]
        self.at = end
        return taken

    @property
    def remaining(self) -> int:
        """Number of octets that remain."""
        return len(self._octets) - self.at
