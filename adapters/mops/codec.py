"""`Message` of MOPS as value and octets; `MopsStream`; dataclass fields as values of a message.

On the wire (thesis 6.1.1):
`CODE|SOURCE|DEST|COMMAND|INPUTS|OUTPUTS|RECEIVED|EXECUTED|moeinputsid|moeinputscounter#`
"""

import base64
import binascii
import hashlib
import re
import types
import zlib
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
MAX_MESSAGE_OCTETS: Final = 4096
"""Maximum length of a message in octets, including the `#`."""
MAX_PLAIN_OCTETS: Final = 2048
"""Octets of one value that are written without compression."""
MAX_INFLATED_OCTETS: Final = 1 << 18
"""Octets of one value that are read from compressed ones: the maximum of a plan."""
MAX_CODE: Final = 0xFFF
MAX_ID: Final = (1 << 63) - 1
MAX_COUNTER: Final = (1 << 32) - 1
MAX_UTC_S: Final = 5e9
"""Year 2128: shortly after it the 16-bit day count of a MAL time overflows."""

_CODE: Final = re.compile("[0-9A-F]{3}")
_NAME: Final = re.compile(r"[!\"$-+\--{}~]+")
"""Printable ASCII except the space and the separators `#`, `|` and comma."""
_VALUE: Final = re.compile(r"[ !\"$-+\--{}~]*")
_VALUES: Final = re.compile(r"[ !\"$-{}~]*")
"""Values separated by commas."""
_NUMBER: Final = re.compile("0|[1-9][0-9]*")
_FLAGS: Final = {"True": True, "False": False}
_FIELDS: Final = 10


class MopsError(ValueError):
    """The input is no MOPS message, or cannot become one; the text names field and cause."""


def require_name(key: str, text: str) -> None:
    """Raise ValueError unless a text is valid as source, dest or command of a message.

    Args:
        key: key of the text in a settings file, for the error.
        text: the text to check.

    Raises:
        ValueError: the text has a character that names exclude.
    """
    if not _NAME.fullmatch(text):
        raise ValueError(f"{key} is {text!r}: a name has printable ASCII, no space, comma, | or #")


def require_asset(name: str) -> None:
    """Raise ValueError unless a name is valid for an asset, in messages and in file names.

    Raises:
        ValueError: the name has a character that names exclude, or a slash.
    """
    require_name("asset", name)
    if "/" in name:
        raise ValueError(f"asset is {name!r}: it names files, so it has no /")


@dataclass(frozen=True, slots=True)
class Message:
    """A command, a notification or telemetry.

    Attributes:
        code: message type, 0 to 0xFFF; `config/mops/dictionary.yaml` lists the types.
        source, dest: names of sender and receiver.
        command: name of the command or of the telemetry.
        inputs: arguments of a command.
        outputs: results.
        received: whether the destination has received it.
        executed: whether it was executed successfully.
        moe_inputs_id: command number, unique per source; None for messages on no command.
        moe_inputs_counter: for display; None if absent.
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
        MopsError: a field is invalid or the message is too long.
    """
    if not 0 <= message.code <= MAX_CODE:
        raise MopsError(f"code: {message.code} is not within 0 and {MAX_CODE:#x}")
    names = (("source", message.source), ("dest", message.dest), ("command", message.command))
    fields = [f"{message.code:03X}", *(_checked(_NAME, name, value) for name, value in names)]
    fields += [_joined("inputs", message.inputs), _joined("outputs", message.outputs)]
    fields += [str(message.received), str(message.executed)]
    fields.append(_encode_number("moeinputsid", message.moe_inputs_id, MAX_ID))
    fields.append(_encode_number("moeinputscounter", message.moe_inputs_counter, MAX_COUNTER))
    octets = (SEPARATOR.join(fields) + END).encode("ascii")
    if len(octets) > MAX_MESSAGE_OCTETS:
        raise MopsError(f"{len(octets)} octets: a message has {MAX_MESSAGE_OCTETS} at most")
    return octets


def decode(octets: bytes) -> Message:
    """Return the message encoded by octets, from the code to the `#`.

    Raises:
        MopsError: the octets are not a message in its canonical spelling.
    """
    if len(octets) > MAX_MESSAGE_OCTETS:
        raise MopsError(f"{len(octets)} octets: a message has {MAX_MESSAGE_OCTETS} at most")
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
        _number("moeinputsid", number, MAX_ID),
        _number("moeinputscounter", counter, MAX_COUNTER),
    )


