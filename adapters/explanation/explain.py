"""`explain_command`, `explain_now`: causal chain of a command, or of the state at a history's end.

Pure functions of a `RunHistory`, so that a recording and a rover on the MRS have the same
explanations. Facts missing in the history are left out.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

from adapters.explanation.explanation import Explanation, ExplanationStep, UnknownCommandError
from adapters.explanation.log import matches_command, situation_at
from adapters.explanation.plan_steps import (
    branch_steps,
    explain_recorded_node,
    present_decisions,
)
from executive.commands import Family, Mode, all_declarations
from executive.commands.intake import SOURCE_PREFIX
from executive.faults import DECLARED
from executive.history import DISK_WAIT, CommandHistory, LeafRun, RunHistory, Situation
from executive.state import RECOVERY, Uncertainty
from executive.values.reasons import PREDICTED, Figure, Reason, UnknownReason
from executive.values.reports import Identity, Report, ReportKind, Stage

MIN_WAIT_S: Final = 0.1
"""Minimum wait that is mentioned."""
_FAMILIES: Final = {each.name: each.family for each in all_declarations()}
_BRANCHES: Final = {
    Family.MOTION: "/motion/",
    Family.CAMERA: "/camera/",
    Family.INSTANT: "/instant commands/",
    Family.STOP: "/priority stop/",
}
"""Branch of the tree that executes the commands of a family."""
_HOLDING: Final = {Mode.PAUSED, Mode.STOPPED, Mode.SAFE}
_OF_MODE: Final = {Reason.WRONG_MODE, Reason.PRECONDITION_MODE}
_NO_BEGIN: Final = {Reason.FAULT_CLEARED, Reason.POSE_UNCERTAIN}
"""Reasons of events that name a fault and are not its begin."""
_UNCERTAINTY: Final = {each.name for each in Uncertainty().figures}
_RECOVERY: Final = f"until then motions to positions and headings are refused: {RECOVERY}"
_ENDED: Final = {
    Stage.EXECUTED: "was executed",
    Stage.FAILED: "failed",
    Stage.CANCELLED: "was cancelled",
    Stage.EXPIRED: "expired",
    Stage.REJECTED: "was refused",
}


def explain_command(history: RunHistory, command: str) -> Explanation:
    """Return the result of a command and its causes.

    Args:
        history: history that covers the command.
        command: its number, or `SOURCE:NUMBER`; or the path of a plan's node, or the end of it.

    Raises:
        UnknownCommandError: no command or several match.
    """
    histories = history.command_histories()
    found = [each for identity, each in histories.items() if matches_command(command, identity)]
    declined = [each for each in history.declined if matches_command(command, each.identity)]
    if len(found) > 1:
        which = ", ".join(str(each.identity) for each in found)
        raise UnknownCommandError(f"{command} is the number of several: name one of {which}")
    if found:
        explained = _CommandExplainer(history, histories, found[0]).explain()
        others = tuple(
            ExplanationStep(
                each.utc_s, f"another command under this number was refused: {each.refusal.text}"
            )
            for each in declined
        )
        return replace(explained, steps=(*explained.steps, *others))
    if declined:
        last = declined[-1]
        reason = last.refusal.reason
        return Explanation(
            f"{last.identity} was not accepted: {last.refusal.text}",
            reason,
            (ExplanationStep(last.utc_s, f"refused at reception: {reason.name} {reason.value}"),),
            last.refusal.figures,
        )
    since_utc_s = history.reports[-1].utc_s if history.reports else 0.0
    for each in history.received:
        if matches_command(command, each.identity) and each.utc_s >= since_utc_s:
            return Explanation(f"{each.identity} {each.text} waits for the disk", None, ())
    node = explain_recorded_node(history, command)
    if node is not None:
        return node
    known = [str(identity) for identity in histories][-5:]
    which = f"the latest known: {', '.join(known)}" if known else "none is known"
    raise UnknownCommandError(f"no command {command}; {which}")


def explain_now(history: RunHistory) -> Explanation:
    """Return why the rover is stationary, or what moves it, at the end of a history."""
    histories = history.command_histories()
    now = history.situations[-1] if history.situations else None
    if now is None:
        return Explanation("the state of the rover is unknown", None, ())
    headline = _situation_text(now)
    if now.active is not None and now.active in histories and now.mode not in _HOLDING:
        explanation = _CommandExplainer(history, histories, histories[now.active]).explain()
        return Explanation(
            headline, explanation.reason, (*explanation.steps, *_conditions(history)), ()
        )
    cause = cause_of(history, now)
    steps: list[ExplanationStep] = []
    reason: Reason | UnknownReason | None = None
    evidence: tuple[Figure, ...] = ()
    if isinstance(cause, CommandHistory):
        reason = Reason.STOPPED
        steps += _received_text(cause)
    elif cause is not None:
        reason, evidence = cause.reason, cause.figures
        steps.append(_event_step(cause))
        steps += [
            ExplanationStep(end.utc_s, _ending(each))
            for each in histories.values()
            if (end := each.end) is not None
            if end.reason is cause.reason and end.utc_s >= cause.utc_s
        ]
    elif (last := last_ended(histories.values())) is not None and last.end is not None:
        reason = last.end.reason
        steps.append(ExplanationStep(last.end.utc_s, f"the last command to end: {_ending(last)}"))
    steps += present_decisions(history)
    steps += [each for each in _conditions(history) if each not in steps]
    return Explanation(headline, reason, tuple(steps), evidence)


class _CommandExplainer:
    """Explains one command."""

    def __init__(
        self,
        history: RunHistory,
        histories: dict[Identity, CommandHistory],
        command: CommandHistory,
    ) -> None:
        self._history = history
        self._histories = histories
        self._command = command
        self._family = _FAMILIES.get(command.request)
        self._end_s = end_s(command, history)

    def explain(self) -> Explanation:
        entry, end = self._command, self._command.end
        steps = [
            *branch_steps(self._history, entry),
            *_received_text(entry),
            *self._waiting_steps(),
            *self._ran(),
            *self._events_during(),
            *self._speed_limits(),
        ]
        steps.sort(key=lambda each: self._end_s if each.utc_s is None else each.utc_s)
        if end is None:
            headline, reason = self._in_progress()
            return Explanation(headline, reason, tuple(steps))
        if end.stage is not Stage.REJECTED:
            steps.append(ExplanationStep(end.utc_s, _ending(entry)))
        steps += self._causes(end)
        return Explanation(
            _headline(entry, end), end.reason or _of_stage(end), tuple(steps), _shown(end.figures)
        )

    def _in_progress(self) -> tuple[str, Reason | UnknownReason | None]:
        entry = self._command
        title = f"{entry.identity} {entry.name}"
        if entry.report_at(Stage.ACCEPTED) is None:
            return f"{title} was received, and is not decided on yet", None
        if self._started_s is None:
            waits = [each.text for each in self._waiting_steps()]
            return f"{title} {waits[-1] if waits else 'waits for its turn'}", self._held()
        running = [each for each in self._leaves if each.ended_utc_s is None]
        doing = f" in leaf {running[-1].name}{_leaf_message(running[-1])}" if running else ""
        return f"{title} is under way{doing}", None

    def _held(self) -> Reason | UnknownReason | None:
        situations = self._history.situations
        if not situations or situations[-1].mode not in _HOLDING:
            return None
        cause = cause_of(self._history, situations[-1])
        return cause.reason if isinstance(cause, Report) else None

    @property
    def _started_s(self) -> float | None:
        """Start time by its report or, without one, by the active command."""
        started = self._command.report_at(Stage.STARTED)
        if started is not None:
            return started.utc_s
        for each in self._history.situations:
            if each.active == self._command.identity:
                return each.utc_s
        later, end = self._command.report_at(Stage.PROGRESS), self._command.end
        if later is None and end is not None and end.stage in {Stage.EXECUTED, Stage.FAILED}:
            later = self._command.report_at(Stage.ACCEPTED)
        return None if later is None else later.utc_s

    def _waiting_steps(self) -> Iterator[ExplanationStep]:
        accepted = self._command.report_at(Stage.ACCEPTED)
        if accepted is None:
            return
        disk_s = self._command.disk_wait_s(Stage.ACCEPTED)
        began_s = accepted.utc_s + disk_s
        if disk_s:
            yield ExplanationStep(began_s, f"waited {disk_s:.2f} s for the disk")
        until_s = self._started_s if self._started_s is not None else self._end_s
        if until_s - began_s < MIN_WAIT_S:
            return
        blockers = [
            f"{each.identity} {each.name}"
            for each in self._histories.values()
            if each is not self._command and self._in_front(each, began_s)
        ]
        held = [
            each
            for each, next_s in spans(self._history)
            if each.utc_s < until_s and next_s > began_s
            if each.mode in _HOLDING or (each.mode is Mode.MOVING and each.active is None)
        ]
        verb = "waited" if self._started_s is not None or self._command.end else "waits"
        for_what = [f"for {', '.join(blockers)}"] if blockers else []
        whys = dict.fromkeys(f"as the rover was {_situation_text(each)}" for each in held)
        why = "; ".join([*for_what, *list(whys)[-1:]]) or "for its turn"
        yield ExplanationStep(until_s, f"{verb} {until_s - began_s:.2f} s {why}")

    def _in_front(self, other: CommandHistory, began_s: float) -> bool:
        """Return whether another command of the same queue was earlier and active in the wait."""
        if _FAMILIES.get(other.request) is not self._family:
            return False
        accepted, mine = other.report_at(Stage.ACCEPTED), self._command.report_at(Stage.ACCEPTED)
        if accepted is None or mine is None or accepted.sequence > mine.sequence:
            return False
        return end_s(other, self._history) > began_s

    @property
    def _leaves(self) -> list[LeafRun]:
        branch = None if self._family is None else _BRANCHES.get(self._family)
        began_s = self._started_s
        if branch is None or began_s is None:
            return []
        return [
            each
            for each in self._history.leaves
            if branch in f"/{each.path}/"
            and not each.path.startswith(SOURCE_PREFIX)
            and each.began_utc_s <= self._end_s
            and (each.ended_utc_s is None or each.ended_utc_s > began_s)
        ]

    def _ran(self) -> Iterator[ExplanationStep]:
        began_s = self._started_s
        started = self._command.report_at(Stage.STARTED)
        if started is not None:
            yield ExplanationStep(started.utc_s, "started")
        for each in self._leaves:
            ended_s = self._end_s if each.ended_utc_s is None else each.ended_utc_s
            took_s = min(ended_s, self._end_s) - each.began_utc_s
            at_s = max(each.began_utc_s, began_s or each.began_utc_s)
            yield ExplanationStep(
                at_s, f"leaf {each.name} ran for {took_s:.2f} s{_leaf_message(each)}"
            )
        for report in self._command.reports:
            if report.stage is Stage.PROGRESS:
                yield ExplanationStep(
                    report.utc_s, f"step {report.step} of {report.step_count}: {report.text}"
                )

    def _events_during(self) -> Iterator[ExplanationStep]:
        """Yield the events during the command, except those that the end repeats."""
        end = self._command.end
        repeated = None if end is None else _begin(self._history, end.fault, end.utc_s)
        for report in self._history.reports:
            if (
                report.kind is not ReportKind.COMMAND
                and (report.identity is None or report.kind is ReportKind.LINK)
                and self._command.utc_s <= report.utc_s <= self._end_s
                and report is not repeated
            ):
                yield _event_step(report)

    def _speed_limits(self) -> Iterator[ExplanationStep]:
        fastest = next(
            (each for each in self._history.fastest if each.identity == self._command.identity),
            None,
        )
        began_s = self._started_s
        if self._family is not Family.MOTION or began_s is None:
            return
        causes = [
            f"slowed down: {each.text}"
            for each in _active_faults(self._history, self._end_s, began_s)
            if each.reason in self._history.slowing
        ]
        setting = last_speed_setting(self._histories.values(), self._end_s)
        if setting is not None:
            causes.append(f"{setting.name} of {setting.identity}")
        if fastest is not None and fastest.travel_mps > 0.0:
            text = (
                f"maximum speed {fastest.travel_mps:.2f} m/s, of {fastest.allowed_mps:.2f} m/s"
                " that the asset allows"
            )
            yield ExplanationStep(None, f"{text}: {'; '.join(causes)}" if causes else text)
        elif causes:
            yield ExplanationStep(None, f"its speed was limited: {'; '.join(causes)}")

    def _causes(self, end: Report) -> Iterator[ExplanationStep]:
        """Yield the cause of the end: the command that it names, or the mode of the rover."""
        if end.cause is not None and end.cause in self._histories:
            cause = self._histories[end.cause]
            yield from _received_text(cause)
            failed = cause.end if cause.report_at(Stage.ACCEPTED) is not None else None
            if end.reason is Reason.PRECONDITION_COMMAND and failed is not None:
                yield ExplanationStep(failed.utc_s, _ending(cause))
        then = situation_at(self._history, end.utc_s)
        if end.reason in _OF_MODE and then is not None:
            yield ExplanationStep(then.utc_s, f"the rover was {_situation_text(then)}")
        if end.reason is Reason.POSE_UNCERTAIN:
            yield from _uncertain_since(self._history, end.utc_s)


def last_speed_setting(
    histories: Iterable[CommandHistory], until_utc_s: float
) -> CommandHistory | None:
    """Return the command that set the speed limit in force at a time; None without one."""
    settings = [
        each
        for each in histories
        if (end := each.end) is not None and end.stage is Stage.EXECUTED
        if end.utc_s <= until_utc_s and each.request == "setTravelSpeed"
    ]
    return settings[-1] if settings else None


def last_ended(histories: Iterable[CommandHistory]) -> CommandHistory | None:
    """Return the command that ended last; None if none did."""
    ended = ((each.end.sequence, each) for each in histories if each.end is not None)
    _, last = max(ended, key=lambda each: each[0], default=(0, None))
    return last


def end_s(entry: CommandHistory, history: RunHistory) -> float:
    """Return the time of a command's end, or of the history's if it has not ended."""
    return history.until_utc_s if entry.end is None else entry.end.utc_s


def _of_stage(end: Report) -> Reason | UnknownReason | None:
    return Reason.EXPIRED if end.stage is Stage.EXPIRED else None


def _headline(entry: CommandHistory, end: Report) -> str:
    text = f": {entry.outcome}" if entry.outcome else ""
    assert end.stage is not None
    return f"{entry.identity} {entry.name} {_ENDED[end.stage]}{text}"


def _ending(entry: CommandHistory) -> str:
    end = entry.end
    assert end is not None
    assert end.stage is not None
    took_s = end.utc_s - entry.utc_s
    text = f": {entry.outcome}" if entry.outcome else ""
    why = in_brackets(end.reason or _of_stage(end))
    return f"{entry.identity} {_ENDED[end.stage]} after {took_s:.2f} s{text}{why}"


def _received_text(entry: CommandHistory) -> Iterator[ExplanationStep]:
    received, first, link = entry.received, entry.reports[0], entry.link
    over = "" if link is None else f" over the {link} link"
    wait = (
        ""
        if received is None or received.lifetime_s is None
        else f", to start within {received.lifetime_s:g} s"
    )
    yield ExplanationStep(
        first.utc_s if received is None else received.utc_s,
        f"{entry.identity.source} requested {entry.name}{over}, as number"
        f" {entry.identity.command_id}{wait}",
    )
    accepted, end = entry.report_at(Stage.ACCEPTED), entry.end
    if accepted is not None:
        yield ExplanationStep(accepted.utc_s, f"{entry.identity} was accepted")
    elif end is not None and end.stage is Stage.REJECTED:
        why = in_brackets(end.reason)
        yield ExplanationStep(end.utc_s, f"{entry.identity} was refused: {end.text}{why}")
        if disk_s := entry.disk_wait_s(Stage.REJECTED):
            yield ExplanationStep(end.utc_s + disk_s, f"waited {disk_s:.2f} s for the disk")


def in_brackets(reason: Reason | UnknownReason | None) -> str:
    """Return name and number of a reason in brackets after a text; empty for None."""
    return "" if reason is None else f" ({reason.name} {reason.value})"


def _event_step(report: Report) -> ExplanationStep:
    text = f"{report.severity.name.lower()}: {report.text}{in_brackets(report.reason)}"
    return ExplanationStep(report.utc_s, text)


def _leaf_message(run: LeafRun) -> str:
    return f": {run.message}" if run.message else ""


def _shown(figures: tuple[Figure, ...]) -> tuple[Figure, ...]:
    """Return figures except predictions, the figures measured for them, and the disk's delay."""
    predicted = {each.name for each in figures if each.name.startswith(PREDICTED)}
    hidden = {DISK_WAIT, *predicted, *(each.removeprefix(PREDICTED) for each in predicted)}
    return tuple(each for each in figures if each.name not in hidden)


