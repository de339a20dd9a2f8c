"""Arithmetic of times: when each node can end, the windows that it misses, its instant answers.

Deadlines, waits and loops are summed along the tree. A plan without a planned begin begins in time
for its first absolute time. The sums start there.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf
from typing import Final, NamedTuple

from executive.plans.model import LOOPS, PlanNode, PlanRoot, PlanStep, parts_of

TimeFault = tuple[PlanNode, bool, str]
"""A node, whether its time is missed in any case, and the text."""


class _Span(NamedTuple):
    """Earliest and latest time, seconds since 1970-01-01 UTC; `-inf` for in time."""

    early: float
    late: float

    def later(self, min_s: float, max_s: float) -> "_Span":
        return _Span(self.early + min_s, self.late + max_s)


def _hull(*spans: _Span | None) -> _Span | None:
    given = [each for each in spans if each is not None]
    if not given:
        return None
    return _Span(min(each.early for each in given), max(each.late for each in given))


class _Ends(NamedTuple):
    """When a node can succeed, fail, or be skipped; None for never."""

    success: _Span | None = None
    failure: _Span | None = None
    skipped: _Span | None = None

    def at_most(self, limit: float) -> "_Ends":
        return _Ends(
            *(each and _Span(min(each.early, limit), min(each.late, limit)) for each in self)
        )


def _either(ends: Iterable[_Ends]) -> _Ends:
    return _Ends(*(_hull(*column) for column in zip(*ends, strict=True)))


def arrival_faults(plan: PlanRoot, begin_utc_s: float | None) -> list[TimeFault]:
    """Return the nodes with times that are missed, always or in the worst case."""
    begin = -inf if begin_utc_s is None else begin_utc_s
    walk = _Walk()
    walk.ends(plan, _Span(begin, begin), inf)
    return walk.faults


def instant_answers(node: PlanNode) -> frozenset[str]:
    """Return the answers that a node can give in its first tick: S, F or K (skipped)."""
    ends = _Walk(relative=True).ends(node, _Span(0.0, 0.0), inf)
    pairs = zip("SFK", ends, strict=True)
    return frozenset(answer for answer, at in pairs if at is not None and at.early == 0.0)


_TICK_S: Final = 1e-9
"""Minimum time of a command or a wait: it is not over in its first tick."""
_ELSE: Final = {"SUCCESS": "success", "FAILURE": "failure", "SKIPPED": "skipped"}


@dataclass(slots=True)
class _Walk:
    """A walk along the tree.

    Attributes:
        relative: whether absolute times are passed over, because only durations matter.
        durations: ends of nodes that begin at 0, by their numbers.
        is_second: whether this is the second cycle of a loop: loops below have only one.
    """

    relative: bool = False
    faults: list[TimeFault] = field(default_factory=list)
    durations: dict[int, _Ends] = field(default_factory=dict)
    is_second: bool = False

    def _durations(self, node: PlanNode) -> _Ends:
        found = self.durations.get(node.location.number)
        if found is None:
            found = _Walk(True, durations=self.durations).ends(node, _Span(0.0, 0.0), inf)
            self.durations[node.location.number] = found
        return found

    def ends(self, node: PlanNode, at: _Span, limit: float) -> _Ends:
        """Return when a node can end that is reached within a span, before a limit."""
        found = self._ends(node, at, limit).at_most(limit)
        names = node.conditions.keys()
        guards = ({"_successIf"}, {"_failureIf"}, {"_skipIf", "_while"})
        guarded = _Ends(*(at if names & each else None for each in guards))
        return _either((found, guarded))

    def _ends(self, node: PlanNode, at: _Span, limit: float) -> _Ends:
        if isinstance(node, PlanStep):
            end = at.later(_TICK_S, inf if node.deadline_s is None else node.deadline_s)
            return _Ends(end, end)
        below, name = node.children, node.kind.name
        if name in {"Sleep", "Delay"}:
            time_s = node.number("msec" if name == "Sleep" else "delay_msec") / 1000
            at = at.later(time_s, time_s)
            return _Ends(at) if name == "Sleep" else self.ends(below[0], at, limit)
        if name in {"WaitFor", "Ask"}:
            allowed_s = node.number("deadline_s") if "deadline_s" in node.ports else inf
            fails = name == "WaitFor" or "default" not in node.ports
            if not fails and at.early + allowed_s > limit:
                missed_s = at.early + allowed_s - limit
                text = f"its default never counts: a time limit ends it {missed_s:.0f} s before"
                self._fault(node, False, text)
            failure = at.later(allowed_s, allowed_s) if fails else None
            return _Ends(at.later(_TICK_S, allowed_s), failure)
        if name in LOOPS or name.startswith("Loop"):
            return self._loop(node, at, limit)
        special = {"WaitUntil": self._wait, "Window": self._window, "Timeout": self._timeout}
        if name in special:
            return special[name](node, at, limit)
        if name in {"AlwaysSuccess", "SetBlackboard", "AlwaysFailure"}:
            return _Ends(None, at) if name == "AlwaysFailure" else _Ends(at)
        if name == "TryCatch":
            found = self._in_order(below[:-1], at, limit, passes=0)
            if found.failure is None:
                return found
            return found._replace(failure=_hull(*self.ends(below[-1], found.failure, limit)))
        if name.startswith(("Parallel", "Switch")):
            ends = [self.ends(each, at, limit) for each in below]
            return self._parallel(node, ends) if name.startswith("P") else _either(ends)
        if name in {"IfThenElse", "WhileDoElse"}:
            tested = self.ends(below[0], at, limit)
            pairs = zip(below[1:], tested, strict=False)
            branches = [self.ends(each, begin, limit) for each, begin in pairs if begin]
            failure = tested.failure if len(below) == 2 else None
            return _either((*branches, _Ends(None, failure, tested.skipped)))
        if not below:
            return _Ends(at, at)
        return self._decorated(node, self._in_order(below, at, limit, "Fallback" in name), at)

    @staticmethod
    def _decorated(node: PlanNode, found: _Ends, at: _Span) -> _Ends:
        end = _hull(found.success, found.failure)
        match node.kind.name:
            case "Inverter":
                return _Ends(found.failure, found.success, found.skipped)
            case "ForceSuccess":
                return _Ends(end, None, found.skipped)
            case "ForceFailure":
                return _Ends(None, end, found.skipped)
            case "RunOnce":
                again = _Ends(None, None, at) if node.ports["then_skip"] else _Ends(at, at)
                return _either((found, again))
            case "KeepRunningUntilFailure":
                return _Ends(None, found.failure and _Span(found.failure.early, inf))
            case "Precondition" if node.text("else") in _ELSE:
                return _either((found, _Ends(**{_ELSE[node.text("else")]: at})))
            case _:
                return found

    def _wait(self, node: PlanNode, at: _Span, limit: float) -> _Ends:
        if self.relative:
            return _Ends(at)
        utc_s = node.number("utc")
        if utc_s > limit:
            self._fault(node, True, f"a time limit ends it {utc_s - limit:.0f} s before")
        allowed = utc_s + node.number("late_s") if "late_s" in node.ports else inf
        if at.early > allowed:
            self._fault(node, True, f"it is always {at.early - allowed:.0f} s after its time")
            return _Ends(None, at)
        if at.late > allowed:
            self._fault(node, False, f"in the worst case it is {_text(at.late - allowed)} too late")
        elif at.early > utc_s:
            self._fault(node, False, f"its time is past by {at.early - utc_s:.0f} s in any case")
        success = _Span(max(at.early, utc_s), min(max(at.late, utc_s), max(allowed, utc_s)))
        return _Ends(success, at if at.late > allowed else None)

    def _window(self, node: PlanNode, at: _Span, limit: float) -> _Ends:
        child = node.children[0]
        if self.relative:
            return self.ends(child, at, limit)
        begin = node.number("from") if "from" in node.ports else -inf
        end = node.number("until") if "until" in node.ports else inf
        if at.early >= end:
            self._fault(node, True, f"it is always missed, by {at.early - end:.0f} s at least")
            return _Ends(None, at)
        if at.late >= end:
            self._fault(node, False, f"it is missed in the worst case, by {_text(at.late - end)}")
        start = _Span(max(at.early, begin), max(min(at.late, end), begin))
        least = self._durations(child).success
        if least is not None and start.early + least.early > end:
            needed_s = start.early + least.early - end
            self._fault(node, True, f"its steps take {needed_s:.0f} s longer than it is open")
        found = self.ends(child, start, min(limit, end))
        return found._replace(failure=_hull(found.failure, None if end == inf else _Span(end, end)))

    def _timeout(self, node: PlanNode, at: _Span, limit: float) -> _Ends:
        allowed_s = node.number("msec") / 1000
        least = self._durations(node.children[0]).success
        if least is not None and least.early > allowed_s:
            text = f"its steps take {least.early:g} s at least, and it ends after {allowed_s:g} s"
            self._fault(node, True, text)
        end = at.later(allowed_s, allowed_s)
        inner = limit if end.late == -inf else min(limit, end.late)
        found = self.ends(node.children[0], at, inner).at_most(end.late)
        return found._replace(failure=_hull(found.failure, end))

    def _in_order(self, below: Iterable[PlanNode], at: _Span, limit: float, passes: int) -> _Ends:
        """Return the ends of a sequence (passes 0) or a fallback (1)."""
        ended: _Span | None = None
        present: _Span | None = at
        skipped: _Span | None = at
        for child in below:
            if present is None:
                break
            found = self.ends(child, present, limit)
            ended = _hull(ended, found[1 - passes])
            present = _hull(found[passes], found.skipped)
            skipped = skipped and found.skipped
        ends = (ended, present) if passes else (present, ended)
        return _Ends(*ends, skipped)

    @staticmethod
    def _parallel(node: PlanNode, found: list[_Ends]) -> _Ends:
        needed = node.ports.get("success_count", len(found))
        assert isinstance(needed, int)
        given = [each for one in found if (each := _hull(one.success, one.skipped)) is not None]
        success = _hull(*given)
        if success is not None and len(given) >= needed:
            success = _Span(sorted(each.early for each in given)[needed - 1], success.late)
        is_skipped = all(each.skipped for each in found)
        skipped = found[-1].skipped if is_skipped else None
        return _Ends(success, _hull(*(each.failure for each in found)), skipped)

    def _loop(self, node: PlanNode, at: _Span, limit: float) -> _Ends:
        """Return the ends of a loop; its first two cycles are tested for faults."""
        again = int(node.kind.name == "RetryUntilSuccessful")
        queue = node.ports.get("queue")
        cycles = len(parts_of(queue)) if isinstance(queue, str) else 1
        if node.kind.name in LOOPS:
            cycles = int(node.number(LOOPS[node.kind.name]))
        first, durations = self.ends(node.children[0], at, limit), self._durations(node.children[0])
        begin, cycle, other = first[again], durations[again], first[1 - again]
        if cycles <= 1 or begin is None or cycle is None:
            return first
        self._test_second_cycle(node, begin, limit)
        last = begin.later((cycles - 1) * cycle.early, (cycles - 1) * cycle.late)
        failing = durations[1 - again]
        if other is not None and failing is not None:
            late = begin.late + (cycles - 2) * cycle.late + failing.late
            other = _Span(other.early, max(other.late, late))
        return _Ends(other if again else last, last if again else other, first.skipped)

    def _test_second_cycle(self, loop: PlanNode, begin: _Span, limit: float) -> None:
        if self.relative or self.is_second:
            return
        second = _Walk(durations=self.durations, is_second=True)
        second.ends(loop.children[0], begin, limit)
        known = {node.location.number for node, _, _ in self.faults}
        for node, always, text in second.faults:
            if always and node.location.number not in known:
                self.faults.append((node, False, f"in the second cycle {text}"))

    def _fault(self, node: PlanNode, always: bool, text: str) -> None:
        if not self.relative:
            self.faults.append((node, always, f"{text}: begin earlier, or change the times"))


def _text(seconds: float) -> str:
    return "without a bound" if seconds == inf else f"{seconds:.0f} s"
