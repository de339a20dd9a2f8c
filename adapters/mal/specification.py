"""A service specification as frozen data: areas, services, operations, types, errors."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Any, Final

from adapters.mal.errors import MalError, SpecificationError, StandardError


class Pattern(Enum):
    """The interaction patterns, numbered as MAL's InteractionType."""

    SEND = 1
    SUBMIT = 2
    REQUEST = 3
    INVOKE = 4
    PROGRESS = 5
    PUBSUB = 6


class Stage(Enum):
    """The messages of the patterns; the number is the SDU type on the wire."""

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


@dataclass(frozen=True, slots=True)
class TypeRef:
    """The name of a type, or of a list of it, in an area."""

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
    """A composite, abstract where it has no short form; `fields` are without the parents'."""

    name: str
    short_form: int | None
    extends: TypeRef
    fields: tuple[Field, ...]
    service: int = 0
    comment: str = ""


@dataclass(frozen=True, slots=True)
class Item:
    """One item of an enumeration."""

    name: str
    value: int
    comment: str = ""


@dataclass(frozen=True, slots=True)
class EnumerationType:
    """An enumeration."""

    name: str
    short_form: int
    items: tuple[Item, ...]
    service: int = 0
    comment: str = ""


@dataclass(frozen=True, slots=True)
class ErrorDefinition:
    """An error that an area or service defines."""

    name: str
    number: int
    comment: str = ""


@dataclass(frozen=True, slots=True)
class Operation:
    """An operation and everything a message header says to address it.

    Attributes:
        parts: The parts of every message of the pattern, those the MAL itself defines included.
        keys: The subscription keys of a PUBSUB operation.
        errors: Names of the errors it may raise.
    """

    area: int
    area_version: int
    service: int
    service_name: str
    number: int
    name: str
    pattern: Pattern
    parts: Mapping[Stage, tuple[Field, ...]] = field(hash=False)
    keys: tuple[Field, ...] = ()
    errors: tuple[str, ...] = ()
    comment: str = ""


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
    """A composite or enumeration with what the wire and Python know it by.

    Attributes:
        definition: What the specification says.
        cls: The dataclass or enum of its values.
        type_id: The number that announces it where a type is abstract; None for an abstract one.
        list_id: The same for a list of it.
        fields: All fields of a composite, its parents' first.
        ancestors: The types in whose place it may stand.
    """

    definition: CompositeType | EnumerationType
    cls: type[Any]
    type_id: int | None
    list_id: int | None
    fields: tuple[Field, ...]
    ancestors: frozenset[TypeRef]


class Specification:
    """Areas (the MAL's own among them) that refer to nothing outside, bound to Python classes.

    Attributes:
        areas: The areas.
        types: Every composite and enumeration of the areas.
        classes: The dataclass or enum of each, by type name.
    """

    def __init__(self, areas: tuple[Area, ...], types: Mapping[TypeRef, BoundType]) -> None:
        """Index what is looked up.

        Args:
            areas: The areas.
            types: Every composite and enumeration of the areas.

        Raises:
            SpecificationError: Two operations have the same name or number.
        """
        self.areas = areas
        self.types = MappingProxyType(dict(types))
        self.classes = MappingProxyType({ref.name: bound.cls for ref, bound in types.items()})
        self._by_name: dict[tuple[str, str], Operation] = {}
        self._by_number: dict[tuple[int, int, int, int], Operation] = {}
        for operation in (
            o for area in areas for service in area.services for o in service.operations
        ):
            name = (operation.service_name, operation.name)
            address = (operation.area, operation.area_version, operation.service, operation.number)
            if name in self._by_name or address in self._by_number:
                raise SpecificationError(f"operation {name[0]}.{name[1]} {address} is there twice")
            self._by_name[name] = self._by_number[address] = operation

    def operation(self, service: str, operation: str) -> Operation:
        """Find an operation by its names; KeyError if there is none."""
        return self._by_name[service, operation]

    def resolve(self, area: int, version: int, service: int, operation: int) -> Operation:
        """Find the operation that a header addresses.

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
    Pattern.SEND: {"send": Stage.SEND},
    Pattern.SUBMIT: {"submit": Stage.SUBMIT},
    Pattern.REQUEST: {"request": Stage.REQUEST, "response": Stage.REQUEST_RESPONSE},
    Pattern.INVOKE: {
        "invoke": Stage.INVOKE,
        "acknowledgement": Stage.INVOKE_ACK,
        "response": Stage.INVOKE_RESPONSE,
    },
    Pattern.PROGRESS: {
        "progress": Stage.PROGRESS,
        "acknowledgement": Stage.PROGRESS_ACK,
        "update": Stage.PROGRESS_UPDATE,
        "response": Stage.PROGRESS_RESPONSE,
    },
    Pattern.PUBSUB: {"publishNotify": Stage.PUBLISH},
}
"""The names that a specification gives to the messages it defines."""

_ID: Final = Field("subscriptionId", TypeRef("MAL", "Identifier"))
_UPDATE: Final = Field("updateHeader", TypeRef("MAL", "UpdateHeader"))
_NAMES: Final = TypeRef("MAL", "Identifier", is_list=True)

REPLY: Final = {
    Stage.SUBMIT: Stage.SUBMIT_ACK,
    Stage.REQUEST: Stage.REQUEST_RESPONSE,
    Stage.INVOKE: Stage.INVOKE_ACK,
    Stage.PROGRESS: Stage.PROGRESS_ACK,
    Stage.REGISTER: Stage.REGISTER_ACK,
    Stage.PUBLISH_REGISTER: Stage.PUBLISH_REGISTER_ACK,
    Stage.PUBLISH: Stage.PUBLISH,
    Stage.DEREGISTER: Stage.DEREGISTER_ACK,
    Stage.PUBLISH_DEREGISTER: Stage.PUBLISH_DEREGISTER_ACK,
}
"""The message that answers an initiating one; an error has the number of the reply it replaces."""


def stage_parts(
    pattern: Pattern, messages: Mapping[str, tuple[Field, ...]]
) -> Mapping[Stage, tuple[Field, ...]]:
    """The parts of every message of a pattern.

    Args:
        pattern: The interaction pattern.
        messages: The parts of the messages that the specification defines, by their names there.

    Returns:
        Stage to parts, in the order in which they are sent.
    """
    parts = {stage: messages.get(name, ()) for name, stage in _MESSAGES[pattern].items()}
    match pattern:
        case Pattern.SUBMIT:
            parts[Stage.SUBMIT_ACK] = ()
        case Pattern.PUBSUB:
            update = (_UPDATE, *parts[Stage.PUBLISH])
            parts = {
                Stage.REGISTER: (Field("subscription", TypeRef("MAL", "Subscription")),),
                Stage.REGISTER_ACK: (),
                Stage.PUBLISH_REGISTER: (
                    Field("keyNames", _NAMES),
                    Field("keyTypes", TypeRef("MAL", "AttributeType", is_list=True)),
                ),
                Stage.PUBLISH_REGISTER_ACK: (),
                Stage.PUBLISH: update,
                Stage.NOTIFY: (_ID, *update),
                Stage.DEREGISTER: (Field("subscriptionIds", _NAMES),),
                Stage.DEREGISTER_ACK: (),
                Stage.PUBLISH_DEREGISTER: (),
                Stage.PUBLISH_DEREGISTER_ACK: (),
            }
        case _:
            pass
    return MappingProxyType(parts)
