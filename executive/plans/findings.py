"""`find_faults`: the static check of a plan that was read, for probable faults.

The reader refuses what cannot run; nothing is found twice.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Final

from executive.plans.abstraction import cells_of_script, input_cells, scripts_of
from executive.plans.arguments import suggest
from executive.plans.arrival import arrival_faults, instant_answers
from executive.plans.constant_conditions import constant_conditions
from executive.plans.dialect import LINK_UP, MODE, PRECONDITIONS, TELEMETRY
from executive.plans.model import (
    LOOPS,
    CellReference,
    PlanNode,
    PlanRoot,
    PlanStep,
    nodes,
    parts_of,
)
from executive.plans.scripting import as_number, case_matches, text_of
from executive.plans.syntax import ASSIGNMENTS, COMPARE, LITERAL, NAME, Value, expressions


class Level(Enum):
    """Weight of a finding."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True, slots=True)
class Finding:
    """A probable fault of a plan, or a note on it.

    Attributes:
        line: line of the plan's text.
        node: path of the node below the plan; empty for the plan or a tree as a whole.
        text: the fault and its remedy.
    """

    level: Level
    line: int
    node: str
    text: str

    @staticmethod
    def of(level: Level, node: PlanNode, text: str) -> "Finding":
        """Return a finding on a node."""
        return Finding(level, node.location.line, node.location.path.partition("/")[2], text)

    def __str__(self) -> str:
        at = f"{self.node}: " if self.node else ""
        return f"line {self.line}: {self.level.value}: {at}{self.text}"


_RELATIVE: Final = frozenset({"moveForward", "rotateBy", "drive", "moveCameraAngles"})
"""Commands with an effect relative to the pose of the rover when they start."""
_WHOLE: Final = frozenset({LINK_UP, MODE})
"""Telemetry with whole numbers only."""
_LOOPS: Final = {*LOOPS, "KeepRunningUntilFailure", "LoopString", "LoopDouble", "LoopPlace"}


def find_faults(plan: PlanRoot, begin_utc_s: float | None = None) -> tuple[Finding, ...]:
    """Return the findings on a plan, by line, each line of text with each fault once.

    Args:
        plan: the plan as it was read.
        begin_utc_s: planned begin, seconds since 1970-01-01 UTC; by default it begins in time for
            its first absolute time.
    """
    found = [Finding(Level.WARNING, line, "", text) for line, text in plan.unused]
    found += [
        Finding.of(Level.ERROR if always else Level.WARNING, node, text)
        for node, always, text in arrival_faults(plan, begin_utc_s)
    ]
    values = _text_values(plan)
    telemetry = dict(plan.blackboard.telemetry)
    reads = Counter(each for node in nodes(plan) for each in _cells_read(node))
    for node in nodes(plan):
        for rule in _RULES:
            found += (Finding.of(level, node, text) for level, text in rule(node))
        for holds, text in constant_conditions(node, telemetry):
            found.append(Finding.of(Level.WARNING if holds else Level.ERROR, node, text))
        found += (Finding.of(*each) for each in _unread(node, reads))
        found += (Finding.of(*each) for each in _impossible_texts(node, values, plan))
    once = {(each.line, each.text): each for each in reversed(found)}
    return tuple(sorted(once.values(), key=lambda each: (each.line, each.text)))


Rule = Callable[[PlanNode], Iterator[tuple[Level, str]]]


def _reactive(node: PlanNode) -> Iterator[tuple[Level, str]]:
    if node.kind.name not in {"ReactiveSequence", "ReactiveFallback"}:
        return
    passes = frozenset("SK" if node.kind.name == "ReactiveSequence" else "FK")
    for at, child in enumerate(node.children[:-1]):
        later = node.children[at + 1 :]
        instant = passes & instant_answers(child) and not any(map(_can_be_late, nodes(child)))
        if not instant and any(map(takes_time, later)):
            what = "a command" if any(map(_is_step, nodes(child))) else "a wait"
            name = child.location.name
            remedy = "put it into a Sequence around this node, or make it the last child"
            if node.kind.name == "ReactiveSequence" and _only_waits_for(child):
                text = f"{name} begins again in each tick, and halts the children after it"
                yield Level.WARNING, f"{text} while its condition does not hold: {remedy}"
                continue
            yield Level.ERROR, f"{what} in {name} begins again in each tick: {remedy}"
            return


