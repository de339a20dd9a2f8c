"""Gives every type of a specification its Python class, its type id and its full list of fields."""

import dataclasses
import keyword
import re
from collections.abc import Mapping
from enum import Enum, EnumMeta
from typing import Any, Final, cast

from adapters.mal import values
from adapters.mal.errors import SpecificationError
from adapters.mal.specification import (
    Area,
    BoundType,
    CompositeType,
    EnumerationType,
    Field,
    Specification,
    TypeRef,
)
from adapters.mal.values import AttributeType

ELEMENT: Final = TypeRef("MAL", "Element")
ATTRIBUTE: Final = TypeRef("MAL", "Attribute")
COMPOSITE: Final = TypeRef("MAL", "Composite")
ATTRIBUTES: Final = {
    TypeRef("MAL", name): kind
    for name, kind in {
        "Blob": AttributeType.BLOB,
        "Boolean": AttributeType.BOOLEAN,
        "Duration": AttributeType.DURATION,
        "Float": AttributeType.FLOAT,
        "Double": AttributeType.DOUBLE,
        "Identifier": AttributeType.IDENTIFIER,
        "Octet": AttributeType.OCTET,
        "UOctet": AttributeType.UOCTET,
        "Short": AttributeType.SHORT,
        "UShort": AttributeType.USHORT,
        "Integer": AttributeType.INTEGER,
        "UInteger": AttributeType.UINTEGER,
        "Long": AttributeType.LONG,
        "ULong": AttributeType.ULONG,
        "String": AttributeType.STRING,
        "Time": AttributeType.TIME,
        "FineTime": AttributeType.FINETIME,
        "URI": AttributeType.URI,
        "ObjectRef": AttributeType.OBJECTREF,
    }.items()
}
"""The attribute types by their names in specifications."""
_FUNDAMENTAL: Final = {ELEMENT, ATTRIBUTE, COMPOSITE, *ATTRIBUTES}


def type_id(
    area: int, version: int, short_form: int, service: int = 0, *, is_list: bool = False
) -> int:
    """The number that announces a type where the specification leaves it open, as a signed Long."""
    number = (
        area << 48
        | service << 32
        | version << 24
        | (-short_form if is_list else short_form) & 0xFFFFFF
    )
    return number - (1 << 64) if number >> 63 else number


def python_name(name: str) -> str:
    """The Python name of a field or item: the same, where Python allows it."""
    plain = re.sub(r"\W", "_", name)
    return plain + "_" if keyword.iskeyword(plain) else plain


def bind(areas: tuple[Area, ...], classes: Mapping[str, Any]) -> Specification:
    """Resolve every type of the areas, which must include the MAL's.

    Args:
        areas: The areas.
        classes: Dataclasses and enums to use, by type name; a type without one gets one made.

    Raises:
        SpecificationError: A type is unknown or there twice, or a class does not fit its type.
    """
    binder = _Binder(areas, classes)
    for area in areas:
        for definition in area.types:
            binder.bind(TypeRef(area.name, definition.name))
        for service in area.services:
            for operation in service.operations:
                for parts in (operation.keys, *operation.parts.values()):
                    binder.check(f"operation {service.name}.{operation.name}", parts)
    binder.check_ids()
    return Specification(areas, binder.bound)


