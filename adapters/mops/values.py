"""Fields of a request as values of a MOPS message, and back: flat, in the order of the fields."""

import base64
import binascii
import re
import types
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from math import isfinite
from typing import Any, Final, Union, get_args, get_origin, get_type_hints
from urllib.parse import quote, unquote

from adapters.mops.message import MopsError

_KEPT: Final = " !\"$&'()*+-./:;<=>?@[\\]^_`{}~"
_FLOAT: Final = re.compile(r"-?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?")
_INTEGER: Final = re.compile(r"-?[0-9]+")
_LONGEST_NUMBER: Final = 40
_WORDS: Final = {float: "number", int: "whole number"}


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
    return quote(text, safe=_KEPT)


def values_of(item: Any) -> Iterator[str]:
    """Yield the values of a dataclass.

    Raises:
        MopsError: a number is not finite, or a text that may be missing is empty.
    """
    kind: type = type(item)
    for field in fields(item):
        if getattr(item, field.name) == "" and field.name in _may_be_missing(kind):
            raise MopsError(f"{field.name}: an empty text would be read as none")
        yield from _texts(field.name, getattr(item, field.name))


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
def _may_be_missing(kind: type) -> frozenset[str]:
    return frozenset(name for name, hint in _hints(kind) if type(None) in get_args(hint))


def _hints(kind: type) -> Iterator[tuple[str, Any]]:
    hints = get_type_hints(kind)
    return ((field.name, hints[field.name]) for field in fields(kind))


def _element(hint: Any) -> type | None:
    """Return what a tuple of any length repeats; None for anything else."""
    if get_origin(hint) is not tuple:
        return None
    element: type = get_args(hint)[0]
    return element


def _texts(name: str, value: Any) -> Iterator[str]:
    match value:
        case None:
            yield ""
        case str():
            yield encoded(value)
        case bytes():
            yield base64.b64encode(value).decode("ascii")
        case tuple():
            for one in value:
                yield from values_of(one)
        case int():
            yield str(value)
        case float() if isfinite(value):
            yield repr(value)
        case float():
            raise MopsError(f"{name}: {value} cannot be written")
        case _:
            yield from values_of(value)


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
