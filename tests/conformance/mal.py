"""The command `rover mal check`: captured messages, against this MAL stack."""

import dataclasses
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final

import click

from adapters.mal.attribute_codec import Encoding
from adapters.mal.codec import ERROR_PARTS, VERSION, Codec, Header, decode_message, encode_message
from adapters.mal.errors import MalError
from adapters.mal.specification import (
    ATTRIBUTES,
    EnumerationType,
    Specification,
    TypeRef,
    python_name,
)
from adapters.mal.values import AttributeType, TypedAttribute, TypedList
from tests.conformance.specification import read_specification
from tests.conformance.vectors import (
    FILE,
    VERBOSE,
    Single,
    Time,
    Vector,
    Verdict,
    differing,
    differing_octets,
    judge,
    octets,
    report,
)

_NAMES: Final = {kind: ref for ref, kind in ATTRIBUTES.items()}
_SUPPLEMENTS: Final = TypeRef("MAL", "NamedValue", is_list=True)


@click.group()
def mal() -> None:
    """Look into messages of the CCSDS Message Abstraction Layer.

    \b
    Example:
      rover mal check vectors.json
    """


@mal.command()
@FILE
@click.option(
    "--encoding",
    type=click.Choice(["fixed", "variable", "split"]),
    help="Check only messages whose body is in this encoding.",
)
@VERBOSE
def check(path: Path, encoding: str | None, verbose: bool) -> None:
    """Check captured messages against this MAL stack, octet for octet.

    FILE is JSON with a testSpecification and a list of vectors. Each message is decoded, compared
    with the header and the value given for it, encoded again and compared with itself.

    Exit status: 0 if every message agrees, 1 if one does not or there is none, 2 if FILE cannot
    be used.

    \b
    Example:
      rover mal check vectors.json --encoding fixed
    """
    report(path, partial(_verdicts, encoding=encoding), verbose)


def _verdicts(data: Vector, encoding: str | None) -> Iterator[Verdict]:
    messages = _Messages(read_specification(data["testSpecification"]))
    for index, vector in enumerate(data["vectors"]):
        if encoding in (None, str(vector.get("encoding"))):
            reported = ("encoding", "sender", "case", "stage")
            text = [str(vector[name]) for name in reported if name in vector]
            label = f"{index} {' '.join(text)}"
            differences = messages.differences(vector)
            yield judge(label, differences, MalError, ValueError, RecursionError)


class _Messages:
    """Compares messages with what this stack makes of them by a specification."""

    def __init__(self, specification: Specification) -> None:
        self.specification = specification
        self._codecs = {encoding.value: Codec(specification, encoding) for encoding in Encoding}
        self._refs: dict[Any, TypeRef] = {b.cls: ref for ref, b in specification.types.items()}

    def differences(self, vector: Vector) -> Iterator[str]:
        """One line for each thing that a vector and this stack differ in.

        Raises:
            MalError, ValueError: this stack refuses the message, or nothing can be compared.
        """
        encoding = str(vector.get("encoding"))
        if encoding not in self._codecs:
            raise ValueError(f"encoding: {encoding!r} is none")
        codec = self._codecs[encoding]
        message = octets(vector.get("message"), "message")
        header, body = decode_message(message)
        yield from self._header(vector, header, message, body)
        operation = self.specification.resolve(
            header.area, header.area_version, header.service, header.operation
        )
        if header.stage not in operation.parts:
            raise ValueError(f"header: operation {operation.name} has no {header.stage.name}")
        parts = ERROR_PARTS if header.is_error else operation.parts[header.stage]
        values = codec.decode(parts, body)
        if "value" in vector:
            got: Any = [self._plain(p.type, v) for p, v in zip(parts, values, strict=True)]
            wanted = vector["value"]
            if header.is_error:
                got = dict(zip(("errorNumber", "extraInfo"), got, strict=True))
            elif len(parts) == 1 and not isinstance(wanted, list):
                wanted = [wanted]
            yield from differing(wanted, got, "value")
        yield from differing_octets(message, encode_message(header, codec.encode(parts, values)))

    def _header(self, vector: Vector, header: Header, message: bytes, body: bytes) -> Iterator[str]:
        if "headerLength" in vector:
            yield from differing(vector["headerLength"], len(message) - len(body), "headerLength")
        if "body" in vector:
            yield from differing(octets(vector["body"], "body"), body, "body")
        wanted = vector.get("header", {})
        if not isinstance(wanted, dict):
            raise ValueError(f"header: an object wanted, not {wanted!r}")
        decoded = _header_fields(header, len(message))
        supplements = self._plain(_SUPPLEMENTS, header.supplements)
        count_only = isinstance(wanted.get("supplements"), int)
        decoded["supplements"] = len(supplements) if count_only else supplements
        for name, value in wanted.items():
            if name in decoded:
                yield from differing(value, decoded[name], f"header.{name}")
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
            case TypedAttribute():
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


def _plain_attribute(kind: AttributeType, value: Any) -> Any:
    match kind:
        case AttributeType.BLOB:
            return value.hex()
        case AttributeType.FLOAT:
            return Single(value)
        case AttributeType.TIME | AttributeType.FINETIME:
            return Time(value)
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
        "timestamp": None if header.timestamp_ns is None else Time(header.timestamp_ns),
        "authenticationId": proof if proof is None else proof.hex(),
    }
