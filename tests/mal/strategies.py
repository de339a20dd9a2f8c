"""Hypothesis strategies for the values of any type of a specification."""

from functools import cache
from typing import Any

from hypothesis import strategies as st

from adapters.mal import (
    AttributeType,
    EnumerationType,
    Field,
    ObjectRef,
    Specification,
    TypedAttribute,
    TypedList,
)
from adapters.mal.specification import (
    ATTRIBUTE,
    ATTRIBUTES,
    COMPOSITE,
    ELEMENT,
    BoundType,
    TypeRef,
    python_name,
)

DAY_NS = 86_400_000_000_000
FIRST_NS, LAST_NS = -4383 * DAY_NS, (65536 - 4383) * DAY_NS - 1


def integers(bits: int, signed: bool) -> st.SearchStrategy[int]:
    low = -(1 << bits - 1) if signed else 0
    return st.integers(low, low + (1 << bits) - 1)


TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
DOUBLES = st.floats(allow_nan=False)
Values = dict[AttributeType, st.SearchStrategy[Any]]
VALUES: Values = {
    AttributeType.BLOB: st.binary(max_size=300),
    AttributeType.BOOLEAN: st.booleans(),
    AttributeType.DURATION: DOUBLES,
    AttributeType.FLOAT: st.floats(width=32, allow_nan=False),
    AttributeType.DOUBLE: DOUBLES,
    AttributeType.IDENTIFIER: TEXT,
    AttributeType.OCTET: integers(8, True),
    AttributeType.UOCTET: integers(8, False),
    AttributeType.SHORT: integers(16, True),
    AttributeType.USHORT: integers(16, False),
    AttributeType.INTEGER: integers(32, True),
    AttributeType.UINTEGER: integers(32, False),
    AttributeType.LONG: integers(64, True),
    AttributeType.ULONG: integers(64, False),
    AttributeType.STRING: TEXT,
    AttributeType.TIME: st.integers(FIRST_NS // 1_000_000, LAST_NS // 1_000_000).map(
        lambda milliseconds: milliseconds * 1_000_000
    ),
    AttributeType.FINETIME: st.integers(FIRST_NS, LAST_NS),
    AttributeType.URI: TEXT,
    AttributeType.OBJECTREF: st.builds(
        ObjectRef,
        st.lists(TEXT, max_size=3).map(tuple),
        integers(64, True),
        TEXT,
        integers(64, True),
    ),
}


class Strategies:
    """The strategies of one specification, made as they are asked for.

    Args:
        values: of attributes, where they are to be others than usual.
    """

    def __init__(self, specification: Specification, values: Values | None = None) -> None:
        self._types = specification.types
        self._values = values = VALUES | (values or {})
        self.typed = st.sampled_from(AttributeType).flatmap(
            lambda kind: values[kind].map(lambda v: TypedAttribute(kind, v))
        )
        self._typed_lists = st.sampled_from(AttributeType).flatmap(
            lambda kind: st.lists(values[kind], max_size=4).map(lambda v: TypedList(kind, tuple(v)))
        )
        self.of = cache(self._of)

    @property
    def types(self) -> list[TypeRef]:
        """Every type that has values: MAL's Object has none, for nothing extends it."""
        bound = [ref for ref in self._types if not self._is_abstract(ref) or self._fitting(ref)]
        return [*ATTRIBUTES, *bound, ATTRIBUTE, COMPOSITE, ELEMENT]

    def field(self, field: Field) -> st.SearchStrategy[Any]:
        """Values of a message part or of a composite's field."""
        values = self.of(field.type)
        return st.none() | values if field.nullable else values

    def _of(self, ref: TypeRef) -> st.SearchStrategy[Any]:
        if ref.is_list:
            element = self.of(TypeRef(ref.area, ref.name))
            if self._is_abstract(TypeRef(ref.area, ref.name)):
                element = st.none() | element
            return st.lists(element, max_size=3).map(tuple)
        if ref in ATTRIBUTES:
            return self._values[ATTRIBUTES[ref]]
        if ref == ATTRIBUTE:
            return self.typed
        if self._is_abstract(ref):
            return st.deferred(lambda: self._in_place_of(ref))
        bound = self._types[ref]
        if isinstance(bound.definition, EnumerationType):
            return st.sampled_from(list(bound.cls.__members__.values()))
        return st.deferred(lambda: self._composite(bound))

    def _is_abstract(self, ref: TypeRef) -> bool:
        bound = self._types.get(ref)
        return bound.type_id is None if bound else ref not in ATTRIBUTES

    def _fitting(self, base: TypeRef) -> list[TypeRef]:
        return [
            ref
            for ref, bound in self._types.items()
            if bound.type_id is not None and base in bound.ancestors
        ]

    def _composite(self, bound: BoundType) -> st.SearchStrategy[Any]:
        fields = {python_name(field.name): self.field(field) for field in bound.fields}
        return st.builds(bound.cls, **fields)

    def _in_place_of(self, base: TypeRef) -> st.SearchStrategy[Any]:
        fitting = self._fitting(base)
        concrete = st.sampled_from(fitting).flatmap(self.of)
        if base != ELEMENT:
            return concrete
        lists = st.sampled_from(fitting).flatmap(
            lambda ref: st.lists(self.of(ref), max_size=2).map(
                lambda values: TypedList(self._types[ref].cls, tuple(values))
            )
        )
        simple = self.typed | self._typed_lists | concrete | lists
        mixed = st.lists(st.none() | simple, max_size=3).map(lambda v: TypedList(None, tuple(v)))
        return simple | mixed | st.lists(mixed, max_size=2).map(lambda v: TypedList(None, tuple(v)))