def _checked(pattern: re.Pattern[str], name: str, text: str) -> str:
    if not pattern.fullmatch(text):
        raise MopsError(f"{name}: {text[:40]!r} has a character that is not allowed")
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


def _encode_number(name: str, value: int | None, maximum: int) -> str:
    if value is not None and not 0 <= value <= maximum:
        raise MopsError(f"{name}: {value} is not within 0 and {maximum}")
    return "" if value is None else str(value)


def _number(name: str, text: str, maximum: int) -> int | None:
    if not text:
        return None
    _checked(_NUMBER, name, text)
    if len(text) > len(str(maximum)) or int(text) > maximum:
        raise MopsError(f"{name}: {text[:40]} is above {maximum}")
    return int(text)


_END: Final = END.encode()
_PADDING: Final = b"\0\r\n"
"""Octets skipped before a message: USB packets are padded with zeros."""
_SHOWN: Final = 60


class MopsStream:
    """Assembles messages from octets; buffers at most one message.

    Invalid input is dropped up to and including the next `#`; each piece is counted and logged.

    Args:
        notify: called with one line for each dropped piece.

    Attributes:
        dropped_octets, dropped_pieces: totals of invalid input.
    """

    def __init__(self, notify: Callable[[str], None]) -> None:
        self._on_dropped = notify
        self._begun = b""
        self._skipped = 0
        self.dropped_octets = 0
        self.dropped_pieces = 0

    def feed(self, octets: bytes) -> Iterator[Message]:
        """Add octets, split at any position, and yield the messages completed by them."""
        *pieces, self._begun = (self._begun + octets).split(_END)
        for piece in pieces:
            message = self._complete_message(piece + _END)
            if message is not None:
                yield message
        if len(self._begun) >= MAX_MESSAGE_OCTETS:
            self._skipped += len(self._begun)
            self._begun = b""

    def cut(self) -> None:
        """Drop an incomplete message; its end will not arrive."""
        begun, self._begun = self._begun, b""
        skipped, self._skipped = self._skipped, 0
        if skipped or begun.strip(_PADDING):
            self._drop(begun[:_SHOWN], skipped + len(begun), f"no {END} at the end")

    def _complete_message(self, piece: bytes) -> Message | None:
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
        self._on_dropped(f"{octets} octets are no MOPS message ({why}): {shown!r}")


def messages_in(text: str, notify: Callable[[str], None]) -> Iterator[Message]:
    """Yield the messages of a text that contains complete messages only.

    Args:
        text: one message or several.
        notify: called with one line for each invalid piece.
    """
    stream = MopsStream(notify)
    yield from stream.feed(text.encode("utf-8", "replace"))
    stream.cut()


def require_within(name: str, value: float | None, least: int, maximum: float) -> None:
    """Raise MopsError unless a value is None or within the range that is stored and sent."""
    if value is not None and not least <= value <= maximum:
        raise MopsError(f"{name}: {value} is not within {least} and {maximum:.0f}")


def fingerprint(text: str) -> int:
    """Return 64 bits of a text's SHA-256; the receiver acknowledges the text with them."""
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8])


_UNQUOTED: Final = " !\"$&'()*+-./:;<=>?@[\\]^_`{}~"
_PLAIN: Final = re.compile(f"[0-9A-Za-z{re.escape(_UNQUOTED)}]*")
_FLOAT: Final = re.compile(r"-?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?")
_INTEGER: Final = re.compile(r"-?[0-9]+")
_MAX_NUMBER_LENGTH: Final = 40
_DEFLATED: Final = "~"
"""Before the base64 of octets that are compressed (raw DEFLATE, RFC 1951)."""
_RAW: Final = -15
_TYPE_NAMES: Final = {float: "number", int: "whole number", bool: "True or False"}


def names_of(kind: type, before: str = "") -> Iterator[str]:
    """Yield the names of a dataclass's values: dotted if nested, with [] if repeated."""
    for name, hint in _hints(kind):
        element = _element(hint)
        if element is not None:
            yield from names_of(element, f"{before}{name}[].")
        elif is_dataclass(hint) and isinstance(hint, type):
            yield from names_of(hint, f"{before}{name}.")
        else:
            yield f"{before}{name}"


