"""Converts the header and the message supplements of a command, in both directions."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final, TypeVar

from adapters.mal import AttributeType, NamedValue, TypedAttribute
from adapters.mrs.spec.errors import AreaError, invalid_error, with_text
from adapters.mrs.spec.mapping import MAX_SOURCE_LENGTH, NS_PER_S, to_ns
from adapters.mrs.spec.types import CommandHeader
from executive.commands import (
    DIRECT_LINK,
    Command,
    FollowPath,
    Mode,
    MoveTo,
    Precondition,
    PreemptionPolicy,
    Request,
    Stop,
)
from executive.settings import TargetFrame
from executive.values.reports import Identity

R = TypeVar("R", bound=Request)
T = TypeVar("T")

LINK: Final = DIRECT_LINK
PREEMPTION: Final = "preemption"
"""Supplement of a motion command: append queues it, replace first cancels all other motions."""
TARGET_FRAME: Final = "frame"
"""Supplement for the frame of the waypoints: odom or map."""
AUTHORITY: Final = "authority"
"""Supplement for the epoch of the authority."""
PRECONDITIONS: Final = {
    "onlyAt": (AttributeType.STRING, "X Y WITHIN [HEADING WITHIN], bounds above 0"),
    "onlyAfter": (AttributeType.LONG, "a command number, from 1"),
    "onlyMode": (AttributeType.IDENTIFIER, f"a mode: {', '.join(Mode.__members__)}"),
}
"""Supplements of the precondition, in the order of `Precondition.wire_values`: type and values."""
LIST_PRECONDITIONS: Final = ("Status", "listPreconditions")
"""Operation of assets that obey them; others ignore unknown supplements."""


def command_of(
    header: CommandHeader,
    supplements: tuple[NamedValue, ...],
    request: Request,
    peer: str | None = None,
) -> Command:
    """Return the command of a received header. A stop is accepted with any header.

    `peer` is the name of the client's certificate; None in clear text.

    Raises:
        MalError: Invalid, the supplement `preemption` is neither append nor replace, `authority` is
            no Long, `frame` neither odom nor map, a precondition cannot be read, or the source is
            too long.
    """
    if isinstance(request, Stop):
        supplements = ()
    elif len(header.source) > MAX_SOURCE_LENGTH:
        raise invalid_error(0)
    created_ns = header.creationTime
    return Command(
        identity=Identity(header.source, header.commandId),
        request=framed(request, supplements),
        link=LINK,
        created_utc_s=None if created_ns is None else created_ns / NS_PER_S,
        lifetime_s=header.lifetime,
        counter=header.counter,
        report_started=header.reportStarted,
        report_progress=header.reportProgress,
        preemption=_preemption(supplements),
        authority=_read(AUTHORITY, AttributeType.LONG, "the epoch", int, supplements),
        peer=peer,
        precondition=_precondition(supplements) if supplements else None,
    )


def header_of(command: Command) -> CommandHeader:
    """Return the message header of a command."""
    created_s = command.created_utc_s
    return CommandHeader(
        commandId=command.identity.command_id,
        source=command.identity.source,
        counter=command.counter,
        lifetime=command.lifetime_s,
        creationTime=None if created_s is None else to_ns(created_s),
        reportStarted=command.report_started,
        reportProgress=command.report_progress,
    )


def supplements_of(command: Command) -> tuple[NamedValue, ...]:
    """Return the message supplements of a command; none for the defaults."""
    found = []
    if command.preemption is not PreemptionPolicy.APPEND:
        found.append(
            (PREEMPTION, TypedAttribute(AttributeType.IDENTIFIER, command.preemption.value))
        )
    if command.authority is not None:
        found.append((AUTHORITY, TypedAttribute(AttributeType.LONG, command.authority)))
    if command.precondition is not None and not isinstance(command.request, Stop):
        found += [
            (name, TypedAttribute(kind, value))
            for (name, (kind, _)), value in zip(
                PRECONDITIONS.items(), command.precondition.wire_values, strict=True
            )
            if value is not None
        ]
    return (
        *(NamedValue(name=name, value=value) for name, value in found),
        *frame_supplements(command.request),
    )


def frame_supplements(request: Request) -> tuple[NamedValue, ...]:
    """Return the supplement of the frame of a request's waypoints, if it names one."""
    if not isinstance(request, MoveTo | FollowPath) or request.frame is None:
        return ()
    value = TypedAttribute(AttributeType.IDENTIFIER, request.frame.value)
    return (NamedValue(name=TARGET_FRAME, value=value),)


def _read(
    name: str,
    kind: AttributeType,
    expected: str,
    read: Callable[[Any], T],
    supplements: tuple[NamedValue, ...],
) -> T | None:
    """Return the value of a supplement, None without it; raise MalError: Invalid if it is wrong."""
    match [supplement.value for supplement in supplements if supplement.name == name]:
        case []:
            return None
        case [TypedAttribute(type=given, value=value)] if given is kind:
            with suppress(ValueError):
                return read(value)
    text = f"supplement {name}: one {kind.name.title()}, {expected}"
    raise with_text(AreaError.INVALID, text)


def _preemption(supplements: tuple[NamedValue, ...]) -> PreemptionPolicy:
    kind, expected = AttributeType.IDENTIFIER, "append or replace"
    found = _read(PREEMPTION, kind, expected, PreemptionPolicy, supplements)
    return found or PreemptionPolicy.APPEND


def _precondition(supplements: tuple[NamedValue, ...]) -> Precondition | None:
    values = list[Any]()

    def check(value: Any) -> Any:
        Precondition.from_wire(*(*values, value))
        return value

    for name, (kind, expected) in PRECONDITIONS.items():
        values.append(_read(name, kind, expected, check, supplements))
    return Precondition.from_wire(*values)


def framed(request: R, supplements: tuple[NamedValue, ...]) -> R:
    """Return a request with the frame of its waypoints that the supplements name.

    Raises:
        MalError: Invalid, the supplement is neither odom nor map.
    """
    if not isinstance(request, MoveTo | FollowPath):
        return request
    frame = _read(TARGET_FRAME, AttributeType.IDENTIFIER, "map or odom", TargetFrame, supplements)
    return request if frame is None else replace(request, frame=frame)
