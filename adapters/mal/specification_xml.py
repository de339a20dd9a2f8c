"""Reads MO service specifications: XML after ServiceSchema v003, as the CCSDS publishes them."""

from pathlib import Path
from types import ModuleType
from typing import Any, Final
from xml.etree import ElementTree

from adapters.mal.binding import bind
from adapters.mal.errors import SpecificationError
from adapters.mal.specification import (
    Area,
    CompositeType,
    EnumerationType,
    ErrorDefinition,
    Field,
    Item,
    Operation,
    Pattern,
    Service,
    Specification,
    TypeRef,
    stage_parts,
)

MAL_XML: Final = Path(__file__).with_name("mal.xml")
_COMPOSITE: Final = TypeRef("MAL", "Composite")


def load_specification(path: Path | str, classes: ModuleType | None = None) -> Specification:
    """Load a service specification, with the MAL's own area added.

    Args:
        path: The XML file.
        classes: A module whose dataclasses and enums are used for the types of their names, as
            `adapters.mal.generate` writes it; a type without one gets a class made at run time.

    Raises:
        OSError: The file cannot be read.
        SpecificationError: It is no specification, or it contradicts itself or the classes.
    """
    areas = read_areas(path)
    if all(area.name != "MAL" for area in areas):
        areas = (*read_areas(MAL_XML), *areas)
    return bind(areas, vars(classes) if classes else {})


def read_areas(path: Path | str) -> tuple[Area, ...]:
    """Read the areas that an XML file defines, nothing resolved yet.

    Raises:
        OSError: The file cannot be read.
        SpecificationError: It is no specification.
    """
    try:
        root = ElementTree.parse(path).getroot()
        areas = tuple(_area(_Node(node)) for node in root if _tag(node) == "area")
    except (ElementTree.ParseError, KeyError, ValueError) as fault:
        raise SpecificationError(f"{path}: {fault}") from fault
    if not areas:
        raise SpecificationError(f"{path}: no area in it")
    return areas


class _Node:
    """An XML element without its namespaces."""

    def __init__(self, element: ElementTree.Element) -> None:
        self._element = element
        self.tag = _tag(element)

    def text(self, name: str) -> str:
        value = self._element.get(name)
        if value is None:
            raise SpecificationError(
                f"<{self.tag} name={self._element.get('name')!r}> has no {name!r}"
            )
        return value

    def has(self, name: str) -> bool:
        return self._element.get(name) is not None

    def number(self, name: str) -> int:
        return int(self.text(name))

    def yes(self, name: str, default: str) -> bool:
        return self._element.get(name, default) in ("true", "1")

    @property
    def comment(self) -> str:
        return self._element.get("comment", "")

    def all(self, *path: str) -> list["_Node"]:
        """The elements found by going down a path of tags; no path for all children."""
        nodes = [_Node(child) for child in self._element if _tag(child)]
        for depth, tag in enumerate(path):
            nodes = [node for node in nodes if node.tag == tag]
            if depth + 1 < len(path):
                nodes = [child for node in nodes for child in node.all()]
        return nodes


def _tag(element: ElementTree.Element) -> str:
    tag: Any = element.tag  # a function where the element is an XML comment
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""


def _area(node: _Node) -> Area:
    name, number, version = node.text("name"), node.number("number"), node.number("version")
    services = node.all("service")
    types = [_type(child, 0) for holder in node.all("dataTypes") for child in holder.all()]
    for service in services:
        own = service.number("number")
        types += [
            _type(child, own) for holder in service.all("dataTypes") for child in holder.all()
        ]
    definitions = node.all("errors", "error") + [
        e for s in services for e in s.all("errors", "error")
    ]
    return Area(
        name,
        number,
        version,
        tuple(_service(service, number, version) for service in services),
        tuple(found for found in types if found),
        tuple(ErrorDefinition(e.text("name"), e.number("number"), e.comment) for e in definitions),
        node.comment,
    )


def _service(node: _Node, area: int, version: int) -> Service:
    name, number = node.text("name"), node.number("number")
    operations = []
    for element in (child for holder in node.all("capabilitySet") for child in holder.all()):
        pattern = Pattern[element.tag.removesuffix("IP").upper()]
        messages = {
            message.tag: tuple(_field(part, index) for index, part in enumerate(message.all()))
            for holder in element.all("messages")
            for message in holder.all()
        }
        errors = [e.text("name") for e in element.all("errors", "errorRef", "type")]
        errors += [e.text("name") for e in element.all("errors", "error")]
        operations.append(
            Operation(
                area,
                version,
                number,
                name,
                element.number("number"),
                element.text("name"),
                pattern,
                stage_parts(pattern, messages),
                messages.get("subscriptionKeys", ()),
                tuple(errors),
                element.comment,
            )
        )
    return Service(name, number, tuple(operations), node.comment)


def _type(node: _Node, service: int) -> CompositeType | EnumerationType | None:
    match node.tag:
        case "composite":
            parents = [_type_ref(parent) for parent in node.all("extends", "type")]
            return CompositeType(
                node.text("name"),
                node.number("shortFormPart") if node.has("shortFormPart") else None,
                parents[0] if parents else _COMPOSITE,
                tuple(_field(part, index) for index, part in enumerate(node.all("field"))),
                service,
                node.comment,
            )
        case "enumeration":
            items = tuple(
                Item(i.text("value"), i.number("nvalue"), i.comment) for i in node.all("item")
            )
            short_form = node.number("shortFormPart")
            return EnumerationType(node.text("name"), short_form, items, service, node.comment)
        case _:
            return None


def _field(node: _Node, index: int) -> Field:
    if node.tag == "type":
        return Field(f"part{index}", _type_ref(node), nullable=True)
    name, types = node.text("name"), node.all("type")
    if len(types) != 1:
        raise SpecificationError(f"<{node.tag} name={name!r}> has {len(types)} types")
    return Field(name, _type_ref(types[0]), node.yes("canBeNull", "true"), node.comment)


def _type_ref(node: _Node) -> TypeRef:
    name, is_list = node.text("name"), node.yes("list", "false")
    if node.yes("objectRef", "false") or name.startswith("ObjectRef("):
        return TypeRef("MAL", "ObjectRef", is_list)
    return TypeRef(node.text("area"), name, is_list)