def _can_be_late(node: PlanNode) -> bool:
    return node.kind.name == "WaitUntil" and "late_s" in node.ports


def _only_waits_for(child: PlanNode) -> bool:
    """Return whether it waits for conditions only, and succeeds at once while they hold."""
    timed = {each.kind.name for each in nodes(child) if _is_step(each) or each.kind.name in _TIMED}
    inverts = {each.kind.name for each in nodes(child)} & {"Inverter", "ForceFailure"}
    return timed == {"WaitFor"} and not inverts


def _run_once(node: PlanNode) -> Iterator[tuple[Level, str]]:
    if node.kind.name in _LOOPS and _is_once(node.children[0]):
        remedy = "put the RunOnce beside other steps in a Sequence, or remove the loop"
        yield Level.ERROR, f"the second cycle is skipped by RunOnce and ends the plan: {remedy}"


def _is_once(node: PlanNode) -> bool:
    if node.kind.name == "RunOnce":
        return bool(node.ports["then_skip"])
    return bool(node.children) and all(map(_is_once, node.children))


def _parallel(node: PlanNode) -> Iterator[tuple[Level, str]]:
    if node.kind.name != "Parallel" or node.ports["counts_skipped"]:
        return
    surely = sum("K" not in instant_answers(each) for each in node.children)
    if surely < node.number("success_count"):
        yield (
            Level.ERROR,
            f"it waits for ever if children are skipped, {surely} are not: success_count -1 "
            "takes skipped children for done",
        )


def _rounds(node: PlanNode) -> Iterator[tuple[Level, str]]:
    if node.kind.name == "KeepRunningUntilFailure":
        yield Level.NOTE, "time limits it: the maximum number of commands has one round of it"


def _retry(node: PlanNode) -> Iterator[tuple[Level, str]]:
    if node.kind.name != "RetryUntilSuccessful":
        return
    if not takes_time(node.children[0]):
        yield Level.WARNING, "all attempts are made at once: use WaitFor, or a Delay below it"
    steps = [each for each in nodes(node) if _is_step(each)]
    for relative in (each for each in steps if each.kind.name in _RELATIVE and len(steps) > 1):
        text = f"each attempt does {relative.location.name} again, relative to the one before"
        yield Level.WARNING, f"{text}: use {_absolute(relative)}"


def _milliseconds(node: PlanNode) -> Iterator[tuple[Level, str]]:
    port = next((each for each in ("msec", "delay_msec") if each in node.ports), None)
    if port is None:
        return
    msec, steps = node.number(port), [each for each in nodes(node) if isinstance(each, PlanStep)]
    short = f"{port} is in ms: {msec:g} is {msec / 1000:g} s"
    if node.kind.name != "Timeout":
        found = msec < _MIN_WAIT_MSEC
    else:
        deadline_s = max((each.deadline_s or 0.0 for each in steps), default=0.0)
        is_less = msec < _MAX_AMBIGUOUS_MSEC and msec / 1000 < deadline_s < msec
        found = is_less or (msec < _MIN_TIMEOUT_MSEC and bool(steps))
        short += f", less than the deadline of a step, {deadline_s:g} s" if is_less else ""
    if found:
        yield Level.WARNING, f"{short}, write {msec * 1000:.0f} if s are meant"


_MIN_WAIT_MSEC: Final = 100
"""Minimum plausible time of a wait, ms; chosen."""
_MIN_TIMEOUT_MSEC: Final = 1000
"""Minimum plausible limit around a command, ms; chosen."""
_MAX_AMBIGUOUS_MSEC: Final = 10_000
"""Maximum limit that may be in s by mistake if a step below has a longer deadline, ms; chosen."""


