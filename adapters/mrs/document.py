"""Writes the interface page of the MRS from its specification.

Usage: python -m adapters.mrs.document > docs/mrs.md
"""

from collections.abc import Iterable, Iterator
from typing import Final

from adapters.mal import (
    Area,
    Codec,
    CompositeType,
    EnumerationType,
    Field,
    Operation,
    Pattern,
    Service,
    Stage,
)
from adapters.mrs.anatomy import anatomy
from adapters.mrs.errors import AreaError, refused
from adapters.mrs.examples import COMMAND_HEADER, call, messages, source
from adapters.mrs.specification import mrs_specification
from executive.reasons import Reason, Refusal
from executive.reports import Identity
from executive.state import DEFINITIONS

_HEAD: Final = """# The METERON Robotic Services

Written by `python -m adapters.mrs.document` from `adapters/mrs/mrs.xml`, an MO specification
(ServiceSchema v003) that any MO tool can generate stubs from. SI units and radians; `?` may be
NULL; `[T]` is a list. How the services are served and used is told in `adapters/mrs/README.md`.
"""
_MESSAGE: Final = """\
A SUBMIT of MotionControl.stop. The header is the same whatever the body is encoded in; numbers are
big-endian. The answer is a message of SDU type 2 with the same transaction id and no body, or an
error: is-error set, then the number of the error and what is said with it.
"""
_EXAMPLES: Final = """\
Below each service stand examples: a call on `adapters.mal.consumer.Consumer`, and the body of each
message of it in fixed encoding. All of them use this header:"""
_STAGES: Final = {
    Pattern.SUBMIT: (Stage.SUBMIT, Stage.SUBMIT_ACK),
    Pattern.REQUEST: (Stage.REQUEST, Stage.REQUEST_RESPONSE),
}


_CODEC: Final = Codec(mrs_specification())


def document() -> str:
    """Return the page, in Markdown."""
    (area,) = (area for area in mrs_specification().areas if area.name == "MRS")
    return "\n".join((_HEAD, *_area(area)))


def _area(area: Area) -> Iterator[str]:
    yield f"Area {area.name}, number {area.number}, version {area.version}."
    yield from ("", "## A message, octet by octet", "", _MESSAGE)
    yield from _table(("offset", "octets", "meaning"), anatomy())
    yield from ("", _EXAMPLES, "", "```python", f"command = {source(COMMAND_HEADER)}", "```")
    for service in area.services:
        yield from _service(service)
    yield from ("", "## Types", "")
    rows = ((t.name, t.short_form, _content(t)) for t in area.types)
    yield from _table(("type", "short form", "content"), rows)
    yield from ("", "## Errors", "")
    errors = ((e.number, e.name, e.comment) for e in area.errors)
    yield from _table(("number", "error", "meaning"), errors)
    yield from ("", "## Reasons", "", "The number travels as `Notification.code`.", "")
    yield from _table(("number", "reason", "as a refusal, the error"), map(_reason, Reason))
    yield from ("", "## Parameters", "")
    parameters = ((d.parameter.value, d.unit, d.description) for d in DEFINITIONS)
    yield from _table(("name", "unit", "meaning"), parameters)


def _service(service: Service) -> Iterator[str]:
    yield from ("", f"## {service.number} {service.name}", "", service.comment, "")
    header = ("number", "operation", "pattern", "in", "out", "errors", "purpose")
    yield from _table(header, map(_operation, service.operations))
    yield from ("", "```python", *_examples(service), "```")


def _examples(service: Service) -> Iterator[str]:
    for operation in service.operations:
        yield call(operation)
        for message in messages(operation):
            yield from _octets(message.stage.name, message.octets(_CODEC))


def _octets(name: str, body: bytes) -> Iterator[str]:
    """Yield a body in groups of four octets, eight groups a line."""
    rows = [body[at : at + 32].hex(" ", -4) for at in range(0, len(body), 32)] or ["no octets"]
    yield from (f"# {name:17} {rows[0]}", *(f"# {'':17} {row}" for row in rows[1:]))


def _operation(operation: Operation) -> tuple[object, ...]:
    match operation.pattern:
        case Pattern.SUBMIT | Pattern.REQUEST:
            taken, given = (_fields(operation.parts[s]) for s in _STAGES[operation.pattern])
        case Pattern.PUBSUB:
            taken = f"keys {_fields(operation.keys)}"
            given = _fields(operation.parts[Stage.PUBLISH][1:])
        case _:
            first, *more = operation.parts.values()
            taken, given = _fields(first), "; then ".join(map(_fields, more))
    return (
        operation.number,
        operation.name,
        operation.pattern.name,
        taken,
        given,
        ", ".join(operation.errors),
        operation.comment,
    )


def _fields(fields: Iterable[Field]) -> str:
    return ", ".join(f"{field.name}: {_type(field)}" for field in fields)


def _type(field: Field) -> str:
    name = f"[{field.type.name}]" if field.type.is_list else field.type.name
    return name + ("?" if field.nullable else "")


def _content(definition: CompositeType | EnumerationType) -> str:
    match definition:
        case CompositeType():
            lines = (f"{f.name}: {_type(f)} – {f.comment}" for f in definition.fields)
        case EnumerationType():
            lines = (f"{i.value} {i.name} {i.comment}".rstrip() for i in definition.items)
    return "<br>".join((definition.comment, *lines))


def _reason(reason: Reason) -> tuple[object, ...]:
    if reason.value // 100 in {7, 8}:
        return reason.value, reason.name, "none: it ends a command that was taken"
    error = AreaError(refused(Refusal(reason, ""), Identity("", 0)).number)
    return reason.value, reason.name, error.name.title().replace("_", "")


def _table(header: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> Iterator[str]:
    yield f"| {' | '.join(header)} |"
    yield "|---" * len(header) + "|"
    for row in rows:
        yield f"| {' | '.join(map(str, row))} |"


if __name__ == "__main__":
    print(document())
