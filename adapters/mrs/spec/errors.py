"""Errors of the MRS: makes them from refusals of the core, and formats them for display."""

from collections.abc import Mapping, Sized
from enum import Enum, unique
from typing import Final, TypeVar

from adapters.mal import AttributeType, MalError, StandardError, TypedAttribute, TypedList
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, printable

T = TypeVar("T")

MAX_ITEMS: Final = 1000
"""Maximum items of one request or message: answering more would delay a stop by seconds."""


_PLAIN: Final = {
    StandardError.DESTINATION_LOST.value: "the connection was lost (DESTINATION_LOST)",
    StandardError.DELIVERY_TIMEDOUT.value: "no answer in time (DELIVERY_TIMEDOUT)",
    StandardError.SHUTDOWN.value: "the rover shuts down (SHUTDOWN)",
}


@unique
class AreaError(Enum):
    """Error numbers of the MRS area."""

    INVALID = 1
    REJECTED = 2
    DUPLICATE = 3
    NOT_SUPPORTED = 4
    NOT_FOUND = 5
    BUSY = 6


def invalid_error(*arguments: int) -> MalError:
    """Return the error for bad arguments, given their indexes among the parts of the message."""
    return MalError(AreaError.INVALID.value, TypedList(AttributeType.UINTEGER, arguments))


def duplicate_error(identity: Identity) -> MalError:
    """Return the error for a commandId that its source has already used."""
    return MalError(
        AreaError.DUPLICATE.value, TypedAttribute(AttributeType.LONG, identity.command_id)
    )


def with_text(error: AreaError | StandardError, text: str) -> MalError:
    """Return an error with a text as extra information."""
    return MalError(error.value, text)


def find_or_raise(known: Mapping[str, T], name: str) -> T:
    """Return the entry of a name; raises NotFound."""
    try:
        return known[name]
    except KeyError:
        raise with_text(AreaError.NOT_FOUND, name) from None


def require_at_most(requested: Sized) -> None:
    """Raise TOO_MANY if one message has more than `MAX_ITEMS` items."""
    if len(requested) > MAX_ITEMS:
        raise with_text(StandardError.TOO_MANY, f"{len(requested)} items, at most {MAX_ITEMS}")


def refusal_error(refusal: Refusal, identity: Identity) -> MalError:
    """Return the error for a refusal, chosen by the hundreds of its reason number."""
    if refusal.reason is Reason.DUPLICATE:
        return duplicate_error(identity)
    match refusal.reason.value // 100:
        case 1:
            return invalid_error(*([] if refusal.argument is None else [refusal.argument]))
        case 4:
            return with_text(AreaError.NOT_SUPPORTED, refusal.text)
        case 5:
            return with_text(AreaError.BUSY, refusal.text)
        case 6:
            return with_text(AreaError.NOT_FOUND, refusal.subject)
        case _:
            return with_text(AreaError.REJECTED, refusal.text)


def describe_error(error: MalError) -> str:
    """Return an error as one printable line, with the error names of the MRS."""
    try:
        kind = AreaError(error.number)
    except ValueError:
        return printable(str(error)) if error.extra else _PLAIN.get(error.number, str(error))
    extra = getattr(error.extra, "value", None)
    if isinstance(extra, str):
        extra = printable(extra)
    match kind:
        case AreaError.DUPLICATE if isinstance(extra, int):
            return (
                f"Duplicate: this source has already used command id {extra}; choose a new number,"
                " unless this is a repeat"
            )
        case AreaError.INVALID if not isinstance(extra, str):
            indexes = ", ".join(map(str, getattr(error.extra, "values", ())))
            return f"Invalid: argument {indexes}" if indexes else "Invalid"
        case _:
            name = kind.name.title().replace("_", "")
            return f"{name}: {extra}" if extra else name
