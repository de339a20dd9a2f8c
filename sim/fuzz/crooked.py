"""Writers that make mistakes where the structure is: lengths, flags, numbers, type ids, text."""

from random import Random
from typing import Final, Self

from adapters.mal.attribute_codec import Encoding, SplitWriter, VariableWriter, Writer

_SLIP: Final = 0.15
"""How likely a writer makes a mistake at a value, as long as it has made none."""
_COUNTS: Final = (0, 1, 0x7F, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_NO_TEXT: Final = (b"\xff", b"\xc3(", b"\xed\xa0\x80", b"\xf5\x80\x80\x80", b"\0" * 300)


class _Crooked(Writer):
    """Makes one mistake at most; what follows it is written as it should be.

    Attributes:
        slipped: whether the mistake was made.
    """

    _random: Random
    _type_ids: tuple[int, ...]
    slipped: bool

    @classmethod
    def begin(cls, random: Random, type_ids: tuple[int, ...]) -> Self:
        """Return a writer that takes wrong type ids from the right ones of others."""
        writer = cls()
        writer._random, writer._type_ids, writer.slipped = random, type_ids, False
        return writer

    def _slips(self) -> bool:
        if self.slipped or self._random.random() > _SLIP:
            return False
        self.slipped = True
        return True

    def length(self, count: int) -> None:
        if self._slips():
            count = self._random.choice((*_COUNTS, max(count - 1, 0), count + 1))
        super().length(count)

    def boolean(self, value: bool) -> None:
        if self._slips():
            super().uoctet(self._random.randrange(2, 256))
        else:
            super().boolean(value)

    def uoctet(self, value: int) -> None:
        super().uoctet(self._random.randrange(256) if self._slips() else value)

    def ushort(self, value: int) -> None:
        super().ushort(self._random.choice((0, 0xFFFF)) if self._slips() else value)

    def uinteger(self, value: int) -> None:
        super().uinteger(self._random.choice(_COUNTS) if self._slips() else value)

    def long(self, value: int) -> None:
        if self._slips():
            value = self._random.choice((*self._type_ids, 0, -1, value ^ 1))
        super().long(value)

    def double(self, value: float) -> None:
        super().double(self._random.choice((1e300, -3.0, 0.0)) if self._slips() else value)

    def string(self, value: str) -> None:
        if self._slips():
            super().blob(self._random.choice(_NO_TEXT))
        else:
            super().string(value)

    def finetime(self, value: int) -> None:
        if self._slips():
            self._ones(10)
        else:
            super().finetime(value)

    def time(self, value: int) -> None:
        if self._slips():
            self._ones(6)
        else:
            super().time(value)

    def _ones(self, octets: int) -> None:
        for _ in range(octets):
            super().uoctet(0xFF)


class _Fixed(_Crooked):
    pass


class _Variable(_Crooked, VariableWriter):
    pass


class _Split(_Crooked, SplitWriter):
    pass


CROOKED: Final[dict[Encoding, type[_Crooked]]] = {
    Encoding.FIXED: _Fixed,
    Encoding.VARIABLE: _Variable,
    Encoding.SPLIT: _Split,
}
"""The crooked writer of each encoding."""
