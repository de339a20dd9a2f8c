"""MO service specifications as frozen data, bound to Python classes and type ids."""

import dataclasses
import keyword
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, EnumMeta
from types import MappingProxyType
from typing import Any, Final, cast

from adapters.mal import values
from adapters.mal.errors import MalError, SpecificationError, StandardError
from adapters.mal.values import AttributeType


class Pattern(Enum):
    """Interaction patterns, numbered as MAL's InteractionType (CCSDS 521.0-B-3)."""

    SEND = 1
    SUBMIT = 2
    REQUEST = 3
    INVOKE = 4
    PROGRESS = 5
    PUBSUB = 6


class InteractionStage(Enum):
    """Messages of the patterns (CCSDS 521.0-B-3); the number is the SDU type on the wire."""

    SEND = 0
    SUBMIT = 1
    SUBMIT_ACK = 2
    REQUEST = 3
    REQUEST_RESPONSE = 4
    INVOKE = 5
    INVOKE_ACK = 6
    INVOKE_RESPONSE = 7
    PROGRESS = 8
    PROGRESS_ACK = 9
    PROGRESS_UPDATE = 10
    PROGRESS_RESPONSE = 11
    REGISTER = 12
    REGISTER_ACK = 13
    PUBLISH_REGISTER = 14
    PUBLISH_REGISTER_ACK = 15
    PUBLISH = 16
    NOTIFY = 17
    DEREGISTER = 18
    DEREGISTER_ACK = 19
    PUBLISH_DEREGISTER = 20
    PUBLISH_DEREGISTER_ACK = 21

    __hash__ = object.__hash__  # Enum would hash the name several times for each message


@dataclass(frozen=True, slots=True)
class TypeRef:
    """Reference to a type, or to a list of it, in an area."""

    area: str
    name: str
    is_list: bool = False


@dataclass(frozen=True, slots=True)
class Field:
    """A part of a message or a field of a composite."""

    name: str
    type: TypeRef
    nullable: bool = False
    comment: str = ""


@dataclass(frozen=True, slots=True)
class CompositeType:
    """A composite; abstract without a short form. `fields` excludes those of its parents."""

    name: str
    short_form: int | None
    extends: TypeRef
    fields: tuple[Field, ...]
    service: int = 0
    comment: str = ""


@dataclass(frozen=True, slots=True)
class EnumerationItem:
    """One item of an enumeration."""

    name: str
    value: int
    comment: str = ""


@dataclass(frozen=True, slots=True)
class EnumerationType:
    """An enumeration."""

    name: str
    short_form: int
    items: tuple[EnumerationItem, ...]
    service: int = 0
    comment: str = ""


@dataclass(frozen=True, slots=True)
class ErrorDefinition:
    """An error of an area or service."""

    name: str
    number: int
    comment: str = ""


Names = tuple[str, str]
"""Names of a service and an operation."""


@dataclass(frozen=True, slots=True)
class Operation:
    """An operation with all numbers of its address in a message header.

    Attributes:
        parts: Parts of every message of the pattern, including those defined by the MAL.
        keys: Subscription keys of a PUBSUB operation.
    """

    area: int
    area_version: int
    service: int
    service_name: str
    number: int
    name: str
    pattern: Pattern
    parts: Mapping[InteractionStage, tuple[Field, ...]] = field(hash=False)
    keys: tuple[Field, ...] = ()
    errors: tuple[str, ...] = ()
    comment: str = ""

    @property
    def names(self) -> Names:
        """Names of its service and itself."""
        return self.service_name, self.name


@dataclass(frozen=True, slots=True)
class Service:
    """A service of an area."""

    name: str
    number: int
    operations: tuple[Operation, ...]
    comment: str = ""


@dataclass(frozen=True, slots=True)
class Area:
    """An area with its services, types and errors."""

    name: str
    number: int
    version: int
    services: tuple[Service, ...] = ()
    types: tuple[CompositeType | EnumerationType, ...] = ()
    errors: tuple[ErrorDefinition, ...] = ()
    comment: str = ""


