"""What a MOPS message is, written down once more: it judges `adapters.mops`, and shares nothing.

A field that is one message for one of the two and none for the other is a fault of one of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

LONGEST: Final = 4096
FIELDS: Final = 10
_CODE: Final = frozenset(b"0123456789ABCDEF")
_NAME: Final = frozenset(range(0x21, 0x7F)) - frozenset(b"#|,")
_VALUES: Final = _NAME | frozenset(b" ,")
_FLAGS: Final = (b"True", b"False")
_DIGITS: Final = frozenset(b"0123456789")
_PADDING: Final = b"\0\r\n"
_HIGHEST: Final = ((1 << 63) - 1, (1 << 32) - 1)


@dataclass(frozen=True, slots=True)
class Cut:
    """A text, cut at each `#`.

    Attributes:
        sound: the messages in it.
        wrong: how many pieces are none; what follows the last `#` is one, unless it is padding.
    """

    sound: Sequence[bytes]
    wrong: int


def cut(octets: bytes) -> Cut:
    """Cut a text of whole messages."""
    *pieces, rest = octets.split(b"#")
    whole = [(piece + b"#").lstrip(_PADDING) for piece in pieces]
    sound = [piece for piece in whole if is_sound(piece)]
    return Cut(sound, len(whole) - len(sound) + bool(rest.strip(_PADDING)))


class Stream:
    """Cuts what comes in any portions; what follows the last `#` waits for more."""

    def __init__(self) -> None:
        self._rest = b""

    def cut(self, octets: bytes) -> Cut:
        """Cut what is whole with these octets."""
        whole, end, self._rest = (self._rest + octets).rpartition(b"#")
        return cut(whole + end)


def is_sound(piece: bytes) -> bool:
    fields = piece[:-1].split(b"|")
    if not piece.endswith(b"#") or len(piece) > LONGEST or len(fields) != FIELDS:
        return False
    code, *names, inputs, outputs, received, executed, number, counter = fields
    return (
        len(code) == 3
        and _CODE.issuperset(code)
        and all(name and _NAME.issuperset(name) for name in names)
        and _VALUES.issuperset(inputs + outputs)
        and received in _FLAGS
        and executed in _FLAGS
        and all(map(_is_number, (number, counter), _HIGHEST))
    )


def _is_number(text: bytes, highest: int) -> bool:
    if not text:
        return True
    plain = _DIGITS.issuperset(text) and len(text) <= len(str(highest))
    return plain and str(int(text)) == text.decode() and int(text) <= highest
