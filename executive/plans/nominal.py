"""The steps that a plan takes if each succeeds: for previews and the estimate of energy."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from executive.plans.model import (
    LOOPS,
    MAX_LOOP_CYCLES,
    MAX_READ_PARTS,
    CellReference,
    PlanNode,
    PlanRoot,
    PlanStep,
    part_values,
    parts_of,
)
from executive.plans.scripting import (
    Cells,
    EvaluationError,
    Script,
    UnknownValueError,
    case_matches,
    text_of,
    value_of,
)
from executive.plans.syntax import ArgumentError, Value


@dataclass(frozen=True, slots=True)
class TimeLimit:
    """Begin of the subtree that a timeout limits."""

    path: str
    duration_s: float


@dataclass(frozen=True, slots=True)
class TimeLimitEnd:
    """End of the subtree that a timeout limits."""

    limit: TimeLimit


NominalStep = PlanStep | TimeLimit | TimeLimitEnd


MAX_VISITS: Final = 50_000
"""Maximum number of nodes that are visited: loops without a command would take hours; chosen."""


def nominal_steps(root: PlanNode) -> Iterator[NominalStep]:
    """Yield the steps of a plan in order, assuming that each succeeds, with their requests.

    Of a fallback the first child, of a retry one attempt, of a choice its first branch, unless the
    blackboard decides it. Conditions hold. Steps that a timeout limits follow it and precede its
    end. Steps with an argument that is not known before the plan runs are left out.
    """
    cells = list(root.blackboard.initial) if isinstance(root, PlanRoot) else []
    return _visit(root, cells, iter(range(MAX_VISITS)))


def _visit(node: PlanNode, cells: Cells, left: Iterator[int]) -> Iterator[NominalStep]:
    if next(left, None) is not None and _runs(node, cells):
        yield from _body(node, cells, left)
        for name in ("_onSuccess", "_post"):
            _run(node.conditions.get(name), cells)


def _body(node: PlanNode, cells: Cells, left: Iterator[int]) -> Iterator[NominalStep]:
    if isinstance(node, PlanStep):
        with suppress(UnknownValueError, ArgumentError):
            yield node.bound(cells)
        return
    chosen = node.children
    match node.kind.name:
        case "Script":
            _run(node.ports["code"], cells)
        case "SetBlackboard":
            text = _given(node, "value", cells)
            _write(node, "output_key", None if text is None else value_of(text), cells)
        case "Ask":
            _write(node, "answer", _given(node, "default", cells), cells)
        case "Fallback" | "AsyncFallback" | "ReactiveFallback":
            chosen = chosen[:1]
        case "IfThenElse" | "WhileDoElse":
            chosen = chosen[:2]
        case "TryCatch":
            chosen = chosen[:-1]
        case "Switch2" | "Switch3" | "Switch4" | "Switch5" | "Switch6":
            chosen = (_case(node, cells),)
        case "Repeat":
            chosen *= max(1, int(node.number("num_cycles")))
        case "LoopString" | "LoopDouble" | "LoopPlace":
            for part in parts_of(_given(node, "queue", cells) or "")[:MAX_LOOP_CYCLES]:
                for port, value in part_values(node.kind.name, part).items():
                    _write(node, port, value, cells)
                yield from _visit(chosen[0], cells, left)
            return
        case "Timeout":
            limit = TimeLimit(node.location.path, node.number("msec") / 1000)
            yield limit
            yield from _visit(chosen[0], cells, left)
            yield TimeLimitEnd(limit)
            return
        case _:
            pass
    for child in chosen:
        yield from _visit(child, cells, left)


def _runs(node: PlanNode, cells: Cells) -> bool:
    """Return whether the blackboard does not skip a node; an unknown condition holds."""
    conditions, has_condition = node.conditions, node.kind.name == "Precondition"
    skips = (conditions.get("_skipIf"), conditions.get("_successIf"))
    needs = (node.ports["if"] if has_condition else None, conditions.get("_while"))
    if any(_run(each, cells) for each in skips):
        return False
    return all(_run(each, cells) is not False for each in needs)


def _run(script: object, cells: Cells) -> bool | None:
    """Run a script, if any; return None if it could not be evaluated."""
    if not isinstance(script, Script):
        return None
    try:
        return script.holds(cells)
    except (UnknownValueError, EvaluationError):
        return None


def _given(node: PlanNode, port: str, cells: Cells) -> str | None:
    value = node.ports.get(port)
    found = cells[value.cell] if isinstance(value, CellReference) else value
    return text_of(found) if isinstance(found, str | float) else None


def _write(node: PlanNode, port: str, value: Value | None, cells: Cells) -> None:
    target = node.ports.get(port)
    if isinstance(target, CellReference) and value is not None:
        cells[target.cell] = value


def _case(node: PlanNode, cells: Cells) -> PlanNode:
    variable = _given(node, "variable", cells)
    for at, child in enumerate(node.children[:-1], 1):
        case = _given(node, f"case_{at}", cells)
        if variable is not None and case is not None and case_matches(variable, case):
            return child
    return node.children[-1 if variable is not None else 0]


def max_leaves(node: PlanNode, commands_only: bool = False) -> int:
    """Return the maximum number of executed leaves; a loop that only time limits counts once."""
    if not node.children:
        return int(isinstance(node, PlanStep) or not commands_only)
    times = 1
    if node.kind.name in LOOPS:
        times = max(1, int(node.number(LOOPS[node.kind.name])))
    elif node.kind.name.startswith("Loop"):
        queue = node.ports["queue"]
        times = len(parts_of(queue)) if isinstance(queue, str) else MAX_READ_PARTS
    return times * sum(max_leaves(child, commands_only) for child in node.children)


def max_commands(node: PlanNode) -> int:
    """Return the maximum number of commands of a node."""
    return max_leaves(node, commands_only=True)
