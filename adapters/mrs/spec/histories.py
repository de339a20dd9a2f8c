"""Converts a `RunHistory`, and the arguments of one command, to the wire and back."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

from adapters.mal import AttributeType, NamedValue, TypedAttribute
from adapters.mrs.spec import types
from adapters.mrs.spec.core_values import REASONS, identity_of, report_of, utc_s_of
from adapters.mrs.spec.mapping import MAX_TEXT_LENGTH, notification_of, to_ns
from executive.commands import Mode, PreemptionPolicy, Request, argument_values
from executive.history import (
    LeafRun,
    PeakSpeed,
    ReceivedCommand,
    RejectedSubmission,
    RunHistory,
    Situation,
)
from executive.values.reasons import Figure, Refusal
from executive.values.reports import Identity, Report


def wire_history(history: RunHistory) -> types.History:
    """Return a history for the wire."""
    return types.History(
        until=to_ns(history.until_utc_s),
        reports=tuple(map(_wire_report, history.reports)),
        commands=tuple(map(_wire_received_command, history.received)),
        declined=tuple(
            types.DeclinedCommand(
                source=each.identity.source,
                commandId=each.identity.command_id,
                timestamp=to_ns(each.utc_s),
                code=each.refusal.reason.value,
                text=each.refusal.text[:MAX_TEXT_LENGTH],
                figures=_wire_figures(each.refusal.figures),
            )
            for each in history.declined
        ),
        states=tuple(
            types.ExecutiveState(
                timestamp=to_ns(each.utc_s),
                mode=types.AssetMode(each.mode.value),
                activeSource=each.active.source if each.active else None,
                activeCommandId=each.active.command_id if each.active else None,
                why=each.why[:MAX_TEXT_LENGTH],
                fault=each.fault,
                causeSource=each.cause.source if each.cause else None,
                causeCommandId=each.cause.command_id if each.cause else None,
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
    """Return a received history; reasons that are unknown here become None.

    A declined command with an unknown reason is left out, since it needs one.
    """
    return RunHistory(
        until_utc_s=utc_s_of(history.until),
        reports=tuple(map(_report_of, history.reports)),
        received=tuple(map(_received_of, history.commands)),
        declined=tuple(
            RejectedSubmission(
                Identity(each.source, each.commandId),
                utc_s_of(each.timestamp),
                Refusal(REASONS[each.code], each.text, _figures_of(each.figures)),
            )
            for each in history.declined
            if each.code in REASONS
        ),
        situations=tuple(
            Situation(
                utc_s_of(each.timestamp),
                Mode(each.mode.value),
                identity_of(each.activeSource, each.activeCommandId),
                each.why,
                each.fault,
                identity_of(each.causeSource, each.causeCommandId),
            )
            for each in history.states
            if each.mode is not types.AssetMode.OFFLINE
        ),
        leaves=tuple(
            LeafRun(
                each.path,
                utc_s_of(each.began),
                None if each.ended is None else utc_s_of(each.ended),
                each.message or "",
            )
            for each in history.leaves
        ),
        fastest=tuple(
            PeakSpeed(Identity(each.source, each.commandId), each.speed, each.allowed)
            for each in history.fastest
        ),
        slowing=frozenset(REASONS[each] for each in history.slowing if each in REASONS),
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
        identity=identity_of(past.source, past.commandId),
        link=past.link,
        figures=_figures_of(past.figures),
    )


def _wire_received_command(received: ReceivedCommand) -> types.ReceivedCommand:
    created_s = received.created_utc_s
    return types.ReceivedCommand(
        source=received.identity.source,
        commandId=received.identity.command_id,
        text=received.text,
        name=received.name,
        link=received.link,
        timestamp=to_ns(received.utc_s),
        replaces=received.preemption is PreemptionPolicy.REPLACE,
        creationTime=None if created_s is None else to_ns(created_s),
        lifetime=received.lifetime_s,
    )


def _received_of(received: types.ReceivedCommand) -> ReceivedCommand:
    created_ns = received.creationTime
    return ReceivedCommand(
        Identity(received.source, received.commandId),
        received.text,
        received.name,
        received.link,
        utc_s_of(received.timestamp),
        PreemptionPolicy.REPLACE if received.replaces else PreemptionPolicy.APPEND,
        None if created_ns is None else utc_s_of(created_ns),
        received.lifetime,
    )


def _wire_figures(figures: Sequence[Figure]) -> tuple[types.FigureWithUnit, ...]:
    return tuple(
        types.FigureWithUnit(name=each.name, value=float(each.value), unit=each.unit or None)
        for each in figures
    )


def _figures_of(figures: Sequence[types.FigureWithUnit]) -> tuple[Figure, ...]:
    return tuple(Figure(each.name, each.value, each.unit or "") for each in figures)


_TYPES: Final = {
    float: AttributeType.DOUBLE,
    int: AttributeType.LONG,
    str: AttributeType.STRING,
}
_ITEM: Final = re.compile(r"(\w+)\[\d+\]\.(\w+)")


def wire_arguments(request: Request) -> tuple[NamedValue, ...]:
    """Return the arguments of a request for the wire; those of an item as `waypoints[0].x`."""
    flat: dict[str, Any] = {}
    for name, value in argument_values(request).items():
        if isinstance(value, list):
            for index, item in enumerate(value):
                flat |= {f"{name}[{index}].{part}": each for part, each in item.items()}
        elif type(value) in _TYPES:
            flat[name] = value
    return tuple(
        NamedValue(name=name, value=TypedAttribute(_TYPES[type(value)], value))
        for name, value in flat.items()
    )


def arguments_from(received: Sequence[NamedValue]) -> dict[str, Any]:
    """Return received arguments by name, as `argument_values` does."""
    found: dict[str, Any] = {}
    for each in received:
        value = None if each.value is None else each.value.value
        item = _ITEM.fullmatch(each.name)
        if item is None:
            found[each.name] = value
            continue
        items = found.setdefault(item[1], [{}])
        if item[2] in items[-1]:
            items.append({})
        items[-1][item[2]] = value
    return found
