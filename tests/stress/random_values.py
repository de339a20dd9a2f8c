"""Random values of any type of a specification, often at the edges of what the type holds."""

from collections.abc import Callable
from math import inf, nan
from random import Random
from typing import Any, Final

from adapters.mal import AttributeType, EnumerationType, Field, Specification, Typed, TypedList
from adapters.mal.binding import ATTRIBUTE, ATTRIBUTES, ELEMENT, python_name
from adapters.mal.specification import TypeRef
from adapters.mal.values import ObjectRef

DEEPEST: Final = 4
"""Elements inside elements, where the specification leaves the depth open."""
_NONE, _LONG_LIST = 0.3, 0.02
_DAY_NS: Final = 86_400_000_000_000
_LAST_NS: Final = (65536 - 4383) * _DAY_NS - 1
"""The last nanosecond that a FineTime holds; the first is 4383 days before 1970."""
_DOUBLES: Final = (0.0, -0.0, 1.0, nan, inf, -inf, 1e9, -1e300, 5e-324)
_ATTRIBUTE_TYPES: Final = tuple(AttributeType)


class Values:
    """Makes values, the same ones for the same random generator.

    Args:
        words: texts that mean something to who is served, taken half of the time.
    """

    def __init__(self, specification: Specification, random: Random, words: tuple[str, ...]):
        """Find out what may stand in for each abstract type."""
        self._random = random
        self._words = words
        self._types = specification.types
        self._concrete = [ref for ref, bound in self._types.items() if bound.type_id is not None]
        self._plain: dict[AttributeType, Callable[[], Any]] = {
            AttributeType.BLOB: lambda: self._word().encode(),
            AttributeType.BOOLEAN: lambda: random.random() < 0.5,
            AttributeType.DURATION: self._double,
            AttributeType.FLOAT: self._single,
            AttributeType.DOUBLE: self._double,
            AttributeType.IDENTIFIER: self._word,
            AttributeType.OCTET: lambda: self._integer(8, signed=True),
            AttributeType.UOCTET: lambda: self._integer(8, signed=False),
            AttributeType.SHORT: lambda: self._integer(16, signed=True),
            AttributeType.USHORT: lambda: self._integer(16, signed=False),
            AttributeType.INTEGER: lambda: self._integer(32, signed=True),
            AttributeType.UINTEGER: lambda: self._integer(32, signed=False),
            AttributeType.LONG: lambda: self._integer(64, signed=True),
            AttributeType.ULONG: lambda: self._integer(64, signed=False),
            AttributeType.STRING: self._word,
            AttributeType.TIME: lambda: self._time_ns() // 1_000_000 * 1_000_000,
            AttributeType.FINETIME: self._time_ns,
            AttributeType.URI: self._word,
            AttributeType.OBJECTREF: self._reference,
        }

    def of(self, field: Field, depth: int = 0) -> Any:
        """Return a value of a message part or of a composite's field, None if it may be."""
        if field.nullable and self._random.random() < _NONE:
            return None
        return self._of(field.type, depth)

    def attribute(self) -> Typed:
        """Return an attribute of any type."""
        kind = self._random.choice(_ATTRIBUTE_TYPES)
        return Typed(kind, self._plain[kind]())

    def _of(self, ref: TypeRef, depth: int) -> Any:
        if ref.is_list:
            element = TypeRef(ref.area, ref.name)
            return tuple([self._of(element, depth + 1) for _ in range(self._count())])
        if ref in ATTRIBUTES:
            return self._plain[ATTRIBUTES[ref]]()
        if ref == ATTRIBUTE:
            return self.attribute()
        bound = self._types.get(ref)
        if bound is None or bound.type_id is None:
            return self._in_place_of(ref, depth)
        if isinstance(bound.definition, EnumerationType):
            return self._random.choice(list(bound.cls.__members__.values()))
        return bound.cls(
            **{python_name(field.name): self.of(field, depth + 1) for field in bound.fields}
        )

    def _in_place_of(self, base: TypeRef, depth: int) -> Any:
        """A value of any type that may stand where an abstract one is wanted."""
        if base == ELEMENT:
            match self._random.randrange(4 if depth < DEEPEST else 2):
                case 0:
                    return self.attribute()
                case 1:
                    kind = self._random.choice(_ATTRIBUTE_TYPES)
                    return TypedList(kind, tuple(self._plain[kind]() for _ in range(self._count())))
                case 2:
                    values = tuple(self._of(ELEMENT, depth + 1) for _ in range(self._count()))
                    return TypedList(None, values)
                case _:
                    return self._of(self._random.choice(self._concrete), depth + 1)
        fitting = [ref for ref in self._concrete if base in self._types[ref].ancestors]
        return self._of(self._random.choice(fitting), depth + 1)

    def _count(self) -> int:
        if self._random.random() < _LONG_LIST:
            return self._random.randrange(100)
        return self._random.randrange(4)

    def _integer(self, bits: int, signed: bool) -> int:
        low = -(1 << bits - 1) if signed else 0
        high = low + (1 << bits) - 1
        match self._random.randrange(4):
            case 0:
                return self._random.choice((low, high, 0, 1))
            case 1:
                return self._random.randint(low, high)
            case _:
                return self._random.randrange(1, 100)

    def _double(self) -> float:
        odd = self._random.random() < 0.2
        return self._random.choice(_DOUBLES) if odd else self._random.uniform(-3.0, 3.0)

    def _single(self) -> float:
        return self._random.choice((0.0, nan, inf, 0.5, -1.25))

    def _time_ns(self) -> int:
        return self._random.choice(
            (0, -4383 * _DAY_NS, _LAST_NS, self._random.randint(0, _LAST_NS))
        )

    def _word(self) -> str:
        if self._random.random() < 0.5:
            return self._random.choice(self._words)
        length = self._random.choice((0, 1, 3, 8, 40))
        return "".join(chr(self._random.randrange(32, 0x250)) for _ in range(length))

    def _reference(self) -> ObjectRef:
        domain = tuple(self._word() for _ in range(self._count()))
        return ObjectRef(domain, self._integer(64, signed=True), self._word(), 1)
