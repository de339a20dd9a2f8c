"""Checks captured messages with known values against this stack, both ways."""

import calendar
import dataclasses
import json
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from adapters.mal.attribute_codec import Encoding
from adapters.mal.binding import ATTRIBUTES, bind, python_name
from adapters.mal.codec import ERROR_PARTS, Codec
from adapters.mal.errors import MalError, SpecificationError
from adapters.mal.message import (
    VERSION,
    Header,
    decode_message,
    encode_message,
)
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
from adapters.mal.specification_xml import MAL_XML, read_areas
from adapters.mal.values import AttributeType, ObjectRef, Typed, TypedList


class VectorFileError(ValueError):
    """A file is no vector file."""


@dataclass(frozen=True, slots=True)
class Vector:
    """One captured message. What is not given is not compared; nothing in it is checked yet.

    Attributes:
        label: What to call it in a report.
        encoding: Name of the body encoding.
        message: The whole message, in hex.
        given: The other members of the JSON object: header, headerLength, body, value.
    """

    label: str
    encoding: str
    message: Any
    given: dict[str, Any]


def load_vectors(path: Path) -> "VectorCheck":
    """Read a vector file.

    Raises:
        VectorFileError: It cannot be read, or is no vector file; one line says why.
    """
    try:
        data = json.loads(path.read_bytes())
    except OSError as fault:
        raise VectorFileError(f"{path}: {fault.strerror}") from fault
    except (ValueError, RecursionError) as fault:
        raise VectorFileError(f"{path}: not JSON: {fault}") from fault
    if not isinstance(data, dict) or not isinstance(data.get("vectors"), list):
        raise VectorFileError(f"{path}: no list of vectors")
    if "testSpecification" not in data:
        raise VectorFileError(f"{path}: no testSpecification")
    if not all(isinstance(vector, dict) for vector in data["vectors"]):
        raise VectorFileError(f"{path}: a vector is no object")
    try:
        specification = read_test_specification(data["testSpecification"])
    except SpecificationError as fault:
        raise VectorFileError(f"{path}: {fault}") from fault
    return VectorCheck(
        specification, [_vector(*numbered) for numbered in enumerate(data["vectors"])]
    )


def _vector(index: int, data: dict[str, Any]) -> Vector:
    words = [str(data[name]) for name in ("encoding", "sender", "case", "stage") if name in data]
    return Vector(
        f"{index} {' '.join(words)}", str(data.get("encoding")), data.get("message"), dict(data)
    )


_SUPPLEMENTS: Final = TypeRef("MAL", "NamedValue", is_list=True)


class VectorCheck:
    """The messages of a file and their specification, which they are checked against."""

    def __init__(self, specification: Specification, vectors: Sequence[Vector]) -> None:
        self.specification = specification
        self.vectors = vectors
        self._values = VectorValues(specification)
        self._codecs = {encoding.value: Codec(specification, encoding) for encoding in Encoding}

    def disagreements(self, vector: Vector) -> Iterator[str]:
        """One line for each thing that a vector and this stack differ in; none if they agree."""
        try:
            yield from self._check(vector)
        except (MalError, ValueError) as fault:
            yield str(fault)
        except RecursionError:
            yield "value: nested too deeply"

    def _check(self, vector: Vector) -> Iterator[str]:
        if vector.encoding not in self._codecs:
            yield f"encoding: {vector.encoding!r} is none"
            return
        codec = self._codecs[vector.encoding]
        message = _octets(vector.message, "message")
        header, body = decode_message(message)
        yield from self._check_header(vector.given, header, message, body)
        parts = self._parts(header)
        got = codec.decode(parts, body)
        wanted = (
            self._wanted(parts, header, vector.given["value"]) if "value" in vector.given else got
        )
        yield from _differing(wanted, got, "value")
        again = encode_message(header, codec.encode(parts, wanted))
        if again != message:
            pairs = enumerate(zip(again, message, strict=False))
            at = next((index for index, (ours, theirs) in pairs if ours != theirs), len(message))
            yield f"octets: others from octet {at} when encoded, {len(again)} in all"

    def _parts(self, header: Header) -> tuple[Field, ...]:
        operation = self.specification.resolve(
            header.area, header.area_version, header.service, header.operation
        )
        if header.stage not in operation.parts:
            raise ValueError(f"header: operation {operation.name} has no {header.stage.name}")
        return ERROR_PARTS if header.is_error else operation.parts[header.stage]

    def _wanted(self, parts: tuple[Field, ...], header: Header, data: Any) -> tuple[Any, ...]:
        if header.is_error:
            if not isinstance(data, dict) or set(data) != {"errorNumber", "extraInfo"}:
                raise ValueError(f"value: errorNumber and extraInfo wanted, not {data!r}")
            return self._values.parts(parts, [data["errorNumber"], data["extraInfo"]])
        return self._values.parts(parts, data)

    def _check_header(
        self, given: dict[str, Any], header: Header, message: bytes, body: bytes
    ) -> Iterator[str]:
        if "headerLength" in given:
            yield from _differing(given["headerLength"], len(message) - len(body), "headerLength")
        if "body" in given:
            yield from _differing(_octets(given["body"], "body"), body, "body")
        wanted = given.get("header", {})
        if not isinstance(wanted, dict):
            raise ValueError(f"header: an object wanted, not {wanted!r}")
        decoded = _header_fields(header, len(message))
        for name, value in wanted.items():
            where = f"header.{name}"
            if name not in decoded:
                yield f"{where}: no such field"
            elif name == "supplements" and isinstance(value, int):
                yield from _differing(value, len(header.supplements), where)
            elif name == "supplements":
                supplements = self._values.read(_SUPPLEMENTS, value, where)
                yield from _differing(supplements, header.supplements, where)
            elif name == "timestamp" and isinstance(value, str):
                yield from _differing(parse_time(value), header.timestamp_ns, where)
            else:
                yield from _differing(value, decoded[name], where)


