"""Reads the MAL specification that a vector file carries."""

from adapters.mal.specification import (
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
from adapters.mal.specification_xml import MAL_XML, read_areas
from tests.conformance.vectors import Vector


def read_specification(data: Vector) -> Specification:
    """Read it; types that it does not define are the MAL's.

    Raises:
        ArithmeticError, AttributeError, KeyError, TypeError, ValueError: something is missing, of
            another kind than expected, or not resolvable.
    """
    return bind((*read_areas(MAL_XML), _area(data)), {})


def _area(data: Vector) -> Area:
    own = data["area"]
    name, number, version = str(own["name"]), int(own["number"]), int(own["version"])
    enumerations, composites = data.get("enumerations", {}), data.get("composites", {})
    defined = {*enumerations, *composites}
    service_name, service_number = str(data["service"]["name"]), int(data["service"]["number"])

    def ref(type_name: str, is_list: bool = False) -> TypeRef:
        return TypeRef(name if type_name in defined else "MAL", type_name, is_list)

    def fields(parts: list[Vector]) -> tuple[Field, ...]:
        return tuple(
            Field(p["name"], ref(p["type"], p.get("list", False)), p.get("nullable", False))
            for p in parts
        )

    operations = []
    for operation_number, operation in data["operations"].items():
        pattern = Pattern[operation["pattern"]]
        messages = {stage: fields(parts) for stage, parts in operation["stages"].items()}
        operations.append(
            Operation(
                number,
                version,
                service_number,
                service_name,
                int(operation_number),
                operation["name"],
                pattern,
                stage_parts(pattern, messages),
                messages.get("subscriptionKeys", ()),
            )
        )
    types: list[CompositeType | EnumerationType] = [
        EnumerationType(
            type_name,
            int(e["shortForm"]),
            tuple(EnumerationItem(item, int(value)) for value, item in e["values"].items()),
        )
        for type_name, e in enumerations.items()
    ]
    types += [
        CompositeType(type_name, c.get("shortForm"), ref(c["extends"]), fields(c["fields"]))
        for type_name, c in composites.items()
    ]
    return Area(
        name,
        number,
        version,
        (Service(service_name, service_number, tuple(operations)),),
        tuple(types),
        tuple(ErrorDefinition(error, int(n)) for error, n in data.get("errors", {}).items()),
    )