def encoded(text: str) -> str:
    """Return a text percent-encoded for a message; numbers and base64 are unchanged."""
    return text if _PLAIN.fullmatch(text) else quote(text, safe=_UNQUOTED)


def values_of(item: Any) -> Iterator[str]:
    """Yield the values of a dataclass.

    Raises:
        MopsError: a number is not finite, an optional text is empty, or a field is set that
            messages do not carry.
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
                yield _written(octets)
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


def from_values(kind: type, values: Sequence[str]) -> Any:
    """Return the dataclass with these values.

    Raises:
        MopsError: the number of values is wrong, or a value has the wrong type.
    """
    left = list(reversed(values))
    made = _build(kind, left)
    if left:
        raise MopsError(f"inputs: {len(left)} too many")
    return made


@cache
def _fields(kind: type) -> Sequence[tuple[str, bool]]:
    """Return the name of each value of a dataclass, and whether it is optional."""
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
    """Return the element type of a tuple of any length; None for other types."""
    if get_origin(hint) is not tuple:
        return None
    element: type = get_args(hint)[0]
    return element


def _build(kind: type, left: list[str]) -> Any:
    found: dict[str, Any] = {}
    for name, hint in _hints(kind):
        element = _element(hint)
        if element is not None:
            found[name] = tuple(_repeated(element, left))
        elif is_dataclass(hint) and isinstance(hint, type):
            found[name] = _build(hint, left)
        elif left:
            found[name] = _read(name, hint, left.pop())
        else:
            raise MopsError(f"inputs: {name} is missing")
    return kind(**found)


def _repeated(element: type, left: list[str]) -> Iterator[Any]:
    while left:
        yield _build(element, left)


def _read(name: str, hint: Any, text: str) -> Any:
    kinds = set(get_args(hint)) if get_origin(hint) in {Union, types.UnionType} else {hint}
    if type(None) in kinds:
        if not text:
            return None
        kinds.remove(type(None))
    (kind,) = kinds
    if kind is float and _FLOAT.fullmatch(text) and len(text) <= _MAX_NUMBER_LENGTH:
        number = float(text)
        if isfinite(number):
            return number
    elif kind is int and _INTEGER.fullmatch(text) and len(text) <= _MAX_NUMBER_LENGTH:
        return int(text)
    elif kind is bool and text in _FLAGS:
        return _FLAGS[text]
    elif kind is str:
        return _unquoted(name, text)
    elif kind is bytes:
        return _octets(name, text)
    raise MopsError(f"{name}: {text[:40]!r} is no {_TYPE_NAMES[kind]}")


def _unquoted(name: str, text: str) -> str:
    try:
        found = unquote(text, errors="strict")
    except UnicodeDecodeError as fault:
        raise MopsError(f"{name}: {text[:40]!r} is not UTF-8") from fault
    if encoded(found) != text:
        raise MopsError(f"{name}: {text[:40]!r} is not percent-encoded in the canonical form")
    return found


def _written(octets: bytes) -> str:
    """Return octets as base64; many octets, such as those of a long plan, are compressed first."""
    if len(octets) <= MAX_PLAIN_OCTETS:
        return base64.b64encode(octets).decode("ascii")
    return _DEFLATED + base64.b64encode(zlib.compress(octets, 9, wbits=_RAW)).decode("ascii")


def _octets(name: str, text: str) -> bytes:
    try:
        octets = base64.b64decode(text.removeprefix(_DEFLATED), validate=True)
    except binascii.Error as fault:
        raise MopsError(f"{name}: {text[:40]!r} is no base64") from fault
    if not text.startswith(_DEFLATED):
        return octets
    inflating = zlib.decompressobj(wbits=_RAW)
    try:
        found = inflating.decompress(octets, MAX_INFLATED_OCTETS)
    except zlib.error as fault:
        raise MopsError(f"{name}: compressed octets are damaged: {fault}") from fault
    if not inflating.eof or inflating.unused_data or len(found) <= MAX_PLAIN_OCTETS:
        bounds = f"{MAX_PLAIN_OCTETS + 1} to {MAX_INFLATED_OCTETS}"
        raise MopsError(f"{name}: compressed octets are not one stream of {bounds} octets")
    return found
