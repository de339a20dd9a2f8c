"""`load_specification` reads the XML of MO services: ServiceSchema v003, as CCSDS publishes it."""

from pathlib import Path
from types import ModuleType
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from adapters.mal.errors import SpecificationError
from adapters.mal.specification import (
    COMPOSITE,
    Area,
    CompositeType,
    EnumerationItem,
    EnumerationType,
    ErrorDefinition,
    Field,
    Operation,
    Pattern,
    Service,
    Specification,
    TypeRef,
    bind,
    stage_parts,
)

MAL_XML: Final = Path(__file__).with_name("mal.xml")


def load_specification(path: Path | str, classes: ModuleType | None = None) -> Specification:
    """Load a service specification, and add the MAL area.

    Args:
        path: The XML file.
        classes: A module with the dataclasses and enums of the types, by name (docs/mal.md, Tools);
            missing classes are generated at run time.

    Raises:
        OSError: The file cannot be read.
        SpecificationError: It is no specification, is contradictory, or does not match the classes.
    """
    areas = read_areas(path)
    if all(area.name != "MAL" for area in areas):
        areas = (*read_areas(MAL_XML), *areas)
    return bind(areas, vars(classes) if classes else {})


def read_areas(path: Path | str) -> tuple[Area, ...]:
    """Read the areas of an XML file, with unresolved types.

    Raises:
        OSError: The file cannot be read.
        SpecificationError: It is no specification.
    """
    try:
        root = ElementTree.parse(path).getroot()
        for element in root.iter():
            element.tag = element.tag.rpartition("}")[2]
        areas = tuple(_area(element) for element in root.iterfind("area"))
    except (ElementTree.ParseError, KeyError, ValueError) as fault:
        raise SpecificationError(f"{path}: {fault}") from fault
    if not areas:
        raise SpecificationError(f"{path}: has no area")
    return areas


def _area(node: Element) -> Area:
    name, number, version = _text(node, "name"), _number(node, "number"), _number(node, "version")
    services = node.findall("service")
    types = [_type(child, 0) for child in node.iterfind("dataTypes/*")]
    for service in services:
        own = _number(service, "number")
        types += [_type(child, own) for child in service.iterfind("dataTypes/*")]
    errors = [*node.iterfind("errors/error"), *node.iterfind("service/errors/error")]
    return Area(
        name,
        number,
        version,
        tuple(_service(service, number, version) for service in services),
        tuple(found for found in types if found),
        tuple(ErrorDefinition(_text(e, "name"), _number(e, "number"), _comment(e)) for e in errors),
        _comment(node),
    )


def _service(node: Element, area: int, version: int) -> Service:
    name, number = _text(node, "name"), _number(node, "number")
    operations = []
    for element in node.iterfind("capabilitySet/*"):
        pattern = Pattern[element.tag.removesuffix("IP").upper()]
        messages = {
            message.tag: tuple(_field(part, index) for index, part in enumerate(message))
            for message in element.iterfind("messages/*")
        }
        errors = [*element.iterfind("errors/errorRef/type"), *element.iterfind("errors/error")]
        operations.append(
            Operation(
                area,
                version,
                number,
                name,
                _number(element, "number"),
                _text(element, "name"),
                pattern,
                stage_parts(pattern, messages),
                messages.get("subscriptionKeys", ()),
                tuple(_text(error, "name") for error in errors),
                _comment(element),
            )
        )
    return Service(name, number, tuple(operations), _comment(node))


def _type(node: Element, service: int) -> CompositeType | EnumerationType | None:
    match node.tag:
        case "composite":
            parent = node.find("extends/type")
            return CompositeType(
                _text(node, "name"),
                _number(node, "shortFormPart") if "shortFormPart" in node.attrib else None,
                COMPOSITE if parent is None else _type_ref(parent),
                tuple(_field(part, index) for index, part in enumerate(node.iterfind("field"))),
                service,
                _comment(node),
            )
        case "enumeration":
            items = tuple(
                EnumerationItem(_text(item, "value"), _number(item, "nvalue"), _comment(item))
                for item in node.iterfind("item")
            )
            short_form = _number(node, "shortFormPart")
            return EnumerationType(_text(node, "name"), short_form, items, service, _comment(node))
        case _:
            return None


def _field(node: Element, index: int) -> Field:
    if node.tag == "type":
        return Field(f"part{index}", _type_ref(node), nullable=True)
    name, types = _text(node, "name"), node.findall("type")
    if len(types) != 1:
        raise SpecificationError(f"<{node.tag} name={name!r}> has {len(types)} types")
    return Field(name, _type_ref(types[0]), _flag(node, "canBeNull", "true"), _comment(node))


def _type_ref(node: Element) -> TypeRef:
    name, is_list = _text(node, "name"), _flag(node, "list", "false")
    if _flag(node, "objectRef", "false") or name.startswith("ObjectRef("):
        return TypeRef("MAL", "ObjectRef", is_list)
    return TypeRef(_text(node, "area"), name, is_list)


def _text(node: Element, name: str) -> str:
    value = node.get(name)
    if value is None:
        raise SpecificationError(f"<{node.tag} name={node.get('name')!r}> has no {name!r}")
    return value


def _number(node: Element, name: str) -> int:
    return int(_text(node, name))


def _flag(node: Element, name: str, default: str) -> bool:
    return node.get(name, default) in ("true", "1")


def _comment(node: Element) -> str:
    return node.get("comment", "")