def _long_deadline(node: PlanNode) -> Iterator[tuple[Level, str]]:
    deadline_s = (node.deadline_s or 0.0) if isinstance(node, PlanStep) else 0.0
    if deadline_s >= _MIN_LONG_S and deadline_s % 1000 == 0:
        text = f"deadline_s is in s: {deadline_s:g} is {deadline_s / 3600:.1f} h"
        yield Level.WARNING, f"{text}, write {deadline_s / 1000:g} if ms are meant"


_MIN_LONG_S: Final = 10_000
"""Minimum deadline of a command that may be in ms by mistake, s; chosen."""


def _relative(node: PlanNode) -> Iterator[tuple[Level, str]]:
    if node.kind.name in _RELATIVE:
        yield Level.NOTE, f"after a stop the whole of it is done again: {_absolute(node)} is not"


def _absolute(node: PlanNode) -> str:
    """Return the absolute command to use instead of a relative one."""
    return "setCameraAngles" if node.kind.name == "moveCameraAngles" else "moveTo"


def _equal_floats(node: PlanNode) -> Iterator[tuple[Level, str]]:
    for attribute, script in scripts_of(node):
        for each in expressions(script.statements):
            if each.sign == COMPARE and {"==", "!="} & set(each.text.split()):
                names = {one.text for one in each.operands if one.sign == NAME}
                if names & {f"@{each}" for each in TELEMETRY.keys() - _WHOLE}:
                    text = f"{attribute}: {script.text}: measured values are never equal"
                    yield Level.WARNING, f"{text}, compare them with < and >"


def _assigns(node: PlanNode) -> Iterator[tuple[Level, str]]:
    for attribute, script in scripts_of(node):
        is_code = attribute == "code" and node.kind.name == "ScriptCondition"
        if (is_code or attribute in _CONDITIONAL) and script.statements[-1].sign == "=":
            yield Level.WARNING, f"{attribute}: {script.text}: = assigns, == compares"


_CONDITIONAL: Final = {*PRECONDITIONS, "if"}


def _same_cases(node: PlanNode) -> Iterator[tuple[Level, str]]:
    cases: list[object] = []
    for at in range(1, len(node.children)) if "variable" in node.ports else ():
        case = node.ports.get(f"case_{at}")
        if case in cases:
            first = cases.index(case) + 1
            yield Level.ERROR, f"case_{at} is never taken: case_{first} is the same"
        cases.append(case)


_RULES: Final[tuple[Rule, ...]] = (
    _reactive,
    _run_once,
    _parallel,
    _rounds,
    _retry,
    _milliseconds,
    _long_deadline,
    _relative,
    _equal_floats,
    _assigns,
    _same_cases,
)


def _is_step(node: PlanNode) -> bool:
    return isinstance(node, PlanStep)


def takes_time(node: PlanNode) -> bool:
    """Return whether a node can be RUNNING, apart from loops that yield."""
    return any(_is_step(each) or each.kind.name in _TIMED for each in nodes(node))


_TIMED: Final = frozenset(
    {"Sleep", "Delay", "WaitUntil", "WaitFor", "Ask", "Window", "KeepRunningUntilFailure"}
)


def _cells_read(node: PlanNode) -> Iterator[int]:
    yield from (each.cell for each in input_cells(node))
    for _, script in scripts_of(node):
        yield from cells_of_script(script.statements)


def _unread(node: PlanNode, reads: Counter[int]) -> Iterator[tuple[Level, PlanNode, str]]:
    for port in node.kind.ports:
        value = node.ports.get(port.name)
        if port.type.is_output and isinstance(value, CellReference) and not reads[value.cell]:
            level = Level.WARNING if port.required else Level.NOTE
            remedy = "read it in a Switch, a condition or a port, or leave it out"
            yield level, node, f"nothing reads {port.name} {{{value.name}}}: {remedy}"
    for attribute, script in scripts_of(node):
        for each in expressions(script.statements):
            if each.sign in ASSIGNMENTS and not reads[each.cell]:
                yield Level.NOTE, node, f"{attribute}: nothing in the plan reads {each.text}"


