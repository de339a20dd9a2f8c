"""`differing` finds the first different decision of two runs, and describes it.

Texts, and figures in reports and telemetry, are no decisions: with the same inputs the state is
still the same. Nor are digits of a velocity behind the sixth. Of an entry's decisions the one that
is closest to the cause counts: the end of a command before the velocity zero that follows from it.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from adapters.recording.messages import decode, topic_of
from adapters.recording.run_file import RecordedMessage
from executive.core.recording import (
    Decision,
    ModeChanged,
    PlanUpdateSent,
    ReportSent,
    SolverRequested,
    SubmitAnswered,
    TelemetrySent,
    TreeChanged,
    VelocityCommanded,
)
from executive.values.geometry import STANDING, Velocity
from executive.values.reports import Identity, Report, ReportKind, Severity, without_figures

NOTHING: Final = "nothing"
DIGITS: Final = 6
"""Decimal digits of a velocity that count, in m/s and rad/s."""
_SHOWN_DIGITS: Final = (2, 4, DIGITS)


@dataclass(frozen=True, slots=True)
class FirstDecision:
    """A different decision of two runs.

    Attributes:
        topic: topic of the recording, such as `/out/velocity_commanded`; empty for an exception.
        recorded, replayed: both decisions as text with figures; `nothing` for none.
        group: both without figures, the replayed one first: equal for equal changes.
        identity: the command that it is about; None for none.
        change: relative change of the velocity; None for other decisions.
    """

    topic: str
    recorded: str
    replayed: str
    group: tuple[str, str]
    identity: Identity | None = None
    change: float | None = None


@dataclass(frozen=True, slots=True)
class _Act:
    """A decision; equal ones differ at most in figures. A lower rank is closer to the cause."""

    rank: int
    text: str
    identity: Identity | None = None
    velocity: Velocity | None = None
    item: Decision | None = field(default=None, compare=False)

    def shown(self, digits: int) -> str:
        """Return it as text with figures."""
        match self.item:
            case VelocityCommanded(velocity=velocity):
                travel, rotate = velocity.travel_mps, velocity.rotate_radps
                return f"velocity {travel:.{digits}f} m/s, {rotate:.{digits}f} rad/s"
            case ReportSent(report=report):
                about = "" if report.identity is None else f"{report.identity} "
                stage = report.severity.name if report.stage is None else report.stage.name
                reason = "" if report.reason is None else f" {report.reason.name}"
                return f"{about}{stage}{reason}: {report.text}"
            case ModeChanged(mode=mode, why=why):
                return f"mode {mode.name}: {why}"
            case _:
                return self.text


def _decoded(message: RecordedMessage) -> Decision:
    item: Decision = decode(message.topic, message.data)
    return item


def differing(
    recorded: Sequence[RecordedMessage],
    replayed: Sequence[RecordedMessage],
    decoded: Callable[[RecordedMessage], Decision] = _decoded,
    raised: str = "",
) -> FirstDecision | None:
    """Return the different decision of two entries; None if they decide the same.

    Args:
        recorded: decisions of the one.
        replayed: decisions of the other.
        decoded: returns the item in a message.
        raised: exception of the replayed core as text; empty for none.
    """
    if recorded == replayed and not raised:
        return None
    before, after = (Counter(_acts(each, decoded)) for each in (recorded, replayed))
    then, now = (min(each, key=_rank, default=None) for each in (before - after, after - before))
    if raised:
        then, now = None, _Act(-1, raised)
    if then and now and (then.rank, then.identity) != (now.rank, now.identity):
        then, now = (then, None) if then.rank < now.rank else (None, now)
    act = now or then
    if act is None:
        return None
    group, change = (now.text if now else NOTHING, then.text if then else NOTHING), None
    if act.velocity is not None:
        text, change = _velocity_change(then, now)
        group = text, ""
    shown = [[NOTHING if e is None else e.shown(n) for e in (then, now)] for n in _SHOWN_DIGITS]
    texts = next((each for each in shown if each[0] != each[1]), shown[-1])
    topic = "" if act.item is None else topic_of(act.item).name
    return FirstDecision(topic, texts[0], texts[1], group, act.identity, change)


def _rank(act: _Act) -> int:
    return act.rank


def _acts(
    messages: Sequence[RecordedMessage], decoded: Callable[[RecordedMessage], Decision]
) -> Iterator[_Act]:
    """Yield the decisions that count; texts of the tree and telemetry are not even decoded."""
    for message in messages:
        if message.topic.kind in (TreeChanged, TelemetrySent):
            continue
        match item := decoded(message):
            case ReportSent(report=report):
                if report.stage or report.reason or report.severity is not Severity.INFORMATIONAL:
                    yield _report_act(report, item)
            case SubmitAnswered(identity=identity, result=result, refusal=refusal):
                reason = f" {refusal.reason.name}" if refusal else ""
                yield _Act(4, f"answer {result}{reason}", identity, item=item)
            case ModeChanged(mode=mode, active=active, fault=fault):
                row = f" (faults.{fault})" if fault else ""
                yield _Act(5, f"mode {mode.name}{row}", active, item=item)
            case PlanUpdateSent(update=update):
                yield _Act(5, f"plan {update.status.name} {update.node}".rstrip(), item=item)
            case VelocityCommanded(velocity=velocity):
                parts = velocity.travel_mps, velocity.rotate_radps
                rounded = Velocity(*(round(each, DIGITS) for each in parts))
                yield _Act(7, "velocity", velocity=rounded, item=item)
            case SolverRequested():
                yield _Act(8, str(item), item=item)
            case _:
                yield _Act(6, str(item), item=item)


def _report_act(report: Report, item: Decision) -> _Act:
    """Return a report by stage, reason and fault; without them by its text without figures."""
    is_terminal = report.stage is not None and report.stage.terminal
    stage = report.stage.name if report.stage else report.severity.name
    reason = report.reason.name if report.reason else ""
    fault = f"(faults.{report.fault})" if report.fault else ""
    text = without_figures(report.text) if report.kind is not ReportKind.COMMAND else ""
    parts = (stage, reason, fault) if reason or fault else (stage, text)
    rank = (0 if reason else 2) + (0 if is_terminal else 1)
    return _Act(rank, " ".join(filter(None, parts)), report.identity, item=item)


def _velocity_change(then: _Act | None, now: _Act | None) -> tuple[str, float | None]:
    """Return how the velocity differs in its component with the larger difference."""
    old = (then and then.velocity) or STANDING
    new = (now and now.velocity) or STANDING
    pairs = {
        "travel": (old.travel_mps, new.travel_mps),
        "rotation": (old.rotate_radps, new.rotate_radps),
    }
    name, (before, after) = max(pairs.items(), key=lambda each: abs(each[1][0] - each[1][1]))
    if before == 0.0 or after == 0.0:
        return f"velocity: {name} {'stopped' if before else 'started'}", None
    kind = (
        "reversed" if before * after < 0.0 else "faster" if abs(after) > abs(before) else "slower"
    )
    return f"velocity: {name} {kind}", after / before - 1.0
