"""Converts reports of the core to MOPS replies and events, and back."""

import re
from dataclasses import dataclass
from typing import Final, TypeVar

from adapters.mops.codec import (
    MAX_UTC_S,
    Message,
    MopsError,
    from_values,
    require_within,
    values_of,
)
from adapters.mops.dictionary import Dictionary, Entry, OtherEntry
from executive.commands import RELAY_LINK
from executive.values.reasons import Reason
from executive.values.reports import TERMINAL, Identity, Report, ReportKind, Severity, Stage

TO_ALL: Final = "ALL"
"""Destination of unsolicited messages: events, telemetry."""
LINK: Final = RELAY_LINK
MAX_TEXT_LENGTH: Final = 250
"""Maximum length of a report's text; percent-encoded, it still fits into a message."""
UNNUMBERED: Final = 0
"""Sequence of a report of a sender without numbered reports."""
MAX_SEQUENCE: Final = 999_999_999
"""Maximum sequence of a report, above any ledger's count; the orbiter's stride between ledgers."""
MAX_STEP: Final = (1 << 32) - 1
_LEDGER: Final = re.compile(r"[0-9A-Za-z]{1,32}")
_CUT: Final = "…"
_ENDS: Final = {stage.name for stage in TERMINAL}

N = TypeVar("N", Stage, Severity, Reason)


@dataclass(frozen=True, slots=True)
class _Reply:
    """Outputs of a reply; a brick sends the first three."""

    stage: str
    reason: str
    text: str
    sequence: int | None = None
    utc_s: float | None = None
    severity: str = ""
    step: int | None = None
    step_count: int | None = None
    ledger: str = ""


@dataclass(frozen=True, slots=True)
class _Event:
    """Outputs of an event."""

    severity: str
    reason: str
    text: str
    sequence: int
    utc_s: float
    fault: str = ""
    ledger: str = ""


_REPLY_OUTPUTS: Final = len(_Reply.__slots__)
_EVENT_OUTPUTS: Final = len(_Event.__slots__)


def reply_of(
    report: Report, entry: Entry, source: str, counter: int | None = None, ledger: str = ""
) -> Message:
    """Return the reply for a report on a command. Its figures and its link are omitted.

    Args:
        report: report on a command.
        entry: spelling of the command.
        source: name of the asset in messages.
        counter: moeinputscounter of the command, if it had one.
        ledger: ledger that numbers the report; empty omits it.

    Raises:
        MopsError: the report is not on a command, or the command's source is invalid in messages.
    """
    if report.identity is None or report.stage is None:
        raise MopsError(f"report {report.sequence} is on no command")
    outputs = _Reply(
        report.stage.name,
        report.reason.name if report.reason else "",
        cut(report.text),
        report.sequence,
        report.utc_s,
        report.severity.name,
        report.step,
        report.step_count,
        ledger,
    )
    return Message(
        entry.code,
        source,
        report.identity.source,
        entry.command,
        outputs=_output_values(outputs),
        received=True,
        executed=report.stage is Stage.EXECUTED,
        moe_inputs_id=report.identity.command_id,
        moe_inputs_counter=counter,
    )


def is_last(reply: Message) -> bool:
    """Return whether a reply is the last one: executed, not received, or in a terminal stage."""
    return reply.executed or not reply.received or not _ENDS.isdisjoint(reply.outputs[:1])


def refusal_of(command: Message, source: str, text: str, reason: Reason | None = None) -> Message:
    """Return the reply to a message that was not received, and has no report.

    Args:
        command: the message.
        source: name of the asset in messages.
        text: cause of the refusal.
        reason: numbered reason, if there is one.
    """
    outputs = _Reply(Stage.REJECTED.name, reason.name if reason else "", cut(text))
    return Message(
        command.code,
        source,
        command.source,
        command.command,
        outputs=tuple(values_of(outputs))[:3],
        moe_inputs_id=command.moe_inputs_id,
        moe_inputs_counter=command.moe_inputs_counter,
    )


def event_of(report: Report, entry: OtherEntry, source: str, ledger: str = "") -> Message:
    """Return the message for a report of any kind that is not on a command.

    Args:
        report: the report.
        entry: spelling of events.
        source: name of the asset in messages.
        ledger: as for `reply_of`.

    Raises:
        MopsError: the report is on a command.
    """
    if report.kind is ReportKind.COMMAND:
        raise MopsError(f"report {report.sequence} is on a command")
    outputs = _Event(
        report.severity.name,
        report.reason.name if report.reason else "",
        cut(report.text),
        report.sequence,
        report.utc_s,
        report.fault or "",
        ledger,
    )
    return Message(
        entry.code, source, TO_ALL, entry.command, outputs=_output_values(outputs), received=True
    )