def _text_values(plan: PlanRoot) -> dict[int, set[Value]]:
    """Return the possible values of the cells that get only literals."""
    found: defaultdict[int, set[Value]] = defaultdict(set)
    other = {cell for cell, _ in plan.blackboard.telemetry}
    for node in nodes(plan):
        for _, script in scripts_of(node):
            for each in expressions(script.statements):
                if each.sign in ASSIGNMENTS:
                    written = each.operands[-1]
                    is_literal = each.sign in {":=", "="} and written.sign == LITERAL
                    found[each.cell] |= {written.value} if is_literal else set()
                    other |= set() if is_literal else {each.cell}
        for port in node.kind.ports:
            target = node.ports.get(port.name)
            if port.type.is_output and isinstance(target, CellReference):
                given = _written(node)
                found[target.cell] |= given or set()
                other |= set() if given else {target.cell}
    initial = plan.blackboard.initial
    return {
        cell: values | ({value} if (value := initial[cell]) is not None else set())
        for cell, values in found.items()
        if cell not in other
    }


def _written(node: PlanNode) -> set[Value] | None:
    source = {"Ask": "options", "LoopString": "queue", "SetBlackboard": "value"}.get(node.kind.name)
    value = None if source is None else node.ports.get(source)
    if not isinstance(value, str | float):
        return None
    return set(parts_of(value)) if source != "value" and isinstance(value, str) else {value}


def _impossible_texts(
    node: PlanNode, values: dict[int, set[Value]], plan: PlanRoot
) -> Iterator[tuple[Level, PlanNode, str]]:
    """Yield cases and comparisons with a text that the variable never has; options without a case.

    A single option may be left to the last child of a Switch.
    """
    variable = node.ports.get("variable")
    cases = [node.ports.get(f"case_{at}") for at in range(1, len(node.children))]
    if isinstance(variable, CellReference) and variable.cell in values:
        left = set(values[variable.cell])
        for at, case in enumerate(cases, 1):
            if isinstance(case, str | float):
                had = {each for each in values[variable.cell] if case_matches(each, case)}
                left -= had
                if not had:
                    text = _never(variable.name, case, values[variable.cell])
                    yield Level.ERROR, node, f"case_{at} is never taken: {text}"
            else:
                left.clear()
        options = {
            option
            for each in nodes(plan)
            if each.kind.name == "Ask" and each.ports["answer"] == variable
            for option in parts_of(each.text("options"))
        }
        if len(left & options) > 1:
            names = ", ".join(sorted(map(text_of, left & options)))
            remedy = "give each but one a case"
            yield Level.WARNING, node, f"options without a case: {names}: {remedy}"
    elif isinstance(variable, CellReference) and variable.cell in plan.blackboard.numbers:
        for at, case in enumerate(cases, 1):
            if isinstance(case, str) and as_number(case) is None:
                text = f"case_{at} is never taken: {variable.name} is a number, never {case!r}"
                yield Level.ERROR, node, text
    for attribute, script in scripts_of(node):
        for comparison in expressions(script.statements):
            if comparison.sign == COMPARE and len(comparison.operands) == 2:
                name, literal = sorted(comparison.operands, key=lambda each: each.sign != NAME)
                if (name.sign, literal.sign) == (NAME, LITERAL):
                    had = values.get(name.cell, {literal.value})
                    if isinstance(literal.value, str) and literal.value not in had:
                        text = _never(name.text, literal.value, had)
                        yield Level.ERROR, node, f"{attribute}: {text}"


def _never(name: str, value: Value, values: set[Value]) -> str:
    known = sorted(map(text_of, values))
    near = suggest(text_of(value), known)
    return f"{name} is never {text_of(value)!r}{near or ', only ' + ', '.join(known)}"
