"""RunHistorys on the wire, and back: what explains a command, or what a rover does now."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from adapters.mrs.spec import types
from adapters.mrs.spec.mapping import LONGEST_TEXT, NS_PER_S, notification_of, to_ns
from executive.commands import Arrival, Mode
from executive.history import Declined, Fastest, LeafRun, ReceivedCommand, RunHistory, Situation
from executive.reasons import Figure, Reason, Refusal
from executive.reports import Identity, Kind, Report, Severity, Stage

_REASONS: Final = {each.value: each for each in Reason}


def wire_history(history: RunHistory) -> types.History:
    """Return a history to send."""
    return types.History(
        until=to_ns(history.until_utc_s),
        reports=tuple(map(_wire_report, history.reports)),
        asked=tuple(map(_wire_asked, history.received)),
        declined=tuple(
            types.DeclinedCommand(
                source=each.identity.source,
                commandId=each.identity.command_id,
                timestamp=to_ns(each.utc_s),
                code=each.refusal.reason.value,
                text=each.refusal.text[:LONGEST_TEXT],
                figures=_wire_figures(each.refusal.figures),
            )
            for each in history.declined
        ),
        situations=tuple(
            types.Situation(
                timestamp=to_ns(each.utc_s),
                mode=types.AssetMode(each.mode.value),
                activeSource=each.active.source if each.active else None,
                activeCommandId=each.active.command_id if each.active else None,
                why=each.why[:LONGEST_TEXT],
            )
            for each in history.situations
        ),
        leaves=tuple(
            types.LeafRun(
                path=each.path,
                began=to_ns(each.began_utc_s),
                ended=None if each.ended_utc_s is None else to_ns(each.ended_utc_s),
                message=each.message or None,
            )
            for each in history.leaves
        ),
        fastest=tuple(
            types.FastestTravel(
                source=each.identity.source,
                commandId=each.identity.command_id,
                speed=each.travel_mps,
                allowed=each.allowed_mps,
            )
            for each in history.fastest
        ),
        slowing=tuple(sorted(each.value for each in history.slowing)),
    )


def history_of(history: types.History) -> RunHistory:
    """Return the history that came; a reason that is not known here is none.

    What has one always, a command that was declined, is left out then.
    """
    return RunHistory(
        until_utc_s=_seconds(history.until),
        reports=tuple(map(_report_of, history.reports)),
        received=tuple(map(_received_of, history.asked)),
        declined=tuple(
            Declined(
                Identity(each.source, each.commandId),
                _seconds(each.timestamp),
                Refusal(_REASONS[each.code], each.text, _figures_of(each.figures)),
            )
            for each in history.declined
            if each.code in _REASONS
        ),
        situations=tuple(
            Situation(
                _seconds(each.timestamp),
                Mode(each.mode.value),
                _identity(each.activeSource, each.activeCommandId),
                each.why,
            )
            for each in history.situations
            if each.mode is not types.AssetMode.OFFLINE
        ),
        leaves=tuple(
            LeafRun(
                each.path,
                _seconds(each.began),
                None if each.ended is None else _seconds(each.ended),
                each.message or "",
            )
            for each in history.leaves
        ),
        fastest=tuple(
            Fastest(Identity(each.source, each.commandId), each.speed, each.allowed)
            for each in history.fastest
        ),
        slowing=frozenset(_REASONS[each] for each in history.slowing if each in _REASONS),
    )


def report_of(notification: types.Notification) -> Report:
    """Return a notification as a report, whose figures have no units and whose link is unknown."""
    stage = notification.stage
    return Report(
        sequence=notification.sequence,
        utc_s=_seconds(notification.timestamp),
        kind=Kind(notification.kind.value),
        severity=Severity(notification.severity.value),
        text=notification.text or "",
        identity=_identity(notification.source, notification.commandId),
        stage=None if stage is None else Stage(stage.value),
        step=notification.step,
        step_count=notification.stepCount,
        reason=_REASONS.get(notification.code or 0),
        figures=tuple(
            Figure(each.name, each.value.value)
            for each in notification.parameters or ()
            if each.value is not None and isinstance(each.value.value, float)
        ),
    )


def _wire_report(report: Report) -> types.PastReport:
    identity = report.identity
    return types.PastReport(
        notification=replace(notification_of(report), parameters=None),
        source=None if identity is None else identity.source,
        commandId=None if identity is None else identity.command_id,
        link=report.link,
        figures=_wire_figures(report.figures),
    )


def _report_of(past: types.PastReport) -> Report:
    return replace(
        report_of(past.notification),
        identity=_identity(past.source, past.commandId),
        link=past.link,
        figures=_figures_of(past.figures),
    )


def _wire_asked(received: ReceivedCommand) -> types.AskedCommand:
    created_s = received.created_utc_s
    return types.AskedCommand(
        source=received.identity.source,
        commandId=received.identity.command_id,
        text=received.text,
        name=received.name,
        link=received.link,
        timestamp=to_ns(received.utc_s),
        replaces=received.arrival is Arrival.REPLACE,
        creationTime=None if created_s is None else to_ns(created_s),
        lifetime=received.lifetime_s,
    )


def _received_of(asked: types.AskedCommand) -> ReceivedCommand:
    created_ns = asked.creationTime
    return ReceivedCommand(
        Identity(asked.source, asked.commandId),
        asked.text,
        asked.name,
        asked.link,
        _seconds(asked.timestamp),
        Arrival.REPLACE if asked.replaces else Arrival.APPEND,
        None if created_ns is None else _seconds(created_ns),
        asked.lifetime,
    )


def _wire_figures(figures: Sequence[Figure]) -> tuple[types.FigureWithUnit, ...]:
    return tuple(
        types.FigureWithUnit(name=each.name, value=float(each.value), unit=each.unit or None)
        for each in figures
    )


def _figures_of(figures: Sequence[types.FigureWithUnit]) -> tuple[Figure, ...]:
    return tuple(Figure(each.name, each.value, each.unit or "") for each in figures)


def _identity(source: str | None, number: int | None) -> Identity | None:
    return None if source is None or number is None else Identity(source, number)


def _seconds(time_ns: int) -> float:
    return time_ns / NS_PER_S
