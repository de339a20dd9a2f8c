"""`DecisionComparison` finds the first different decision of a replay and describes it.

The description has no measured figures, so that equal changes of many recordings form a group.
Texts, and figures in reports and telemetry, are no decisions: with the same inputs the state is
still the same, and the comparison continues.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from adapters.recording.run_file import RecordedMessage
from executive.commands import Request, declaration_of
from executive.core.recording import (
    CommandDequeued,
    Decision,
    Entry,
    Input,
    ModeChanged,
    PlanUpdateSent,
    ReportSent,
    SubmitAnswered,
    TelemetrySent,
    TreeChanged,
    VelocityCommanded,
)
from executive.values.geometry import STANDING, Velocity
from executive.values.reports import Identity, Report, ReportKind, Severity, without_figures

FOLLOW_S: Final = 0.15
"""Time after the first different decision within which its report is sent, s: three ticks."""
TEXTS: Final = "only texts or figures differ"
NOTHING: Final = "nothing"
_FAILED: Final = 0
"""Rank of the end of a command with a reason."""
_EXECUTED: Final = 2
"""Rank of the end of a command without one."""


@dataclass(frozen=True, slots=True)
class FirstDecision:
    """The first different decision of a recording.

    Attributes:
        command: name of the command that was executing; empty without one.
        replayed, recorded: the decisions; for a command that ended only in the replay the
            recorded one is the end of this command.
        entry: number of the entry in the recording, from 1.
        time_s: time since the first entry.
        change: relative change of the velocity; None for other decisions.
    """

    command: str
    replayed: str
    recorded: str
    entry: int
    time_s: float
    change: float | None = None

    @property
    def group(self) -> tuple[str, str, str]:
        """The description that equal changes have in common."""
        return self.command, self.replayed, self.recorded


@dataclass(frozen=True, slots=True)
class _Act:
    """A decision without its figures; a lower rank is closer to the cause."""

    rank: int
    text: str
    identity: Identity | None = None
    velocity: Velocity | None = None


def report_text(report: Report) -> str:
    """Return the stage, reason and fault of a report; without them its text without figures."""
    fault = f"(faults.{report.fault})" if report.fault else ""
    stage = report.stage.name if report.stage else report.severity.name
    reason = report.reason.name if report.reason else ""
    text = without_figures(report.text) if report.kind is not ReportKind.COMMAND else ""
    return " ".join(filter(None, (stage, reason, fault) if reason or fault else (stage, text)))


def _act(item: Decision) -> _Act | None:
    """Return a decision without figures; None if it consists of texts or telemetry."""
    match item:
        case TreeChanged() | TelemetrySent():
            return None
        case ReportSent(report=Report(severity=Severity.INFORMATIONAL, stage=None, reason=None)):
            return None
        case ReportSent(report=report):
            if report.stage is not None and report.stage.terminal:
                rank = _FAILED if report.reason else _EXECUTED
            else:
                rank = 1 if report.reason else 4
            return _Act(rank, report_text(report), report.identity)
        case SubmitAnswered(identity=identity, result=result, refusal=refusal):
            reason = f" {refusal.reason.name}" if refusal else ""
            return _Act(3, f"answer {result}{reason}", identity)
        case ModeChanged(mode=mode, active=active, fault=fault):
            row = f" (faults.{fault})" if fault else ""
            return _Act(5, f"mode {mode.name}{row}", active)
        case PlanUpdateSent(update=update):
            return _Act(5, f"plan {update.status.name} {update.node}".rstrip())
        case VelocityCommanded(velocity=velocity):
            return _Act(7, f"velocity {velocity}", velocity=velocity)
        case _:
            return _Act(6, str(item))


class DecisionComparison:
    """Compares the decisions of a replay, entry by entry, until `ended`.

    Args:
        decoded: returns the item in a message.

    Attributes:
        ended: whether the first different decision and its report are known.
    """

    def __init__(self, decoded: Callable[[RecordedMessage], Decision]) -> None:
        self.ended = False
        self._decoded = decoded
        self._commands: dict[Identity, Request] = {}
        self._active: Identity | None = None
        self._recorded: list[tuple[int, _Act]] = []
        self._replayed: list[tuple[int, _Act]] = []
        self._first: tuple[int, float] | None = None
        self._texts: FirstDecision | None = None

    def add(
        self,
        inputs: Sequence[Input | Entry],
        recorded: Sequence[RecordedMessage],
        replayed: Sequence[RecordedMessage],
        entry: int,
        time_s: float,
        raised: str,
    ) -> None:
        """Compare the decisions of an entry; `raised` is the exception of the core as text."""
        for each in inputs:
            if isinstance(each, CommandDequeued):
                self._commands[each.command.identity] = each.command.request
        if recorded != replayed or self._first is not None or raised:
            self._compare(recorded, replayed, entry, time_s, raised)
        if self._first is None or self._active is None:
            for message in recorded:
                if message.topic.kind is ModeChanged:
                    mode = self._decoded(message)
                    assert isinstance(mode, ModeChanged)
                    self._active = mode.active

    def _compare(
        self,
        recorded: Sequence[RecordedMessage],
        replayed: Sequence[RecordedMessage],
        entry: int,
        time_s: float,
        raised: str,
    ) -> None:
        then = [*filter(None, (_act(self._decoded(each)) for each in recorded))]
        now = [*filter(None, (_act(self._decoded(each)) for each in replayed))]
        if raised:
            now.append(_Act(-1, raised))
        if self._first is None and then != now:
            self._first = entry, time_s
        if self._first is not None:
            self.ended = bool(raised) or time_s > self._first[1] + FOLLOW_S
            self._recorded += ((entry, act) for act in (Counter(then) - Counter(now)).elements())
            self._replayed += ((entry, act) for act in (Counter(now) - Counter(then)).elements())
        elif self._texts is None:
            self._texts = FirstDecision("", TEXTS, "", entry, time_s)

    def first(self, ends: Mapping[Identity, str]) -> FirstDecision | None:
        """Return the first different decision; of texts or figures if there is no other.

        Args:
            ends: recorded end of each command, by `report_text`.
        """
        if self._first is None:
            return self._texts
        began, removed = min(self._recorded, key=_rank, default=(0, None))
        begins, added = min(self._replayed, key=_rank, default=(0, None))
        if added and removed and (added.rank, added.identity) != (removed.rank, removed.identity):
            added, removed = (added, None) if added.rank <= removed.rank else (None, removed)
        act, change = added or removed, None
        before, after = removed.text if removed else NOTHING, added.text if added else NOTHING
        if act is not None and act.rank in (_FAILED, _EXECUTED) and act.identity is not None:
            before = ends.get(act.identity, "no end")
            after = after if added else "no end yet"
        if act is None:
            before, after = "", "the same decisions in another order"
        elif before == after:
            before += " earlier" if removed and began < begins else " later"
        if act is not None and act.velocity is not None:
            before, (after, change) = "", _compared(removed, added)
        identity = (act and act.identity) or self._active
        request = None if identity is None else self._commands.get(identity)
        command = "" if request is None else declaration_of(type(request)).name
        return FirstDecision(command, after, before, *self._first, change)


def _rank(found: tuple[int, _Act]) -> int:
    return found[1].rank


def _compared(then: _Act | None, now: _Act | None) -> tuple[str, float | None]:
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
