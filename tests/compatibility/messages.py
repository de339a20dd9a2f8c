"""Requests and reports on the links, as a version of the product encodes them."""

from collections.abc import Iterable
from typing import Final

from adapters.mal import Codec, Header, InteractionStage, encode_message
from adapters.mal.codec import decode_message
from adapters.mops import CommandConditions, Dictionary, MopsError, decode, encode
from adapters.mrs.spec import (
    REQUESTS,
    command_of,
    header_of,
    invocation,
    mrs_specification,
    notification_of,
    report_of,
    supplements_of,
)
from executive.commands import Command, Request
from executive.record import digest
from executive.values.reports import Identity, Report
from tests.support.requests import GOOD

CREATED_UTC_S, LIFETIME_S, EPOCH = 1_790_000_000.5, 60.0, 3
_REPORTS: Final = ("Notification", "getNotifications")
_GROUND, _ROVER = "maltcp://127.0.0.1:1024/MOE", "maltcp://127.0.0.1:21000/MRS"


def command(request: Request) -> Command:
    """Return a command with all that a header may have."""
    return Command(
        *(Identity("MOE", 7), request, "direct"),
        created_utc_s=CREATED_UTC_S,
        lifetime_s=LIFETIME_S,
        authority=EPOCH,
    )


def encoded_requests(dictionary: Dictionary) -> dict[str, dict[str, str | None]]:
    """Return each request in MAL and MOPS, by its name, with the digest in the ledger."""
    return {
        type(each).__name__: {
            "mal": mal_octets(command(each)).hex(),
            "mops": _mops_text(command(each), dictionary),
            "digest": digest(command(each)).hex(),
        }
        for each in GOOD
    }


def mal_octets(sent: Command) -> bytes:
    """Return the MAL message that requests a command."""
    call = invocation(sent.request)
    specification = mrs_specification()
    operation = specification.operation(call.service, call.operation)
    stage = InteractionStage.SUBMIT
    body = Codec(specification).encode(operation.parts[stage], (header_of(sent), *call.parts))
    header = Header.of(operation, stage, 1, _GROUND, _ROVER, 0, supplements_of(sent))
    return encode_message(header, body)


def from_mal(octets: bytes) -> Command:
    """Return the command that a MAL message requests, as a rover reads it."""
    specification = mrs_specification()
    header, body = decode_message(octets)
    operation = header.addressed(specification)
    own, *parts = Codec(specification).decode(operation.parts[header.stage], body)
    return command_of(own, header.supplements, REQUESTS[operation.names](*parts))


def _mops_text(sent: Command, dictionary: Dictionary) -> str | None:
    conditions = CommandConditions(sent.authority, sent.created_utc_s, sent.lifetime_s)
    try:
        message = dictionary.command(sent.request, sent.identity, "jackal", conditions)
    except MopsError:
        return None
    return encode(message).decode("ascii")


def from_mops(text: str, dictionary: Dictionary) -> Request:
    """Return the request of a MOPS message, as the relay reads it."""
    return dictionary.request(decode(text.encode("ascii")))


def encoded_reports(reports: Iterable[Report]) -> bytes:
    """Return the body of the answer with these reports."""
    specification = mrs_specification()
    parts = specification.operation(*_REPORTS).parts[InteractionStage.REQUEST_RESPONSE]
    return Codec(specification).encode(parts, (tuple(map(notification_of, reports)),))


def decoded_reports(body: bytes) -> list[Report]:
    """Return the reports of an answer, as the ground reads them."""
    specification = mrs_specification()
    parts = specification.operation(*_REPORTS).parts[InteractionStage.REQUEST_RESPONSE]
    (found,) = Codec(specification).decode(parts, body)
    return [report_of(each) for each in found]
