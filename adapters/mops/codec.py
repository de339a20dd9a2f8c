"""MOPS messages as values, as octets, in a stream; a dataclass's fields as a message's values.

On the wire (thesis 6.1.1):
`CODE|SOURCE|DEST|COMMAND|INPUTS|OUTPUTS|RECEIVED|EXECUTED|moeinputsid|moeinputscounter#`
"""

import base64
import binascii
import hashlib
import re
import types
from collections.abc import Callable, Iterator, Sequence
from dataclasses import Field, dataclass, fields, is_dataclass
from functools import cache
from math import isfinite
from typing import Any, Final, Union, get_args, get_origin, get_type_hints
from urllib.parse import quote, unquote

from executive.commands import RELAYED

SEPARATOR: Final = "|"
END: Final = "#"
COMMA: Final = ","
LONGEST: Final = 4096
"""Octets of a message, the `#` included."""
HIGHEST_CODE: Final = 0xFFF
HIGHEST_ID: Final = (1 << 63) - 1
HIGHEST_COUNTER: Final = (1 << 32) - 1
LATEST_UTC_S: Final = 5e9
"""In the year 2128: not much later the 16 bits for the days of a MAL time are full."""

_CODE: Final = re.compile("[0-9A-F]{3}")
_NAME: Final = re.compile(r"[!\"$-+\--{}~]+")
"""Printable ASCII but the space and what separates: `#`, `|` and the comma."""
_VALUE: Final = re.compile(r"[ !\"$-+\--{}~]*")
_VALUES: Final = re.compile(r"[ !\"$-{}~]*")
"""Values with commas between them."""
_NUMBER: Final = re.compile("0|[1-9][0-9]*")
_FLAGS: Final = {"True": True, "False": False}
_FIELDS: Final = 10


class MopsError(ValueError):
    """It is no MOPS message, or cannot be one; the text says which field and why."""


def require_name(key: str, text: str) -> None:
    """Do nothing where a text can be a source, dest or command of a message.

    Args:
        key: of the text in a file of settings.
        text: what stands there.

    Raises:
        ValueError: it cannot.
    """
    if not _NAME.fullmatch(text):
        raise ValueError(f"{key} is {text!r}: a name has printable ASCII, no space, comma, | or #")


def require_asset(name: str) -> None:
    """Do nothing where a name can be that of an asset, in messages and of the files kept for it.

    Raises:
        ValueError: it cannot.
    """
    require_name("asset", name)
    if "/" in name:
        raise ValueError(f"asset is {name!r}: it names files, so it has no /")


@dataclass(frozen=True, slots=True)
class Message:
    """A command, a notification or telemetry.

    Attributes:
        code: what kind of message it is, 0 to 0xFFF; `config/mops/dictionary.yaml` lists the kinds.
        source, dest: who sends it and whom it is for.
        command: name of the command or of the telemetry.
        inputs: arguments of a command.
        outputs: results.
        received: whether the destination has it.
        executed: whether it was carried out with success.
        moe_inputs_id: the command's number, unique per source; None where there is no command.
        moe_inputs_counter: for display; None where there is none.
    """

    code: int
    source: str
    dest: str
    command: str
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    received: bool = False
    executed: bool = False
    moe_inputs_id: int | None = None
    moe_inputs_counter: int | None = None

    def __str__(self) -> str:
        return encode(self).decode("ascii")


def encode(message: Message) -> bytes:
    """Return the octets of a message.

    Raises:
        MopsError: a field does not fit.
    """
    if not 0 <= message.code <= HIGHEST_CODE:
        raise MopsError(f"code: {message.code} is not within 0 and {HIGHEST_CODE:#x}")
    names = (("source", message.source), ("dest", message.dest), ("command", message.command))
    fields = [f"{message.code:03X}", *(_checked(_NAME, name, value) for name, value in names)]
    fields += [_joined("inputs", message.inputs), _joined("outputs", message.outputs)]
    fields += [str(message.received), str(message.executed)]
    fields.append(_digits("moeinputsid", message.moe_inputs_id, HIGHEST_ID))
    fields.append(_digits("moeinputscounter", message.moe_inputs_counter, HIGHEST_COUNTER))
    octets = (SEPARATOR.join(fields) + END).encode("ascii")
    if len(octets) > LONGEST:
        raise MopsError(f"{len(octets)} octets: a message has {LONGEST} at most")
    return octets


def decode(octets: bytes) -> Message:
    """Return the message that octets are, from the code to the `#`.

    Raises:
        MopsError: they are none, or not in the one way in which it is written.
    """
    if len(octets) > LONGEST:
        raise MopsError(f"{len(octets)} octets: a message has {LONGEST} at most")
    text = octets.decode("ascii", "replace")
    if not text.endswith(END):
        raise MopsError(f"no {END} at the end")
    fields = text[:-1].split(SEPARATOR)
    if len(fields) != _FIELDS:
        raise MopsError(f"{len(fields)} fields, not {_FIELDS}")
    code, source, dest, command, inputs, outputs, received, executed, number, counter = fields
    return Message(
        int(_checked(_CODE, "code", code), 16),
        _checked(_NAME, "source", source),
        _checked(_NAME, "dest", dest),
        _checked(_NAME, "command", command),
        _split("inputs", inputs),
        _split("outputs", outputs),
        _flag("received", received),
        _flag("executed", executed),
        _number("moeinputsid", number, HIGHEST_ID),
        _number("moeinputscounter", counter, HIGHEST_COUNTER),
    )


