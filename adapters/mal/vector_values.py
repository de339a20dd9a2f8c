"""The values of a vector file: from JSON to Python by their types, and compared."""

import calendar
import dataclasses
import math
import struct
from collections.abc import Sequence
from datetime import datetime
from typing import Any, Final

from adapters.mal.binding import ATTRIBUTES, python_name
from adapters.mal.specification import (
    CompositeType,
    EnumerationType,
    Field,
    Specification,
    TypeRef,
)
from adapters.mal.values import AttributeType, ObjectRef, Typed, TypedList

_NON_FINITE: Final = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


def parse_time(text: str) -> int:
    """Read an ISO 8601 UTC time such as `2018-06-15T12:34:56.789123456Z`.

    Returns:
        Nanoseconds since 1970 UTC.

    Raises:
        ValueError: It is not of this form.
    """
    moment, _, fraction = text.removesuffix("Z").partition(".")
    if not text.endswith("Z") or (fraction and not fraction.isdecimal()) or len(fraction) > 9:
        raise ValueError(f"{text!r} is no UTC time")
    seconds = calendar.timegm(datetime.fromisoformat(moment).timetuple())
    return seconds * 1_000_000_000 + int(fraction.ljust(9, "0"))


class VectorValues:
    """Reads JSON values: Blob as hex, times as ISO text, enumerations by name, NULL as null.

    Where a type is abstract, the value is an object that names it: `{"UOctet": 3}`.
    """

    def __init__(self, specification: Specification) -> None:
        """Read values of a specification's types."""
        self._types = specification.types
        self._by_name = {ref.name: ref for ref in (*ATTRIBUTES, *specification.types)}

    def parts(self, fields: tuple[Field, ...], data: Any) -> tuple[Any, ...]:
        """Read the parts of a message: a list of them, or the only one.

        Raises:
            ValueError: The JSON is not what the types ask for.
        """
        values = [data] if len(fields) == 1 and not isinstance(data, list) else data
        if not isinstance(values, list) or len(values) != len(fields):
            raise ValueError(f"value: a list of {len(fields)} parts wanted, not {data!r}")
        return tuple(
            self.read(part.type, value, part.name)
            for part, value in zip(fields, values, strict=True)
        )

    def read(self, ref: TypeRef, data: Any, path: str) -> Any:
        """Read one value; raises ValueError that begins with the path."""
        bound = self._types.get(ref)
        if data is None:
            return None
        if ref.is_list:
            if not isinstance(data, list):
                raise ValueError(f"{path}: a list wanted, not {data!r}")
            element = dataclasses.replace(ref, is_list=False)
            return tuple(self.read(element, e, f"{path}[{i}]") for i, e in enumerate(data))
        if ref in ATTRIBUTES:
            try:
                return _attribute(ATTRIBUTES[ref], data)
            except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError, struct.error):
                raise ValueError(f"{path}: {data!r} is no {ref.name}") from None
        if bound is None or bound.type_id is None:
            return self._named(data, path)
        match bound.definition:
            case EnumerationType() as definition:
                found = [item.value for item in definition.items if item.name == data]
                if not found:
                    raise ValueError(f"{path}: {definition.name} has no item {data!r}")
                return bound.cls(found[0])
            case CompositeType():
                names = [field.name for field in bound.fields]
                if not isinstance(data, dict) or set(data) != set(names):
                    raise ValueError(f"{path}: not the fields of a {ref.name}: {data!r}")
                values = {
                    python_name(field.name): self.read(
                        field.type, data[field.name], f"{path}.{field.name}"
                    )
                    for field in bound.fields
                }
                return bound.cls(**values)

    def _named(self, data: Any, path: str) -> Any:
        if not isinstance(data, dict) or len(data) != 1:
            raise ValueError(f"{path}: an object that names its type wanted, not {data!r}")
        ((name, value),) = data.items()
        ref = self._by_name.get(name)
        if ref is None and name.endswith("List"):
            return self._named_list(name.removesuffix("List"), value, path)
        if ref is None:
            raise ValueError(f"{path}: no type {name!r}")
        content = self.read(ref, value, path)
        return Typed(ATTRIBUTES[ref], content) if ref in ATTRIBUTES else content

    def _named_list(self, name: str, data: Any, path: str) -> TypedList:
        ref = self._by_name.get(name, TypeRef("MAL", name))
        values = self.read(dataclasses.replace(ref, is_list=True), data, path)
        bound = self._types.get(ref)
        if ref in ATTRIBUTES:
            return TypedList(ATTRIBUTES[ref], values)
        return TypedList(bound.cls if bound and bound.type_id is not None else None, values)


def _attribute(kind: AttributeType, data: Any) -> Any:
    match kind:
        case AttributeType.BLOB:
            return bytes.fromhex(data)
        case AttributeType.BOOLEAN:
            return _of_class(bool, data)
        case AttributeType.FLOAT:
            value: float = struct.unpack(">f", struct.pack(">f", _number(data)))[0]
            return value
        case AttributeType.DOUBLE | AttributeType.DURATION:
            return _number(data)
        case AttributeType.IDENTIFIER | AttributeType.STRING | AttributeType.URI:
            return _of_class(str, data)
        case AttributeType.TIME | AttributeType.FINETIME:
            return parse_time(data)
        case AttributeType.OBJECTREF:
            domain = tuple(_of_class(str, part) for part in data["domain"])
            return ObjectRef(domain, data["type"], data["key"], data["version"])
        case _:
            return _of_class(int, data)


def _of_class(cls: type, data: Any) -> Any:
    if type(data) is not cls:
        raise TypeError
    return data


def _number(data: Any) -> float:
    if isinstance(data, str):
        return _NON_FINITE[data]
    if isinstance(data, bool):
        raise TypeError
    return float(data)


def difference(wanted: Any, got: Any, path: str) -> str | None:
    """Say where two values differ first.

    Args:
        wanted: The value it should be.
        got: The value it is.
        path: What the text begins with.

    Returns:
        One line, or None if they are equal, NaN being equal to NaN.
    """
    if type(wanted) is type(got):
        if isinstance(wanted, tuple) and len(wanted) == len(got):
            return _first(
                [(w, g, f"{path}[{i}]") for i, (w, g) in enumerate(zip(wanted, got, strict=True))]
            )
        if dataclasses.is_dataclass(wanted):
            names = [field.name for field in dataclasses.fields(wanted)]
            return _first([(getattr(wanted, n), getattr(got, n), f"{path}.{n}") for n in names])
        if wanted == got or (isinstance(wanted, float) and wanted != wanted and got != got):
            return None
    return f"{path}: {wanted!r} wanted, {got!r} decoded"


def _first(pairs: Sequence[tuple[Any, Any, str]]) -> str | None:
    for wanted, got, path in pairs:
        found = difference(wanted, got, path)
        if found is not None:
            return found
    return None