class _Binder:
    def __init__(self, areas: tuple[Area, ...], classes: Mapping[str, Any]) -> None:
        self.bound: dict[TypeRef, BoundType] = {}
        self._classes = classes
        self._areas = {area.name: area for area in areas}
        self._definitions: dict[TypeRef, CompositeType | EnumerationType] = {}
        for area in areas:
            for definition in area.types:
                ref = TypeRef(area.name, definition.name)
                if ref in self._definitions:
                    raise SpecificationError(f"type {ref.area}::{ref.name} is there twice")
                self._definitions[ref] = definition

    def check(self, where: str, parts: tuple[Field, ...]) -> None:
        for part in parts:
            ref = dataclasses.replace(part.type, is_list=False)
            if ref not in self._definitions and ref not in _FUNDAMENTAL:
                raise SpecificationError(
                    f"{where}: {part.name} has unknown type {ref.area}::{ref.name}"
                )

    def check_ids(self) -> None:
        seen: dict[int, str] = {}
        for ref, bound in self.bound.items():
            if bound.type_id is not None and seen.setdefault(bound.type_id, ref.name) != ref.name:
                raise SpecificationError(
                    f"{seen[bound.type_id]} and {ref.name} have one short form"
                )

    def bind(self, ref: TypeRef, children: tuple[TypeRef, ...] = ()) -> BoundType:
        if ref in self.bound:
            return self.bound[ref]
        if ref in children:
            raise SpecificationError(f"type {ref.area}::{ref.name} extends itself")
        definition = self._definitions.get(ref)
        match definition:
            case EnumerationType():
                cls = self._enumeration(ref, definition)
                bound = self._bound(ref, definition, cls, (), frozenset({ELEMENT}))
            case CompositeType():
                bound = self._composite(ref, definition, (*children, ref))
            case None:
                raise SpecificationError(f"unknown type {ref.area}::{ref.name}")
        self.bound[ref] = bound
        return bound

    def _bound(
        self,
        ref: TypeRef,
        definition: CompositeType | EnumerationType,
        cls: type[Any],
        fields: tuple[Field, ...],
        ancestors: frozenset[TypeRef],
    ) -> BoundType:
        area, short_form = self._areas[ref.area], definition.short_form
        if short_form is None:
            return BoundType(definition, cls, None, None, fields, ancestors)
        ids = [
            type_id(area.number, area.version, short_form, definition.service, is_list=is_list)
            for is_list in (False, True)
        ]
        return BoundType(definition, cls, ids[0], ids[1], fields, ancestors)

    def _composite(
        self, ref: TypeRef, definition: CompositeType, children: tuple[TypeRef, ...]
    ) -> BoundType:
        fields, ancestors = definition.fields, frozenset({ELEMENT, COMPOSITE})
        base: type[Any] = object
        if definition.extends != COMPOSITE:
            parent = self.bind(definition.extends, children)
            fields, base = (*parent.fields, *fields), parent.cls
            ancestors = parent.ancestors | {definition.extends}
        self.check(f"composite {ref.area}::{ref.name}", fields)
        names = [python_name(field.name) for field in fields]
        if len(set(names)) < len(names):
            raise SpecificationError(f"composite {ref.area}::{ref.name} has two fields of one name")
        cls = self._given(ref) or _make_dataclass(definition, base)
        if not dataclasses.is_dataclass(cls) or [f.name for f in dataclasses.fields(cls)] != names:
            raise SpecificationError(f"class {ref.name} has not the fields {', '.join(names)}")
        return self._bound(ref, definition, cls, fields, ancestors)

    def _enumeration(self, ref: TypeRef, definition: EnumerationType) -> type[Any]:
        items = {python_name(item.name): item.value for item in definition.items}
        cls: Any = self._given(ref) or Enum(definition.name, items)
        members: Any = cls if isinstance(cls, EnumMeta) else ()
        if {member.name: member.value for member in members} != items:
            raise SpecificationError(f"class {ref.name} has not the items {', '.join(items)}")
        return cast(type[Any], cls)

    def _given(self, ref: TypeRef) -> Any:
        if ref.area == "MAL":
            return getattr(values, ref.name, None)
        return self._classes.get(ref.name)


def _make_dataclass(definition: CompositeType, base: type[Any]) -> type[Any]:
    fields: list[Any] = [
        (python_name(f.name), Any, dataclasses.field(default=None))
        if f.nullable
        else python_name(f.name)
        for f in definition.fields
    ]
    bases = () if base is object else (base,)
    return dataclasses.make_dataclass(
        definition.name, fields, bases=bases, frozen=True, slots=True, kw_only=True
    )
