"""Converts the header and the message supplements of a command, in both directions."""

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
    MoveTo,
    Precondition,
    PreemptionPolicy,
    Request,
    Stop,
)
from executive.settings import TargetFrame
from executive.values.reports import Identity

R = TypeVar("R", bound=Request)

LINK: Final = DIRECT_LINK
PREEMPTION: Final = "preemption"
"""Supplement of a motion command: append queues it, replace first cancels all other motions."""
TARGET_FRAME: Final = "frame"
"""Supplement for the frame of the waypoints: odom or map."""
AUTHORITY: Final = "authority"
"""Supplement for the epoch of the authority."""
PRECONDITIONS: Final = {
    "onlyAt": AttributeType.STRING,
    "onlyAfter": AttributeType.LONG,
    "onlyMode": AttributeType.IDENTIFIER,
}
"""Supplements of the precondition, in the order of `Precondition.wire_values`."""
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
        preemption=_preemption(supplements) if supplements else PreemptionPolicy.APPEND,
        authority=_authority(supplements) if supplements else None,
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
            for (name, kind), value in zip(
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


def _supplement(name: str, supplements: tuple[NamedValue, ...]) -> list[TypedAttribute | None]:
    return [supplement.value for supplement in supplements if supplement.name == name]


def _authority(supplements: tuple[NamedValue, ...]) -> int | None:
    match _supplement(AUTHORITY, supplements):
        case []:
            return None
        case [TypedAttribute(type=AttributeType.LONG, value=int(epoch))]:
            return epoch
        case _:
            raise with_text(AreaError.INVALID, f"supplement {AUTHORITY}: one Long, the epoch")


def _precondition(supplements: tuple[NamedValue, ...]) -> Precondition | None:
    """Return the precondition of a command; raise MalError: Invalid if it cannot be read."""
    found, values = None, list[Any]((None, None, None))
    for position, (name, kind) in enumerate(PRECONDITIONS.items()):
        match _supplement(name, supplements):
            case []:
                continue
            case [TypedAttribute(type=given, value=value)] if given is kind:
                values[position] = value
            case _:
                raise with_text(AreaError.INVALID, f"supplement {name}: one {kind.name.title()}")
        try:
            found = Precondition.from_wire(*values)
        except ValueError as error:
            raise with_text(AreaError.INVALID, f"supplement {name}: {error}") from error
    return found


def _preemption(supplements: tuple[NamedValue, ...]) -> PreemptionPolicy:
    match _supplement(PREEMPTION, supplements):
        case []:
            return PreemptionPolicy.APPEND
        case [TypedAttribute(type=AttributeType.IDENTIFIER, value=text)] if text in _POLICIES:
            return PreemptionPolicy(text)
        case _:
            text = f"supplement {PREEMPTION}: one Identifier, {' or '.join(sorted(_POLICIES))}"
            raise with_text(AreaError.INVALID, text)


def framed(request: R, supplements: tuple[NamedValue, ...]) -> R:
    """Return a request with the frame of its waypoints that the supplements name.

    Raises:
        MalError: Invalid, the supplement is neither odom nor map.
    """
    if not isinstance(request, MoveTo | FollowPath):
        return request
    match _supplement(TARGET_FRAME, supplements):
        case []:
            return request
        case [TypedAttribute(type=AttributeType.IDENTIFIER, value=text)] if text in _FRAMES:
            return replace(request, frame=TargetFrame(text))
        case _:
            text = f"supplement {TARGET_FRAME}: one Identifier, {' or '.join(sorted(_FRAMES))}"
            raise with_text(AreaError.INVALID, text)


_FRAMES: Final = {frame.value for frame in TargetFrame}
_POLICIES: Final = {policy.value for policy in PreemptionPolicy}