def spans(history: RunHistory) -> Iterator[tuple[Situation, float]]:
    """Yield each situation with the start of the next one, or the end of the history."""
    following = (*(each.utc_s for each in history.situations[1:]), history.until_utc_s)
    yield from zip(history.situations, following, strict=False)


def cause_of(history: RunHistory, now: Situation) -> Report | CommandHistory | None:
    """Return the cause of a situation that holds the rover; None without one."""
    if now.cause is not None:
        return history.command_histories().get(now.cause)
    return _begin(history, now.fault, history.until_utc_s)


def _begin(history: RunHistory, fault: str | None, until_utc_s: float) -> Report | None:
    """Return the last report that a fault began; None without one."""
    begins = (
        each
        for each in reversed(history.reports)
        if fault is not None and each.fault == fault and each.kind is ReportKind.EVENT
        if each.reason not in _NO_BEGIN and each.utc_s <= until_utc_s
    )
    return next(begins, None)


def _situation_text(situation: Situation) -> str:
    """Return mode and text of a situation; the text of a holding fault names the mode."""
    named = situation.fault is not None and situation.mode in _HOLDING
    return situation.why if named else f"{situation.mode.name}: {situation.why}"


def _active_faults(
    history: RunHistory, at_utc_s: float, since_utc_s: float | None = None
) -> list[Report]:
    """Return the events of the faults active at a time, or at any time since another one."""
    active: dict[str, Report] = {}
    for report in history.reports:
        if report.utc_s > at_utc_s or report.kind is not ReportKind.EVENT or report.reason is None:
            continue
        if report.fault not in DECLARED:
            continue
        if report.reason not in _NO_BEGIN:
            active[report.fault] = report
        elif report.reason is Reason.FAULT_CLEARED and (
            since_utc_s is None or report.utc_s <= since_utc_s
        ):
            active.pop(report.fault, None)
    return list(active.values())


