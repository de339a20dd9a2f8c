"""`StrictReader` makes dataclasses from plain YAML data: an error lists every fault with its key.

A key is the name of its field: `x_m`, or `x` for a reader without units. An angle, or an angle per
second, may be given in degrees; a length, a speed or a time with its unit. One of several
dataclasses is identified by its first field.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import Field, field, fields, is_dataclass
from difflib import get_close_matches
from enum import Enum, EnumMeta
from functools import cache, partial
from math import inf
from operator import eq
from types import GenericAlias, NoneType, UnionType
from typing import Any, Final, TypeVar, get_args, get_origin, overload

from cattrs import (
    BaseValidationError,
    ClassValidationError,
    Converter,
    ForbiddenExtraKeysError,
    IterableValidationError,
    IterableValidationNote,
)
from cattrs.gen import (
    make_dict_structure_fn,
    make_dict_unstructure_fn,
    make_mapping_structure_fn,
    override,
)

from executive.values.quantities import QuantityError, read_quantity, unit_of

T = TypeVar("T")

_UNIT: Final = re.compile(r"(?<!_per)_(m|rad|s|mps|radps|mps2|radps2|px|v|ratio|kg)$")
_ANGLES: Final = ("_rad", "_radps", "_radps2")
MANY: Final = 30
"""Maximum number of keys that an error lists if it suggests a similar one; chosen."""
_TYPE_NAMES: Final = {str: "a text", int: "a whole number", bool: "true or false"}


def figure(least: float = 0.0, maximum: float = inf, **settings: Any) -> Any:
    """Return a field for a number within bounds, which are checked when it is read."""
    return field(metadata={"least": least, "most": maximum}, **settings)


def angle(least: float = -inf, **settings: Any) -> Any:
    """Return a field without a unit that may be an angle."""
    return field(metadata={"angle": True, "least": least, "most": inf}, **settings)


def in_degrees(text: str) -> float | None:
    """Return an angle with its unit, as `5deg`, in radians; None for any other text."""
    try:
        return read_quantity(text, "rad", bare=False)
    except QuantityError:
        return None


def angle_of(raw: object) -> float:
    """Return a number, which may be an angle in degrees.

    Raises:
        ValueError: it is neither.
    """
    found = in_degrees(raw) if isinstance(raw, str) else None
    return _number(raw, float, " (radians, or degrees as 90deg)") if found is None else found


class FormatError(ValueError):
    """Data that do not fit.

    Attributes:
        faults: key path and text of each error.
    """

    def __init__(self, path: str, text: str, *more: tuple[str, str]) -> None:
        self.faults = ((path, text), *more)
        super().__init__("; ".join(self._lines))

    @property
    def _lines(self) -> list[str]:
        return [f"{path}: {text}" if path else text for path, text in self.faults]

    def text_of(self, origin: object) -> str:
        """Return the faults of a file, one a line if there are several."""
        inset = "\n  " if len(self.faults) > 1 else " "
        return f"{origin}:{inset}" + "\n  ".join(self._lines)


class StrictReader:
    """Creates values of dataclasses from plain data, and plain data from values.

    Args:
        special: functions that read these types instead of the default.
        plain: functions that write values of these classes.
        units: whether keys carry the units of their fields.
    """

    def __init__(
        self,
        special: Mapping[Any, Callable[[Any], Any]],
        plain: Mapping[Any, Callable[[Any], Any]] | None = None,
        *,
        units: bool = False,
    ) -> None:
        self._key = str if units else _without_unit
        self._converter = made = Converter(forbid_extra_keys=True)
        for kind in _TYPE_NAMES:
            made.register_structure_hook(kind, _scalar)
        made.register_structure_hook(float, _number)
        # cattrs would compile the hook of a dataclass again for each field of it.
        made.register_structure_hook_factory(is_dataclass, cache(self._dataclass_hook))
        made.register_unstructure_hook_factory(
            is_dataclass,
            cache(lambda kind: make_dict_unstructure_fn(kind, made, **self._keys(kind))),
        )
        made.register_structure_hook_func(_is_tuple, self._list)
        made.register_structure_hook_factory(_is_dict, self._dict_hook)
        made.register_structure_hook_func(lambda kind: isinstance(kind, EnumMeta), _choice)
        made.register_structure_hook_func(_is_one_of, self._one_of)
        made.register_structure_hook_func(
            lambda kind: kind in special, lambda raw, kind: special[kind](raw)
        )
        for kind, written in (plain or {}).items():
            made.register_unstructure_hook_func(partial(eq, kind), written)

    @overload
    def read(self, raw: object, kind: type[T], path: str = "") -> T: ...

    @overload
    def read(self, raw: object, kind: UnionType, path: str = "") -> Any: ...

    def read(self, raw: object, kind: Any, path: str = "") -> Any:
        """Return a value of a type, or of one of several dataclasses.

        Raises:
            FormatError: the data does not fit the type.
        """
        try:
            return self._converter.structure(raw, kind)
        except (BaseValidationError, ValueError) as error:
            first, *more = self._faults(error, path)
            raise FormatError(*first, *more) from error

    def overlay(self, base: T, raw: object, path: str) -> T:
        """Return a dataclass value updated with the data, at any depth.

        Raises:
            FormatError: the data does not fit the type.
        """
        if raw == {}:
            return base
        return self.read(_merged(self.plain(base), raw), type(base), path)

    def plain(self, value: object) -> dict[str, Any]:
        """Return a dataclass value as plain data, the inverse of `read`."""
        made: dict[str, Any] = self._converter.unstructure(value)
        return made

    def _dataclass_hook(self, kind: Any) -> Callable[[Any, Any], Any]:
        of_mapping = make_dict_structure_fn(
            kind, self._converter, _cattrs_forbid_extra_keys=True, **self._keys(kind)
        )

        def read(raw: Any, _: Any) -> Any:
            if isinstance(raw, kind):
                return raw
            made = of_mapping(_mapping(raw), kind)
            for each in fields(kind):
                _check_bounds(self._key(each.name), getattr(made, each.name), each.metadata)
            return made

        return read

    def _list(self, raw: Any, kind: Any) -> Any:
        if not isinstance(raw, list):
            raise ValueError(f"expected a list, got {quoted(raw)}")
        many: Any = GenericAlias(list, get_args(kind)[:1])
        return tuple(self._converter.structure(raw, many))

    def _dict_hook(self, kind: Any) -> Callable[[Any, Any], Any]:
        of_mapping = make_mapping_structure_fn(kind, self._converter)
        return lambda raw, _: of_mapping(_mapping(raw), kind)

    def _one_of(self, raw: Any, kinds: Any) -> Any:
        tags = {self._key(next(iter(kind.__annotations__))): kind for kind in get_args(kinds)}
        found = [tag for tag in tags if tag in _mapping(raw)]
        if len(found) != 1:
            text = f"not {' and '.join(found)} together" if found else f"in {quoted(raw)}"
            raise ValueError(f"one of {', '.join(tags)} is needed, {text}")
        return self._converter.structure(raw, tags[found[0]])

    def _keys(self, kind: Any) -> dict[str, Any]:
        """Return the keys of a dataclass's fields."""
        return {
            each.name: override(
                rename=self._key(each.name),
                struct_hook=_angle if _is_angle(each) else _quantity_hook(each),
            )
            for each in fields(kind)
        }

    def _faults(self, error: BaseException, path: str) -> Iterator[tuple[str, str]]:
        """Yield each fault with the path of its key."""
        match error:
            case ForbiddenExtraKeysError():
                known = [self._key(each.name) for each in fields(error.cl)]
                yield path, unknown_keys(error.extra_fields, known)
            case ClassValidationError() | IterableValidationError():
                noted, bare = error.group_exceptions()
                for inner, note in noted:
                    if isinstance(note, IterableValidationNote):
                        yield from self._faults(inner, _joined(path, note.index))
                    elif isinstance(inner, KeyError):
                        yield path, f"key {self._key(note.name)!r} is missing"
                    else:
                        yield from self._faults(inner, _joined(path, self._key(note.name)))
                for inner in bare:
                    yield from self._faults(inner, path)
            case FormatError():
                for inside, text in error.faults:
                    yield _joined(path, inside), text
            case _:
                yield path, str(error)


