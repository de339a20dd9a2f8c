"""One MOPS message as a value, and as octets (thesis 6.1.1).

`CODE|SOURCE|DEST|COMMAND|INPUTS|OUTPUTS|RECEIVED|EXECUTED|moeinputsid|moeinputscounter#`
"""

import re
from dataclasses import dataclass
from typing import Final

SEPARATOR: Final = "|"
END: Final = "#"
COMMA: Final = ","
LONGEST: Final = 4096
"""Octets of a message, the `#` included."""
HIGHEST_CODE: Final = 0xFFF
HIGHEST_ID: Final = (1 << 63) - 1
HIGHEST_COUNTER: Final = (1 << 32) - 1

_CODE: Final = re.compile("[0-9A-F]{3}")
_NAME: Final = re.compile(r"[!\"$-+\--{}~]+")
"""Printable ASCII but the space and what separates: `#`, `|` and the comma."""
_VALUE: Final = re.compile(r"[ !\"$-+\--{}~]*")
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
    return COMMA.join(_checked(_VALUE, name, value) for value in values)


def _split(name: str, text: str) -> tuple[str, ...]:
    return tuple(_checked(_VALUE, name, value) for value in text.split(COMMA)) if text else ()


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
