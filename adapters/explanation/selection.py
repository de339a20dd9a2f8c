"""`select_for`: the part of a history that an explanation needs; a rover sends only that."""

from dataclasses import replace
from typing import Final

from adapters.explanation.explain import (
    cause_of,
    end_s,
    last_ended,
    last_speed_setting,
    spans,
)
from adapters.explanation.log import matches_command
from executive.history import CommandHistory, RunHistory
from executive.values.reports import Report, ReportKind

MAX_SUGGESTED: Final = 5
"""Number of commands that are listed if the requested one is unknown."""


def select_for(history: RunHistory, command: str | None = None) -> RunHistory:
    """Return the part of a history that gives the same explanation of a command or of its end."""
    histories = list(history.command_histories().values())
    meant = [
        each
        for each in histories
        if command is not None and matches_command(command, each.identity)
    ]
    if command is None:
        began_s, ended_s = _since_of_now(history, histories), history.until_utc_s
    elif meant:
        began_s = min(each.utc_s for each in meant)
        ended_s = max(end_s(each, history) for each in meant)
    else:
        began_s = ended_s = history.until_utc_s
        meant = histories[-MAX_SUGGESTED:]
    situations = [
        each for each, next_s in spans(history) if each.utc_s <= ended_s and next_s >= began_s
    ]
    causes = {each.end.cause for each in meant if each.end} | {each.cause for each in situations}
    retained = {
        each.identity
        for each in histories
        if each in meant
        or (each.utc_s <= ended_s and end_s(each, history) >= began_s)
        or each.identity in causes
    }
    setting = last_speed_setting(histories, ended_s)
    if setting is not None:
        retained.add(setting.identity)
    return replace(
        history,
        reports=tuple(
            each
            for each in history.reports
            if each.identity in retained
            or (
                each.kind is not ReportKind.COMMAND
                and each.utc_s <= ended_s
                and (each.utc_s >= began_s or _lasts(each))
            )
        ),
        received=tuple(each for each in history.received if each.identity in retained),
        declined=tuple(
            each
            for each in history.declined
            if command is not None and matches_command(command, each.identity)
        ),
        situations=tuple(situations),
        leaves=tuple(
            each
            for each in history.leaves
            if each.began_utc_s <= ended_s
            and (each.ended_utc_s is None or each.ended_utc_s >= began_s)
        ),
        fastest=tuple(each for each in history.fastest if each.identity in retained),
    )


def _since_of_now(history: RunHistory, histories: list[CommandHistory]) -> float:
    """Return the start of the events that explain the rover's state at the end."""
    now = history.situations[-1] if history.situations else None
    if now is None:
        return history.until_utc_s
    since = [now.utc_s, *(each.utc_s for each in histories if each.identity == now.active)]
    cause = cause_of(history, now)
    if cause is not None:
        since.append(cause.utc_s)
    last = last_ended(histories)
    if last is not None:
        since.append(last.utc_s)
    return min(since)


def _lasts(report: Report) -> bool:
    """Return whether an event has a lasting effect: a fault starts or ends, a publisher appears."""
    return report.reason is not None or report.publishers is not None
