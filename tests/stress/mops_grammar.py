"""What a MOPS message is, written down once more: it judges `adapters.mops`, and shares nothing.

A piece that is one message for one of the two and none for the other is a fault of one of them.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

MAX_OCTETS: Final = 4096
FIELDS: Final = 10
_NAME: Final = rb"[^\x00-\x20\x7f-\xff#|,]+"
_VALUES: Final = rb"[^\x00-\x1f\x7f-\xff#|]*"
_FLAG: Final = rb"(?:True|False)"
_NUMBER: Final = rb"(0|[1-9][0-9]*)?"
_MESSAGE: Final = re.compile(
    rb"\|".join(
        [b"[0-9A-F]{3}", *[_NAME] * 3, _VALUES, _VALUES, _FLAG, _FLAG, _NUMBER, _NUMBER + b"#"]
    )
)
_PADDING: Final = b"\0\r\n"


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
    found = _MESSAGE.fullmatch(piece) if len(piece) <= MAX_OCTETS else None
    return found is not None and int(found[1] or 0) < 1 << 63 and int(found[2] or 0) < 1 << 32