def _header_fields(header: Header, length: int) -> dict[str, Any]:
    """The fields of a header by their names in vector files."""
    proof = header.authentication_id
    return {
        "totalLength": length,
        "version": VERSION,
        "sduType": header.stage.value,
        "stage": header.stage.name,
        "area": header.area,
        "service": header.service,
        "operation": header.operation,
        "areaVersion": header.area_version,
        "isError": header.is_error,
        "qosBits": header.qos,
        "sessionBits": header.session,
        "transactionId": header.transaction_id,
        "flags": header.flags,
        "encodingId": 0,
        "supplements": header.supplements,
        "from": header.from_uri,
        "to": header.to_uri,
        "timestamp": header.timestamp_ns,
        "authenticationId": proof if proof is None else proof.hex(),
    }


def _octets(data: Any, where: str) -> bytes:
    try:
        return bytes.fromhex(data)
    except (TypeError, ValueError):
        raise ValueError(f"{where}: not hex") from None


def _differing(wanted: Any, got: Any, path: str) -> Iterator[str]:
    """Yield one line for each place where two values differ, NaN being equal to NaN."""
    if type(wanted) is not type(got):
        pass
    elif isinstance(wanted, tuple) and len(wanted) == len(got):
        for index, (one, other) in enumerate(zip(wanted, got, strict=True)):
            yield from _differing(one, other, f"{path}[{index}]")
        return
    elif dataclasses.is_dataclass(wanted):
        for name in (field.name for field in dataclasses.fields(wanted)):
            yield from _differing(getattr(wanted, name), getattr(got, name), f"{path}.{name}")
        return
    elif wanted == got or (isinstance(wanted, float) and wanted != wanted and got != got):
        return
    yield f"{path}: {wanted!r} wanted, {got!r} decoded"


def read_test_specification(data: Any) -> Specification:
    """Read the specification that a vector file carries; types it does not define are the MAL's.

    Args:
        data: The JSON object.

    Raises:
        SpecificationError: Something is missing, of another kind than expected, or not resolvable.
    """
    try:
        return bind((*read_areas(MAL_XML), _area(data)), {})
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as fault:
        raise SpecificationError(f"testSpecification: {_said(fault)}") from fault


def _said(fault: Exception) -> str:
    return f"{fault} is missing or unknown" if isinstance(fault, KeyError) else str(fault)


def _area(data: Mapping[str, Any]) -> Area:
    own = data["area"]
    name, number, version = str(own["name"]), int(own["number"]), int(own["version"])
    enumerations, composites = data.get("enumerations", {}), data.get("composites", {})
    defined = {*enumerations, *composites}
    service_name, service_number = str(data["service"]["name"]), int(data["service"]["number"])

    def ref(type_name: str, is_list: bool = False) -> TypeRef:
        return TypeRef(name if type_name in defined else "MAL", type_name, is_list)

    def fields(parts: list[Mapping[str, Any]]) -> tuple[Field, ...]:
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
            tuple(Item(item, int(value)) for value, item in e["values"].items()),
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