def _checked(pattern: re.Pattern[str], name: str, text: str) -> str:
    if not pattern.fullmatch(text):
        raise MopsError(f"{name}: {text[:40]!r} cannot stand there")
    return text


def _joined(name: str, values: tuple[str, ...]) -> str:
    if values == ("",):
        raise MopsError(f"{name}: one empty value reads as none")
    text = COMMA.join(values)
    if text.count(COMMA) >= max(len(values), 1) or not _VALUES.fullmatch(text):
        for value in values:
            _checked(_VALUE, name, value)
    return text


def _split(name: str, text: str) -> tuple[str, ...]:
    return tuple(_checked(_VALUES, name, text).split(COMMA)) if text else ()


def _flag(name: str, text: str) -> bool:
    if text not in _FLAGS:
        raise MopsError(f"{name}: {text[:40]!r} is neither True nor False")
    return _FLAGS[text]


def _digits(name: str, value: int | None, highest: int) -> str:
    if value is not None and not 0 <= value <= highest:
        raise MopsError(f"{name}: {value} is not within 0 and {highest}")
    return "" if value is None else str(value)


def _number(name: str, text: str, highest: int) -> int | None:
    if not text:
        return None
    _checked(_NUMBER, name, text)
    if len(text) > len(str(highest)) or int(text) > highest:
        raise MopsError(f"{name}: {text[:40]} is above {highest}")
    return int(text)


_END: Final = END.encode()
_PADDING: Final = b"\0\r\n"
"""What may stand before a message unsaid: USB packets are filled up with zeros."""
_SHOWN: Final = 60


class MopsStream:
    """Collects octets until messages are there; keeps no more than one message's worth.

    What is no message is dropped up to and with the next `#`, counted and told once.

    Args:
        tell: called with one line on each piece that was dropped.

    Attributes:
        dropped_octets, dropped_pieces: what was no message so far.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._begun = b""
        self._skipped = 0
        self.dropped_octets = 0
        self.dropped_pieces = 0

    def feed(self, octets: bytes) -> Iterator[Message]:
        """Take octets, cut anywhere, and give the messages that are now whole."""
        *pieces, self._begun = (self._begun + octets).split(_END)
        for piece in pieces:
            message = self._whole(piece + _END)
            if message is not None:
                yield message
        if len(self._begun) >= LONGEST:
            self._skipped += len(self._begun)
            self._begun = b""

    def cut(self) -> None:
        """Drop what has begun: its end does not come any more."""
        begun, self._begun = self._begun, b""
        skipped, self._skipped = self._skipped, 0
        if skipped or begun.strip(_PADDING):
            self._drop(begun[:_SHOWN], skipped + len(begun), f"no {END} at the end")

    def _whole(self, piece: bytes) -> Message | None:
        if self._skipped:
            self._drop(piece[-_SHOWN:], self._skipped + len(piece), "it does not end")
            self._skipped = 0
            return None
        try:
            return decode(piece.lstrip(_PADDING))
        except MopsError as fault:
            self._drop(piece[:_SHOWN], len(piece), str(fault))
            return None

    def _drop(self, shown: bytes, octets: int, why: str) -> None:
        self.dropped_octets += octets
        self.dropped_pieces += 1
        self._tell(f"{octets} octets are no MOPS message ({why}): {shown!r}")


def messages_in(text: str, tell: Callable[[str], None]) -> Iterator[Message]:
    """Give the messages of a text that holds whole ones only.

    Args:
        text: one message or several.
        tell: called with one line on each piece that is none.
    """
    stream = MopsStream(tell)
    yield from stream.feed(text.encode("utf-8", "replace"))
    stream.cut()


def require_within(name: str, value: float | None, least: int, most: float) -> None:
    """Raise MopsError where a value lies outside of what can be kept and told."""
    if value is not None and not least <= value <= most:
        raise MopsError(f"{name}: {value} is not within {least} and {most:.0f}")


def fingerprint(text: str) -> int:
    """Return 64 bits of a text's SHA-256, by which its receiver confirms that it has it."""
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8])


_KEPT: Final = " !\"$&'()*+-./:;<=>?@[\\]^_`{}~"
_PLAIN: Final = re.compile(f"[0-9A-Za-z{re.escape(_KEPT)}]*")
_FLOAT: Final = re.compile(r"-?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?")
_INTEGER: Final = re.compile(r"-?[0-9]+")
_LONGEST_NUMBER: Final = 40
_WORDS: Final = {float: "number", int: "whole number", bool: "True or False"}