@dataclass(frozen=True, slots=True)
class BoundType:
    """A composite or enumeration with its Python class and type ids.

    Attributes:
        cls: The dataclass or enum of its values.
        type_id: Its id on the wire where the specified type is abstract; None if abstract itself.
        list_id: The same for a list of it.
        fields: All fields of a composite, its parents' first.
        ancestors: The types that it can replace.
    """

    definition: CompositeType | EnumerationType
    cls: type[Any]
    type_id: int | None
    list_id: int | None
    fields: tuple[Field, ...]
    ancestors: frozenset[TypeRef]


class Specification:
    """Areas without external references, including the MAL's, bound to Python classes.

    Attributes:
        types: Every composite and enumeration of the areas.
        classes: The dataclass or enum of each, by type name.
    """

    def __init__(self, areas: tuple[Area, ...], types: Mapping[TypeRef, BoundType]) -> None:
        """Index the operations; raises SpecificationError if two have the same name or address."""
        self.areas = areas
        self.types = MappingProxyType(dict(types))
        self.classes = MappingProxyType({ref.name: bound.cls for ref, bound in types.items()})
        self._by_name: dict[Names, Operation] = {}
        self._by_number: dict[tuple[int, int, int, int], Operation] = {}
        for operation in (
            o for area in areas for service in area.services for o in service.operations
        ):
            name = operation.names
            address = (operation.area, operation.area_version, operation.service, operation.number)
            if name in self._by_name or address in self._by_number:
                raise SpecificationError(f"duplicate operation {name[0]}.{name[1]} {address}")
            self._by_name[name] = self._by_number[address] = operation

    def operation(self, service: str, operation: str) -> Operation:
        """Return an operation by its names; raises KeyError."""
        return self._by_name[service, operation]

    def resolve(self, area: int, version: int, service: int, operation: int) -> Operation:
        """Return the operation of a header's address.

        Raises:
            MalError: Unsupported area, area version, service or operation.
        """
        found = self._by_number.get((area, version, service, operation))
        if found is not None:
            return found
        areas = [known for known in self.areas if known.number == area and known.services]
        if not areas:
            raise MalError(StandardError.UNSUPPORTED_AREA)
        if all(known.version != version for known in areas):
            raise MalError(StandardError.UNSUPPORTED_AREA_VERSION)
        if all(known.number != service for known in areas[0].services):
            raise MalError(StandardError.UNSUPPORTED_SERVICE)
        raise MalError(StandardError.UNSUPPORTED_OPERATION)


_MESSAGES: Final = {
    Pattern.SEND: {"send": InteractionStage.SEND},
    Pattern.SUBMIT: {"submit": InteractionStage.SUBMIT},
    Pattern.REQUEST: {
        "request": InteractionStage.REQUEST,
        "response": InteractionStage.REQUEST_RESPONSE,
    },
    Pattern.INVOKE: {
        "invoke": InteractionStage.INVOKE,
        "acknowledgement": InteractionStage.INVOKE_ACK,
        "response": InteractionStage.INVOKE_RESPONSE,
    },
    Pattern.PROGRESS: {
        "progress": InteractionStage.PROGRESS,
        "acknowledgement": InteractionStage.PROGRESS_ACK,
        "update": InteractionStage.PROGRESS_UPDATE,
        "response": InteractionStage.PROGRESS_RESPONSE,
    },
    Pattern.PUBSUB: {"publishNotify": InteractionStage.PUBLISH},
}
"""Element names of messages in the XML, by pattern."""

_ID: Final = Field("subscriptionId", TypeRef("MAL", "Identifier"))
_UPDATE: Final = Field("updateHeader", TypeRef("MAL", "UpdateHeader"))
_NAMES: Final = TypeRef("MAL", "Identifier", is_list=True)

REPLY: Final = {
    InteractionStage.SUBMIT: InteractionStage.SUBMIT_ACK,
    InteractionStage.REQUEST: InteractionStage.REQUEST_RESPONSE,
    InteractionStage.INVOKE: InteractionStage.INVOKE_ACK,
    InteractionStage.PROGRESS: InteractionStage.PROGRESS_ACK,
    InteractionStage.REGISTER: InteractionStage.REGISTER_ACK,
    InteractionStage.PUBLISH_REGISTER: InteractionStage.PUBLISH_REGISTER_ACK,
    InteractionStage.PUBLISH: InteractionStage.PUBLISH,
    InteractionStage.DEREGISTER: InteractionStage.DEREGISTER_ACK,
    InteractionStage.PUBLISH_DEREGISTER: InteractionStage.PUBLISH_DEREGISTER_ACK,
}
"""Reply to each initiating message; an error has the SDU type of the reply that it replaces."""