def report_of(message: Message, dictionary: Dictionary, received_utc_s: float) -> Report:
    """Return the report that a reply or an event carries.

    Args:
        message: reply or event of the asset.
        dictionary: spelling of the messages.
        received_utc_s: time of reception, s UTC; used for a report without a time.

    Returns:
        The report, without figures. A reply with at most three outputs, as sent by a brick, is
        `UNNUMBERED`; in one without outputs the flags alone give the stage.

    Raises:
        MopsError: it is neither, or its content is invalid.
    """
    if message.inputs:
        raise MopsError(f"inputs: {message.command} is no report")
    if message.code == dictionary.spelling.event.code:
        return _event(message, dictionary.spelling.event)
    dictionary.entry(message)
    if message.moe_inputs_id is None:
        raise MopsError(f"moeinputsid: {message.command} replies to no command")
    if len(message.outputs) > _REPLY_OUTPUTS:
        raise MopsError(f"outputs: {len(message.outputs)}, at most {_REPLY_OUTPUTS}")
    filled = message.outputs + ("",) * (_REPLY_OUTPUTS - len(message.outputs))
    outputs: _Reply = from_values(_Reply, filled)
    require_within("sequence", outputs.sequence, 1, MAX_SEQUENCE)
    require_within("utc_s", outputs.utc_s, 0, MAX_UTC_S)
    require_within("step", outputs.step, 0, MAX_STEP)
    require_within("step_count", outputs.step_count, 0, MAX_STEP)
    stage = _named(Stage, outputs.stage) if outputs.stage else _by_flags(message)
    if message.executed != (stage is Stage.EXECUTED) or (message.executed and not message.received):
        raise MopsError(f"executed: {message.executed}, and the stage is {stage.name}")
    if not message.received and not stage.terminal:
        raise MopsError(f"received: False, and the stage is {stage.name}")
    return Report(
        sequence=UNNUMBERED if outputs.sequence is None else outputs.sequence,
        utc_s=received_utc_s if outputs.utc_s is None else outputs.utc_s,
        kind=ReportKind.COMMAND,
        severity=_named(Severity, outputs.severity) if outputs.severity else _severity(stage),
        text=outputs.text,
        identity=Identity(message.dest, message.moe_inputs_id),
        stage=stage,
        link=LINK,
        step=outputs.step,
        step_count=outputs.step_count,
        reason=_named(Reason, outputs.reason) if outputs.reason else None,
    )


def ledger_of(message: Message, dictionary: Dictionary) -> str:
    """Return the name of the ledger that numbers a report; empty if not given.

    Reports with equal number and ledger are the same; each ledger starts at 1.

    Raises:
        MopsError: the name is invalid.
    """
    event = message.code == dictionary.spelling.event.code
    named = message.outputs[(_EVENT_OUTPUTS if event else _REPLY_OUTPUTS) - 1 :]
    if not named:
        return ""
    if not _LEDGER.fullmatch(named[0]):
        raise MopsError(f"ledger: {named[0][:40]!r} is no name of 1 to 32 letters and digits")
    return named[0]


def _event(message: Message, entry: OtherEntry) -> Report:
    if message.command != entry.command:
        raise MopsError(f"code {message.code:03X} is {entry.command}, not {message.command}")
    if len(message.outputs) not in (_EVENT_OUTPUTS - 1, _EVENT_OUTPUTS):
        wanted = f"{_EVENT_OUTPUTS - 1} or {_EVENT_OUTPUTS}"
        raise MopsError(f"outputs: {len(message.outputs)}, not {wanted}")
    outputs: _Event = from_values(_Event, (*message.outputs, "")[:_EVENT_OUTPUTS])
    require_within("sequence", outputs.sequence, 1, MAX_SEQUENCE)
    require_within("utc_s", outputs.utc_s, 0, MAX_UTC_S)
    return Report(
        sequence=outputs.sequence,
        utc_s=outputs.utc_s,
        kind=ReportKind.EVENT,
        severity=_named(Severity, outputs.severity),
        text=outputs.text,
        reason=_named(Reason, outputs.reason) if outputs.reason else None,
        fault=outputs.fault or None,
    )


def _output_values(outputs: _Reply | _Event) -> tuple[str, ...]:
    """Return outputs as values; an empty ledger is omitted."""
    values = tuple(values_of(outputs))
    return values if outputs.ledger else values[:-1]


def cut(text: str, length: int = MAX_TEXT_LENGTH) -> str:
    """Return a text of at most some characters."""
    return text if len(text) <= length else text[: length - 1] + _CUT


def _named(kind: type[N], name: str) -> N:
    try:
        return kind[name]
    except KeyError as fault:
        raise MopsError(f"outputs: {name[:40]!r} is no {kind.__name__.lower()}") from fault


def _by_flags(message: Message) -> Stage:
    if message.executed:
        return Stage.EXECUTED
    return Stage.RECEIVED if message.received else Stage.REJECTED


def _severity(stage: Stage) -> Severity:
    quiet = not stage.terminal or stage is Stage.EXECUTED
    return Severity.INFORMATIONAL if quiet else Severity.WARNING
