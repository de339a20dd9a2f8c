"""Requests and reports on the links, as a version of the product encodes them."""

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any, Final

from adapters.mal import Codec, Header, InteractionStage, encode_message
from adapters.mal.codec import decode_message
from adapters.mops import (
    CommandConditions,
    Dictionary,
    Housekeeping,
    LinkHealth,
    MopsError,
    RelayAuthority,
    authority_message,
    authority_of,
    decode,
    encode,
    event_of,
    health_message,
    health_of,
    housekeeping_message,
    housekeeping_of,
    mode_of,
    parameters_of,
    reply_of,
    telemetry_of,
)
from adapters.mops import report_of as mops_report_of
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
from executive.commands import Command, Mode, Request
from executive.record import digest
from executive.values.parameters import Parameter
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
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


def mops_replies(dictionary: Dictionary) -> dict[str, dict[str, Any]]:
    """Return a message of each kind that a rover or an orbiter sends beside commands.

    Each has its text, and the values that this version reads from it.
    """
    spelling, stamp = dictionary.spelling, (7, CREATED_UTC_S)
    failed = Report(
        *(*stamp, ReportKind.COMMAND, Severity.WARNING, "it's 21.8 V | below 22.0 V"),
        identity=Identity("MOE", 7),
        stage=Stage.FAILED,
        reason=Reason.WRONG_MODE,
        step=2,
        step_count=3,
    )
    fault = Report(*stamp, ReportKind.EVENT, Severity.ALARM, "low", fault="battery_low")
    entry = dictionary.entry_of(spelling.commands["moveForward"])
    known = {parameter: float(number) for number, parameter in enumerate(Parameter)}
    health = LinkHealth(CREATED_UTC_S, 1, 2.5, 3.5, 4.5, 5, 0, True, 9, 10, 8, 1, 1, 20, 0.5)
    housekeeping = Housekeeping(CREATED_UTC_S, {"CPU": 1.5, "DISK": None})
    authority = RelayAuthority(True, "MOE", EPOCH, "MOE")
    messages = {
        "reply": reply_of(failed, entry, "jackal", 3, "ledger"),
        "event": event_of(fault, spelling.event, "jackal", "ledger"),
        "link": health_message(health, spelling.link, "jackal"),
        "telemetry": telemetry_of(known, spelling.telemetry, "jackal", "MOE", Mode.IDLE),
        "housekeeping": housekeeping_message(housekeeping, spelling.housekeeping, "jackal"),
        "authority": authority_message(authority, spelling.authority, "jackal", "MOPS"),
    }
    texts = {name: encode(each).decode("ascii") for name, each in messages.items()}
    return {
        name: {"text": text, "values": mops_values(name, text, dictionary)}
        for name, text in texts.items()
    }


def mops_values(kind: str, text: str, dictionary: Dictionary) -> Any:
    """Return the values in a message, as the other end reads them."""
    message, spelling = decode(text.encode("ascii")), dictionary.spelling
    match kind:
        case "reply" | "event":
            return asdict(mops_report_of(message, dictionary, 0.0))
        case "link":
            return asdict(health_of(message, spelling.link))
        case "telemetry":
            values = parameters_of(message, spelling.telemetry, 0.0)
            return {
                "mode": mode_of(message, spelling.telemetry),
                **{each.parameter.name: each.value for each in values},
            }
        case "housekeeping":
            return asdict(housekeeping_of(message, spelling.housekeeping))
        case _:
            return asdict(authority_of(message))
