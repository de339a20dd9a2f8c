"""Self-delimiting numeric values (RFC 6256), the numbers of LTP and TCPCL, and what reads them."""

from typing import Final

from adapters.bundle.codec.errors import DecodeError

GREATEST: Final = 2**64 - 1
_MOST_OCTETS: Final = 10


class TruncatedError(DecodeError):
    """The octets end before what is read does."""


def encode_sdnv(value: int) -> bytes:
    """Encode a number of at most 64 bits."""
    if value < 0x80:
        return bytes((value,))
    octets = [value & 0x7F]
    while value := value >> 7:
        octets.append(0x80 | (value & 0x7F))
    return bytes(reversed(octets))


class SdnvReader:
    """Reads one item after the other; every method consumes what it returns.

    Attributes:
        at: the index of the next octet.

    Raises:
        TruncatedError: from every method, where the octets end too early.
    """

    __slots__ = ("_octets", "at")

    def __init__(self, octets: bytes) -> None:
        self._octets, self.at = octets, 0

    def number(self) -> int:
        """Return a number.

        Raises:
            DecodeError: it has more than 64 bits.
        """
        value = 0
        for index in range(self.at, self.at + _MOST_OCTETS):
            if index >= len(self._octets):
                raise TruncatedError(f"octet {self.at}: the octets end within a number")
            octet = self._octets[index]
            value = (value << 7) | (octet & 0x7F)
            if octet < 0x80:
                if value > GREATEST:
                    break
                self.at = index + 1
                return value
        raise DecodeError(f"octet {self.at}: a number of more than 64 bits")

    def octet(self) -> int:
        """Return an octet."""
        return self.take(1)[0]

    def take(self, count: int) -> bytes:
        """Return some octets."""
        end = self.at + count
        if end > len(self._octets):
            left = len(self._octets) - self.at
            raise TruncatedError(f"octet {self.at}: {count} octets wanted, {left} there")
        taken = self._octets[self.at : end]
        self.at = end
        return taken

    @property
    def left(self) -> int:
        """How many octets are left."""
        return len(self._octets) - self.at