def _is_tuple(kind: Any) -> bool:
    return get_origin(kind) is tuple


def _is_dict(kind: Any) -> bool:
    return get_origin(kind) is dict


def _is_one_of(kind: Any) -> bool:
    return isinstance(kind, UnionType) and NoneType not in get_args(kind)


def _is_angle(each: Field[Any]) -> bool:
    return each.name.endswith(_ANGLES) or "angle" in each.metadata


def _quantity_hook(each: Field[Any]) -> Callable[[Any, Any], float | None] | None:
    """Return the reader of a number that may have a unit, by the suffix of its field."""
    unit = unit_of(each.name)
    if not unit or each.type not in (float, float | None):
        return None

    def read(raw: Any, kind: Any) -> float | None:
        if raw is None and NoneType in get_args(kind):
            return None
        return read_quantity(raw, unit) if isinstance(raw, str) else _number(raw, kind)

    return read


def _joined(path: str, key: str | int) -> str:
    if isinstance(key, int):
        return f"{path}[{key}]"
    return path + key if key.startswith("[") else ".".join(filter(None, (path, key)))


def _check_bounds(key: str, value: Any, bounds: Mapping[Any, Any]) -> None:
    if value is None or "least" not in bounds or bounds["least"] <= value <= bounds["most"]:
        return
    text = f"{value:g}" if isinstance(value, float) else quoted(value)
    if bounds["most"] == inf:
        raise FormatError(key, f"{text} is below {bounds['least']:g}")
    raise FormatError(key, f"{text} is not in {bounds['least']:g} .. {bounds['most']:g}")


