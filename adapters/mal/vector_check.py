"""Compares one captured message with what this stack makes of it, both ways."""

from collections.abc import Iterator
from typing import Any, Final

from adapters.mal.codec import ERROR_PARTS, Codec
from adapters.mal.encoding import Encoding
from adapters.mal.errors import MalError
from adapters.mal.header import VERSION, Header, decode_message, encode_message
from adapters.mal.specification import Field, Specification, TypeRef
from adapters.mal.vector_file import Vector
from adapters.mal.vector_values import VectorValues, difference, parse_time

_SUPPLEMENTS: Final = TypeRef("MAL", "NamedValue", is_list=True)


class VectorCheck:
    """Checks messages of one specification."""

    def __init__(self, specification: Specification) -> None:
        """Prepare for messages in every encoding."""
        self._specification = specification
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
        operation = self._specification.resolve(
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
    found = difference(wanted, got, path)
    if found is not None:
        yield found