def stage_parts(
    pattern: Pattern, messages: Mapping[str, tuple[Field, ...]]
) -> Mapping[InteractionStage, tuple[Field, ...]]:
    """Return the parts of every message of a pattern, in order of transmission.

    `messages` has the messages of the specification by element name.
    """
    parts = {stage: messages.get(name, ()) for name, stage in _MESSAGES[pattern].items()}
    match pattern:
        case Pattern.SUBMIT:
            parts[InteractionStage.SUBMIT_ACK] = ()
        case Pattern.PUBSUB:
            update = (_UPDATE, *parts[InteractionStage.PUBLISH])
            parts = {
                InteractionStage.REGISTER: (Field("subscription", TypeRef("MAL", "Subscription")),),
                InteractionStage.REGISTER_ACK: (),
                InteractionStage.PUBLISH_REGISTER: (
                    Field("keyNames", _NAMES),
                    Field("keyTypes", TypeRef("MAL", "AttributeType", is_list=True)),
                ),
                InteractionStage.PUBLISH_REGISTER_ACK: (),
                InteractionStage.PUBLISH: update,
                InteractionStage.NOTIFY: (_ID, *update),
                InteractionStage.DEREGISTER: (Field("subscriptionIds", _NAMES),),
                InteractionStage.DEREGISTER_ACK: (),
                InteractionStage.PUBLISH_DEREGISTER: (),
                InteractionStage.PUBLISH_DEREGISTER_ACK: (),
            }
        case _:
            pass
    return MappingProxyType(parts)


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
"""Attribute types by name in specifications."""
_FUNDAMENTAL: Final = {ELEMENT, ATTRIBUTE, COMPOSITE, *ATTRIBUTES}


def type_id(
    area: int, version: int, short_form: int, service: int = 0, *, is_list: bool = False
) -> int:
    """Return the wire id of a type, used where the specified type is abstract; a signed Long."""
    number = (
        area << 48
        | service << 32
        | version << 24
        | (-short_form if is_list else short_form) & 0xFFFFFF
    )
    return number - (1 << 64) if number >> 63 else number


def python_name(name: str) -> str:
    """Return the Python name of a field or item: the same, if Python allows it."""
    plain = re.sub(r"\W", "_", name)
    return plain + "_" if keyword.iskeyword(plain) else plain


def bind(areas: tuple[Area, ...], classes: Mapping[str, Any]) -> Specification:
    """Resolve every type of the areas, which must include the MAL's.

    Values have the dataclass or enum with the name of their type; a missing class is generated.

    Raises:
        SpecificationError: A type is unknown or duplicate, or a class does not match its type.
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
                    raise SpecificationError(f"duplicate type {ref.area}::{ref.name}")
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
                    f"{seen[bound.type_id]} and {ref.name} have the same short form"
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
            raise SpecificationError(f"composite {ref.area}::{ref.name} has a duplicate field")
        cls = self._type_of(ref) or _make_dataclass(definition, base)
        if not dataclasses.is_dataclass(cls) or [f.name for f in dataclasses.fields(cls)] != names:
            raise SpecificationError(f"class {ref.name} must have the fields {', '.join(names)}")
        return self._bound(ref, definition, cls, fields, ancestors)

    def _enumeration(self, ref: TypeRef, definition: EnumerationType) -> type[Any]:
        items = {python_name(item.name): item.value for item in definition.items}
        cls: Any = self._type_of(ref) or Enum(definition.name, items)
        members: Any = cls if isinstance(cls, EnumMeta) else ()
        if {member.name: member.value for member in members} != items:
            raise SpecificationError(f"class {ref.name} must have the items {', '.join(items)}")
        return cast(type[Any], cls)

    def _type_of(self, ref: TypeRef) -> Any:
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
