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
from adapters.mal.codec import ERROR_PARTS, VERSION, Codec, Header, decode_message, encode_message
from adapters.mal.errors import MalError, SpecificationError
from adapters.mal.specification import (
    ATTRIBUTES,
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
    bind,
    python_name,
    stage_parts,
)
from adapters.mal.specification_xml import MAL_XML, read_areas
from adapters.mal.values import AttributeType, Typed, TypedList


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


_NAMES: Final = {kind: ref for ref, kind in ATTRIBUTES.items()}
_SUPPLEMENTS: Final = TypeRef("MAL", "NamedValue", is_list=True)


class VectorCheck:
    """The messages of a file and their specification, which they are checked against."""

    def __init__(self, specification: Specification, vectors: Sequence[Vector]) -> None:
        self.specification = specification
        self.vectors = vectors
        self._codecs = {encoding.value: Codec(specification, encoding) for encoding in Encoding}
        self._refs: dict[Any, TypeRef] = {b.cls: ref for ref, b in specification.types.items()}

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
        codec, given = self._codecs[vector.encoding], vector.given
        message = _octets(vector.message, "message")
        header, body = decode_message(message)
        yield from self._check_header(given, header, message, body)
        operation = self.specification.resolve(
            header.area, header.area_version, header.service, header.operation
        )
        if header.stage not in operation.parts:
            raise ValueError(f"header: operation {operation.name} has no {header.stage.name}")
        parts = ERROR_PARTS if header.is_error else operation.parts[header.stage]
        values = codec.decode(parts, body)
        if "value" in given:
            got: Any = [self._plain(p.type, v) for p, v in zip(parts, values, strict=True)]
            wanted = given["value"]
            if header.is_error:
                got = dict(zip(("errorNumber", "extraInfo"), got, strict=True))
            elif len(parts) == 1 and not isinstance(wanted, list):
                wanted = [wanted]
            yield from _differing(wanted, got, "value")
        again = encode_message(header, codec.encode(parts, values))
        if again != message:
            pairs = enumerate(zip(again, message, strict=False))
            at = next((index for index, (ours, theirs) in pairs if ours != theirs), len(message))
            yield f"octets: others from octet {at} when encoded, {len(again)} in all"

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
        supplements = self._plain(_SUPPLEMENTS, header.supplements)
        count_only = isinstance(wanted.get("supplements"), int)
        decoded["supplements"] = len(supplements) if count_only else supplements
        for name, value in wanted.items():
            if name in decoded:
                yield from _differing(value, decoded[name], f"header.{name}")
            else:
                yield f"header.{name}: no such field"

    def _plain(self, ref: TypeRef, value: Any) -> Any:
        """A value as vector files have it.

        A Blob is hex, an enumeration its item's name, NULL is null. Where the type is abstract, an
        object names it: `{"UOctet": 3}`.
        """
        bound = self.specification.types.get(ref)
        if value is None:
            return None
        if ref.is_list:
            element = dataclasses.replace(ref, is_list=False)
            return [self._plain(element, each) for each in value]
        if ref in ATTRIBUTES:
            return _plain_attribute(ATTRIBUTES[ref], value)
        if bound is None or bound.type_id is None:
            return self._named(value)
        if isinstance(bound.definition, EnumerationType):
            return next(i.name for i in bound.definition.items if i.value == value.value)
        return {
            field.name: self._plain(field.type, getattr(value, python_name(field.name)))
            for field in bound.fields
        }

    def _named(self, value: Any) -> dict[str, Any]:
        match value:
            case Typed():
                return {_NAMES[value.type].name: self._plain(_NAMES[value.type], value.value)}
            case TypedList(type=None):
                elements = TypeRef("MAL", "Element", is_list=True)
                return {"ElementList": self._plain(elements, value.values)}
            case TypedList(type=AttributeType() as kind):
                ref = _NAMES[kind]
            case TypedList():
                ref = self._refs[value.type]
            case _:
                ref = self._refs[type(value)]
                return {ref.name: self._plain(ref, value)}
        elements = dataclasses.replace(ref, is_list=True)
        return {f"{ref.name}List": self._plain(elements, value.values)}


class _Time(int):
    """A time in ns since 1970 UTC, which a file has as ISO 8601 text."""


class _Single(float):
    """A Float, which a file may have with more digits than 32 bits hold."""


def _plain_attribute(kind: AttributeType, value: Any) -> Any:
    match kind:
        case AttributeType.BLOB:
            return value.hex()
        case AttributeType.FLOAT:
            return _Single(value)
        case AttributeType.TIME | AttributeType.FINETIME:
            return _Time(value)
        case AttributeType.OBJECTREF:
            return {**dataclasses.asdict(value), "domain": list(value.domain)}
        case _:
            return value


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
        "from": header.from_uri,
        "to": header.to_uri,
        "timestamp": None if header.timestamp_ns is None else _Time(header.timestamp_ns),
        "authenticationId": proof if proof is None else proof.hex(),
    }


def _octets(data: Any, where: str) -> bytes:
    try:
        return bytes.fromhex(data)
    except (TypeError, ValueError):
        raise ValueError(f"{where}: not hex") from None


def _differing(wanted: Any, got: Any, path: str) -> Iterator[str]:
    """Yield one line for each place where what a file has differs from what was decoded."""
    match got:
        case dict() if isinstance(wanted, dict) and wanted.keys() == got.keys():
            for name in got:
                yield from _differing(wanted[name], got[name], f"{path}.{name}")
            return
        case list() if isinstance(wanted, list) and len(wanted) == len(got):
            for index, (one, other) in enumerate(zip(wanted, got, strict=True)):
                yield from _differing(one, other, f"{path}[{index}]")
            return
        case _Time() if isinstance(wanted, str):
            same = _parse_time(wanted) == got
        case float():
            same = _is_number(wanted, got)
        case _:
            same = type(wanted) is type(got) and wanted == got
    if not same:
        yield f"{path}: {wanted!r} wanted, {got!r} decoded"


def _is_number(wanted: Any, got: float) -> bool:
    """Whether a JSON number, or the name of one that JSON does not have, is a number."""
    number = _NON_FINITE.get(wanted, wanted) if isinstance(wanted, str) else wanted
    if isinstance(number, bool) or not isinstance(number, int | float):
        return False
    try:
        if isinstance(got, _Single):
            number = struct.unpack(">f", struct.pack(">f", number))[0]
        return float(number) == got or (number != number and got != got)
    except (OverflowError, struct.error):
        return False


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


def _parse_time(text: str) -> int:
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