def _uncertain_since(history: RunHistory, at_utc_s: float) -> list[ExplanationStep]:
    """Return the events that made the pose uncertain, and the remedy; empty if it is not.

    These are the first such event and the last one, each with the fault that it names.
    """
    begun: list[list[Report]] = []
    faults: list[Report] = []
    for report in history.reports:
        if report.kind is not ReportKind.EVENT or report.utc_s > at_utc_s:
            continue
        if report.reason is Reason.POSE_UNCERTAIN:
            named = [each for each in faults if each.fault == report.fault]
            begun = [*begun[:1], [*named[-1:], report]]
        elif report.reason is Reason.FAULT_CLEARED and _is_of_pose(report):
            begun, faults = [], []
        elif report.fault in DECLARED and report.reason is not Reason.FAULT_CLEARED:
            faults.append(report)
    steps = dict.fromkeys(_event_step(report) for reports in begun for report in reports)
    return [*steps, ExplanationStep(None, _RECOVERY)] if steps else []


def _is_of_pose(report: Report) -> bool:
    return {each.name for each in report.figures} >= _UNCERTAINTY


def _conditions(history: RunHistory) -> list[ExplanationStep]:
    """Return the active faults and other velocity publishers."""
    steps = [_event_step(each) for each in _active_faults(history, history.until_utc_s)]
    steps += _uncertain_since(history, history.until_utc_s)
    foreign = [each for each in history.reports if each.publishers is not None]
    if foreign and foreign[-1].publishers:
        steps.append(_event_step(foreign[-1]))
    return steps