def names_of(kind: type, before: str = "") -> Iterator[str]:
    """Yield the names of a dataclass's values: dotted where it holds others, [] where repeated."""
    for name, hint in _hints(kind):
        element = _element(hint)
        if element is not None:
            yield from names_of(element, f"{before}{name}[].")
        elif is_dataclass(hint) and isinstance(hint, type):
            yield from names_of(hint, f"{before}{name}.")
        else:
            yield f"{before}{name}"


def encoded(text: str) -> str:
    """Return a text as it stands in a message; numbers and base64 stay as they are."""
    return text if _PLAIN.fullmatch(text) else quote(text, safe=_KEPT)


def values_of(item: Any) -> Iterator[str]:
    """Yield the values of a dataclass.

    Raises:
        MopsError: a number is not finite, a text that may be missing is empty, or a value is there
            that messages do not carry.
    """
    kind: type = type(item)
    for name in _not_relayed(kind):
        if getattr(item, name) is not None:
            raise MopsError(f"{name}: messages do not carry it; leave it out")
    for name, may_be_missing in _fields(kind):
        match getattr(item, name):
            case None:
                yield ""
            case "" if may_be_missing:
                raise MopsError(f"{name}: an empty text would be read as none")
            case str(text):
                yield encoded(text)
            case bytes(octets):
                yield base64.b64encode(octets).decode("ascii")
            case tuple(items):
                for one in items:
                    yield from values_of(one)
            case int(number):
                yield str(number)
            case float(number) if isfinite(number):
                yield repr(number)
            case float(number):
                raise MopsError(f"{name}: {number} cannot be written")
            case composite:
                yield from values_of(composite)


def made_of(kind: type, values: Sequence[str]) -> Any:
    """Return the dataclass that has these values.

    Raises:
        MopsError: there are too many or too few, or one is not of its kind.
    """
    left = list(reversed(values))
    made = _made(kind, left)
    if left:
        raise MopsError(f"inputs: {len(left)} more than wanted")
    return made


@cache
def _fields(kind: type) -> Sequence[tuple[str, bool]]:
    """Return the name of each value of a dataclass, and whether it may be missing."""
    return [(name, type(None) in get_args(hint)) for name, hint in _hints(kind)]


@cache
def _hints(kind: type) -> Sequence[tuple[str, Any]]:
    hints = get_type_hints(kind)
    return [(field.name, hints[field.name]) for field in fields(kind) if _relayed(field)]


@cache
def _not_relayed(kind: type) -> Sequence[str]:
    return [field.name for field in fields(kind) if not _relayed(field)]


def _relayed(field: Field[Any]) -> bool:
    relayed: bool = field.metadata.get(RELAYED, True)
    return relayed


def _element(hint: Any) -> type | None:
    """Return what a tuple of any length repeats; None for anything else."""
    if get_origin(hint) is not tuple:
        return None
    element: type = get_args(hint)[0]
    return element


def _made(kind: type, left: list[str]) -> Any:
    found: dict[str, Any] = {}
    for name, hint in _hints(kind):
        element = _element(hint)
        if element is not None:
            found[name] = tuple(_repeated(element, left))
        elif is_dataclass(hint) and isinstance(hint, type):
            found[name] = _made(hint, left)
        elif left:
            found[name] = _read(name, hint, left.pop())
        else:
            raise MopsError(f"inputs: {name} is missing")
    return kind(**found)


def _repeated(element: type, left: list[str]) -> Iterator[Any]:
    while left:
        yield _made(element, left)


def _read(name: str, hint: Any, text: str) -> Any:
    kinds = set(get_args(hint)) if get_origin(hint) in {Union, types.UnionType} else {hint}
    if type(None) in kinds:
        if not text:
            return None
        kinds.remove(type(None))
    (kind,) = kinds
    if kind is float and _FLOAT.fullmatch(text) and len(text) <= _LONGEST_NUMBER:
        number = float(text)
        if isfinite(number):
            return number
    elif kind is int and _INTEGER.fullmatch(text) and len(text) <= _LONGEST_NUMBER:
        return int(text)
    elif kind is bool and text in _FLAGS:
        return _FLAGS[text]
    elif kind is str:
        return _unquoted(name, text)
    elif kind is bytes:
        return _octets(name, text)
    raise MopsError(f"{name}: {text[:40]!r} is no {_WORDS[kind]}")


def _unquoted(name: str, text: str) -> str:
    try:
        found = unquote(text, errors="strict")
    except UnicodeDecodeError as fault:
        raise MopsError(f"{name}: {text[:40]!r} is not UTF-8") from fault
    if encoded(found) != text:
        raise MopsError(f"{name}: {text[:40]!r} is not percent-encoded as it is here")
    return found


def _octets(name: str, text: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except binascii.Error as fault:
        raise MopsError(f"{name}: {text[:40]!r} is no base64") from fault
