"""Plain YAML data into dataclasses, strictly: the first fault is raised, with the path of its key.

A key is the name of its field without the unit: `x_m` is written `x`. An angle, or an angle a
second, may be written in degrees. One of several dataclasses is told by its own first field.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from enum import Enum
from functools import partial
from inspect import isclass
from math import radians
from types import NoneType, UnionType
from typing import Any, Final, TypeVar, get_args, get_origin

T = TypeVar("T")
Reader = Callable[[Any, str], Any]

ANGLE: Final = {"angle": True}
"""Metadata of a field without a unit that may be an angle."""

_UNIT: Final = re.compile(r"_(m|rad|s|mps|radps|mps2|radps2|px|v|ratio|kg)$")
_ANGLES: Final = ("_rad", "_radps", "_radps2")
_DEGREES: Final = re.compile(r"([-+]?\d+(?:\.\d*)?)\s*deg")

_EXPONENT: Final = re.compile(r"[-+]?\d+(?:\.\d*)?[eE][-+]?\d+")
"""A number to everybody but YAML, if it has no point or no sign."""


class FormatError(Exception):
    """Data that does not fit; the text begins with the path of the key at fault."""

    def __init__(self, path: str, text: str) -> None:
        """Say what is wrong at a path."""
        super().__init__(f"{path}: {text}" if path else text)


class StrictReader:
    """Makes values of dataclasses.

    Args:
        special: how values of certain types are read, from data and path.
    """

    def __init__(self, special: Mapping[Any, Reader]) -> None:
        """Read with these exceptions."""
        self._special = special

    def read(self, raw: object, kind: type[T], path: str) -> T:
        """Return a value of a type.

        Raises:
            FormatError: the data does not fit the type.
        """
        value: T = self._read(raw, kind, path, angle=False)
        return value

    def overlay(self, base: T, raw: object, path: str) -> T:
        """Return a dataclass value with what the data says instead, at any depth.

        Raises:
            FormatError: the data does not fit the type.
        """
        known = _fields(base)
        changes = {}
        for key, value in _mapping(raw, path).items():
            field, inner = _known(known, key, path), _join(path, key)
            present = getattr(base, field.name)
            changes[field.name] = (
                self.overlay(present, value, inner)
                if is_dataclass(present)
                else self._read(value, field.type, inner, _is_angle(field))
            )
        return _made(partial(replace, base), changes, path)  # type: ignore[type-var]

    def _read(self, raw: Any, kind: Any, path: str, angle: bool) -> Any:
        if kind in self._special:
            return self._special[kind](raw, path)
        if isinstance(kind, UnionType):
            return self._union(raw, get_args(kind), path, angle)
        if get_origin(kind) is tuple:
            if not isinstance(raw, list):
                raise FormatError(path, f"expected a list, got {_shown(raw)}")
            (element, _) = get_args(kind)
            return tuple(
                self._read(each, element, f"{path}[{index}]", angle)
                for index, each in enumerate(raw)
            )
        if is_dataclass(kind):
            return self._record(raw, kind, path)
        if isclass(kind) and issubclass(kind, Enum):
            return _choice(raw, kind, path)
        return _scalar(raw, kind, path, angle)

    def _union(self, raw: Any, kinds: tuple[Any, ...], path: str, angle: bool) -> Any:
        if NoneType in kinds:
            (kind,) = (each for each in kinds if each is not NoneType)
            return None if raw is None else self._read(raw, kind, path, angle)
        tags = {_key(next(iter(kind.__annotations__))): kind for kind in kinds}
        found = [tag for tag in tags if tag in _mapping(raw, path)]
        if len(found) != 1:
            said = f"not {' and '.join(found)} together" if found else f"in {_shown(raw)}"
            raise FormatError(path, f"one of {', '.join(tags)} is needed, {said}")
        return self._read(raw, tags[found[0]], path, angle)

    def _record(self, raw: Any, kind: Any, path: str) -> Any:
        if isinstance(raw, kind):
            return raw
        known = _fields(kind)
        values = {}
        for key, value in _mapping(raw, path).items():
            field = _known(known, key, path)
            values[field.name] = self._read(value, field.type, _join(path, key), _is_angle(field))
        for key, field in known.items():
            optional = field.default is not MISSING or field.default_factory is not MISSING
            if not optional and key not in raw:
                raise FormatError(path, f"key {key!r} is missing")
        return _made(kind, values, path)


def _fields(kind: Any) -> dict[str, Field[Any]]:
    return {_key(field.name): field for field in fields(kind)}


def _known(known: Mapping[str, Field[Any]], key: object, path: str) -> Field[Any]:
    if not isinstance(key, str) or key not in known:
        names = ", ".join(known) or "none"
        raise FormatError(path, f"unknown key {_shown(key)}; known are {names}")
    return known[key]


def _made(make: Callable[..., T], values: Mapping[str, Any], path: str) -> T:
    try:
        return make(**values)
    except ValueError as error:
        raise FormatError(path, str(error)) from error


def _join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def _key(name: str) -> str:
    return _UNIT.sub("", name)


def _is_angle(field: Field[Any]) -> bool:
    return field.name.endswith(_ANGLES) or ANGLE.items() <= field.metadata.items()


def _shown(raw: object) -> str:
    try:
        text = repr(raw)
    except ValueError:  # Python prints no number of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _mapping(raw: object, path: str) -> Mapping[Any, Any]:
    if not isinstance(raw, dict):
        raise FormatError(path, f"expected keys and values, got {_shown(raw)}")
    return raw


def _choice(raw: object, kind: type[Enum], path: str) -> Enum:
    for member in kind:
        if raw in (member.name, member.value) and not isinstance(raw, bool):
            return member
    names = ", ".join(member.name for member in kind)
    raise FormatError(path, f"{_shown(raw)} is none of {names}")


def _scalar(raw: Any, kind: Any, path: str, angle: bool) -> Any:
    if kind is float:
        return _number(raw, path, angle)
    if type(raw) is not kind:
        words = {str: "a text", int: "a whole number", bool: "true or false"}
        raise FormatError(path, f"expected {words[kind]}, got {_shown(raw)}")
    return raw


def _number(raw: object, path: str, angle: bool) -> float:
    degrees = _DEGREES.fullmatch(raw.strip()) if angle and isinstance(raw, str) else None
    if degrees is not None:
        return radians(float(degrees[1]))
    if isinstance(raw, str) and _EXPONENT.fullmatch(raw):
        raw = float(raw)
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        unit = " (radians, or degrees as 90deg)" if angle else ""
        raise FormatError(path, f"expected a number{unit}, got {_shown(raw)}")
    if not -1e300 < raw < 1e300:  # greater whole numbers fit no float, and NaN fits nothing
        raise FormatError(path, f"expected a finite number, got {_shown(raw)}")
    return float(raw)
