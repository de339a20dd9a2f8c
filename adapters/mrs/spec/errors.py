"""The errors of the MRS area: how a refusal of the core travels, and how an answer reads."""

from collections.abc import Mapping, Sized
from enum import Enum, unique
from typing import Final, TypeVar

from adapters.mal import AttributeType, MalError, StandardError, TypedAttribute, TypedList
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, printable

T = TypeVar("T")

MOST_AT_ONCE: Final = 1000
"""Of what one message asks for or tells: answering more would keep a stop waiting for seconds."""


_PLAIN: Final = {
    StandardError.DESTINATION_LOST.value: "the connection was lost (DESTINATION_LOST)",
    StandardError.DELIVERY_TIMEDOUT.value: "no answer came in time (DELIVERY_TIMEDOUT)",
    StandardError.SHUTDOWN.value: "it shuts down (SHUTDOWN)",
}


@unique
class AreaError(Enum):
    """The errors that the MRS area defines."""

    INVALID = 1
    REJECTED = 2
    DUPLICATE = 3
    NOT_SUPPORTED = 4
    NOT_FOUND = 5
    BUSY = 6


def invalid(*arguments: int) -> MalError:
    """Return the error for bad arguments, given their indexes among the parts of the message."""
    return MalError(AreaError.INVALID.value, TypedList(AttributeType.UINTEGER, arguments))


def duplicate(identity: Identity) -> MalError:
    """Return the error for a commandId that its source used before."""
    return MalError(
        AreaError.DUPLICATE.value, TypedAttribute(AttributeType.LONG, identity.command_id)
    )


def with_text(error: AreaError | StandardError, text: str) -> MalError:
    """Return an error that says why in words."""
    return MalError(error.value, text)


def look_up(known: Mapping[str, T], name: str) -> T:
    """Return what is known by a name; raises NotFound."""
    try:
        return known[name]
    except KeyError:
        raise with_text(AreaError.NOT_FOUND, name) from None


def require_few(asked: Sized) -> None:
    """Check that one message does not ask for too much, or tell it; raises TOO_MANY."""
    if len(asked) > MOST_AT_ONCE:
        raise with_text(StandardError.TOO_MANY, f"{len(asked)}: {MOST_AT_ONCE} at once at most")


def refused(refusal: Refusal, identity: Identity) -> MalError:
    """Return the error by which a refusal travels; its block of reasons decides which."""
    if refusal.reason is Reason.DUPLICATE:
        return duplicate(identity)
    match refusal.reason.value // 100:
        case 1:
            return invalid(*([] if refusal.argument is None else [refusal.argument]))
        case 4:
            return with_text(AreaError.NOT_SUPPORTED, refusal.text)
        case 5:
            return with_text(AreaError.BUSY, refusal.text)
        case 6:
            return with_text(AreaError.NOT_FOUND, refusal.subject)
        case _:
            return with_text(AreaError.REJECTED, refusal.text)


def describe_error(error: MalError) -> str:
    """Return one printable line on an error, by the names that the MRS gives it."""
    try:
        kind = AreaError(error.number)
    except ValueError:
        return printable(str(error)) if error.extra else _PLAIN.get(error.number, str(error))
    said = getattr(error.extra, "value", None)
    if isinstance(said, str):
        said = printable(said)
    match kind:
        case AreaError.DUPLICATE if isinstance(said, int):
            return (
                f"Duplicate: this source already used command {said}; unless this is a repeat, take"
                " another number"
            )
        case AreaError.INVALID if not isinstance(said, str):
            indexes = ", ".join(map(str, getattr(error.extra, "values", ())))
            return f"Invalid: argument {indexes}" if indexes else "Invalid"
        case _:
            name = kind.name.title().replace("_", "")
            return f"{name}: {said}" if said else name