def _merged(base: Any, changes: Any) -> Any:
    """Return data updated with changes at any depth; other values than mappings are replaced."""
    if not (isinstance(base, dict) and isinstance(changes, dict)):
        return changes
    return {**base, **{key: _merged(base.get(key), value) for key, value in changes.items()}}


def _without_unit(name: str) -> str:
    return _UNIT.sub("", name)


def suggestion(name: object, known: Iterable[str]) -> str:
    """Return the nearest known name in brackets; empty without one."""
    near = get_close_matches(str(name), known, 1)
    return f" (did you mean {near[0]}?)" if near else ""


def unknown_keys(keys: Collection[str], known: Sequence[str]) -> str:
    """Return an error text for unknown keys."""
    near = {quoted(key): suggestion(key, known) for key in sorted(keys, key=str)}
    text = "unknown key " + ", ".join(key + found for key, found in near.items())
    if all(near.values()) and len(known) > MANY:
        return text
    return f"{text}; known are {', '.join(known) or 'none'}"


def quoted(raw: object) -> str:
    """Return a value as quoted in an error, truncated."""
    try:
        text = repr(raw)
    except ValueError:  # Python does not print a number of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _mapping(raw: object) -> Mapping[Any, Any]:
    if not isinstance(raw, dict):
        raise ValueError(f"expected keys and values, got {quoted(raw)}")
    return raw


def _choice(raw: object, kind: type[Enum]) -> Enum:
    choices = {each.value if isinstance(each.value, str) else each.name: each for each in kind}
    if raw is False and "off" in choices:  # YAML 1.1 reads an unquoted off as false
        return choices["off"]
    for word, member in choices.items():
        if raw in (word, member.value) and not isinstance(raw, bool):
            return member
    raise ValueError(f"{quoted(raw)} is none of {', '.join(choices)}")


def _scalar(raw: Any, kind: Any) -> Any:
    if type(raw) is not kind:
        raise ValueError(f"expected {_TYPE_NAMES[kind]}, got {quoted(raw)}")
    return raw


def _angle(raw: Any, kind: Any) -> float | None:
    if raw is None and NoneType in get_args(kind):
        return None
    return angle_of(raw)


def _number(raw: Any, _: Any, hint: str = "") -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise ValueError(f"expected a number{hint}, got {quoted(raw)}")
    if not -1e300 <= raw <= 1e300:  # greater integers fit no float, and NaN compares false
        raise ValueError(f"expected a finite number, got {quoted(raw)}")
    return float(raw)
