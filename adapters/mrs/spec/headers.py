"""Commands of the core as command headers with their supplements, and back."""

from typing import Final

from adapters.mal import AttributeType, NamedValue, Typed
from adapters.mrs.spec.errors import invalid
from adapters.mrs.spec.types import CommandHeader
from executive.commands import Arrival, Command, Request
from executive.reports import Identity

LINK: Final = "direct"
ARRIVAL: Final = "arrival"
"""The supplement that says what a motion command does to motion under way: append or replace."""

LONGEST_SOURCE: Final = 256
"""Characters of a source's name: it comes back in every notification of its commands."""

NS_PER_S: Final = 1_000_000_000


def to_ns(utc_s: float) -> int:
    """Return nanoseconds since 1970 UTC, as MAL times are given; a float knows no more than µs."""
    return round(utc_s * 1e6) * 1000


def command_of(
    header: CommandHeader, supplements: tuple[NamedValue, ...], request: Request
) -> Command:
    """Return the command that came with a header.

    Raises:
        MalError: Invalid, the supplement `arrival` is there and neither append nor replace, or the
            source's name is too long.
    """
    if len(header.source) > LONGEST_SOURCE:
        raise invalid(0)
    created_ns = header.creationTime
    return Command(
        identity=Identity(header.source, header.commandId),
        request=request,
        link=LINK,
        created_utc_s=None if created_ns is None else created_ns / NS_PER_S,
        lifetime_s=header.lifetime,
        counter=header.counter,
        report_started=header.reportStarted,
        report_progress=header.reportProgress,
        arrival=_arrival(supplements) if supplements else Arrival.APPEND,
    )


def header_of(command: Command) -> CommandHeader:
    """Return the header that a command travels with."""
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
    """Return the supplements that a command travels with; none for the default."""
    if command.arrival is Arrival.APPEND:
        return ()
    value = Typed(AttributeType.IDENTIFIER, command.arrival.value)
    return (NamedValue(name=ARRIVAL, value=value),)


def _arrival(supplements: tuple[NamedValue, ...]) -> Arrival:
    wanted = [supplement.value for supplement in supplements if supplement.name == ARRIVAL]
    match wanted:
        case []:
            return Arrival.APPEND
        case [Typed(type=AttributeType.IDENTIFIER, value=text)] if text in _ARRIVALS:
            return Arrival(text)
        case _:
            raise invalid()


_ARRIVALS: Final = {arrival.value for arrival in Arrival}
