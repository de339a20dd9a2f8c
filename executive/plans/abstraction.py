"""`abstracted`: a plan for its exploration: telemetry is any value, loops are short.

A value that depends on telemetry is `ANY`, and a condition on it is a choice. Loops of more than
two cycles have two; the counters of these are `ANY`. `limits` has the parts that a proof excludes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Protocol

from executive.plans.dialect import PRECONDITIONS
from executive.plans.model import (
    LOOPS,
    CellReference,
    PlanNode,
    PlanRoot,
    PortValue,
    nodes,
    parts_of,
)
from executive.plans.scripting import Cells, Evaluation, Script, UnknownValueError, compile_script
from executive.plans.syntax import ASSIGNMENTS, LITERAL, NAME, Expression, Value, expressions

ANY: Final = "\0any"
"""A value that can be any."""
MAX_CYCLES: Final = 2
MAX_PARTS: Final = 12
"""Maximum number of parts of a queue that are explored if the plan decides by them."""


def input_cells(node: PlanNode) -> Iterator[CellReference]:
    """Yield the cells that the input ports of a node read."""
    for port in node.kind.ports:
        value = node.ports.get(port.name)
        if isinstance(value, CellReference) and not port.type.is_output:
            yield value


def written_cells(node: PlanNode) -> set[int]:
    """Return the cells that the output ports and the scripts of a node write."""
    found = {
        target.cell
        for port in node.kind.ports
        if port.type.is_output and isinstance(target := node.ports.get(port.name), CellReference)
    }
    scripts = (script.statements for _, script in scripts_of(node))
    assigned = (each for one in scripts for each in expressions(one) if each.sign in ASSIGNMENTS)
    return found | {each.cell for each in assigned}


class Chooser(Protocol):
    """Makes the choices of an exploration."""

    def choose(self, options: int, key: object = None) -> int:
        """Return a choice from 0; the same one for the same key within a tick."""


_READING: Final = {NAME, *ASSIGNMENTS} - {":=", "="}


def cells_of_script(statements: Sequence[Expression]) -> Iterator[int]:
    """Yield the cells that a script reads."""
    for each in expressions(statements):
        if each.sign in _READING:
            yield each.cell


def scripts_of(node: PlanNode) -> Iterator[tuple[str, Script]]:
    """Yield the scripts of a node by their attributes."""
    for name, value in (*node.conditions.items(), *node.ports.items()):
        if isinstance(value, Script):
            yield name, value


@dataclass(slots=True)
class Abstraction:
    """Makes the abstract nodes of one plan.

    Attributes:
        limits: lines and texts of parts that are not explored exactly, as shortened loops.
    """

    plan: PlanRoot
    chooser: Chooser
    limits: set[tuple[int, str]] = field(default_factory=set)

    def root(self) -> PlanRoot:
        """Return the abstract plan."""
        found = self._node(self.plan, inexact=False)
        assert isinstance(found, PlanRoot)
        return found

    def _node(self, node: PlanNode, inexact: bool) -> PlanNode:
        ports = dict(node.ports)
        port = LOOPS.get(node.kind.name)
        if port is not None and node.number(port) > MAX_CYCLES:
            inexact, ports[port] = True, MAX_CYCLES
            self._shorten(node, f"{MAX_CYCLES} of {node.number(port):g} cycles")
        elif isinstance(queue := ports.get("queue"), str):
            parts, bound = parts_of(queue), MAX_PARTS if self._decides(node) else MAX_CYCLES
            if len(parts) > bound:
                inexact, ports["queue"] = True, ";".join(parts[:bound])
                self._shorten(node, f"{bound} of {len(parts)} parts")
        changed: dict[str, PortValue] = {
            name: self._script(node, name, value, inexact) if isinstance(value, Script) else value
            for name, value in ports.items()
        }
        return replace(
            node,
            children=tuple(self._node(each, inexact) for each in node.children),
            ports=changed,
            conditions={
                name: self._script(node, name, script, inexact)
                for name, script in node.conditions.items()
            },
        )

    def _shorten(self, loop: PlanNode, text: str) -> None:
        self.limits.add((loop.location.line, f"{loop.kind.name} explored with {text}"))

    def _decides(self, loop: PlanNode) -> bool:
        """Return whether a script or a port of a control reads the values of a loop."""
        values = {each.cell for each in loop.ports.values() if isinstance(each, CellReference)}
        for node in nodes(loop):
            for _, script in scripts_of(node):
                if values & set(cells_of_script(script.statements)):
                    return True
            decides = node.kind.command is None and node.kind.name not in {"Near", "Reachable"}
            if decides and values & {each.cell for each in input_cells(node)}:
                return True
        return False

    def _script(self, node: PlanNode, attribute: str, script: Script, inexact: bool) -> Script:
        measured = {cell for cell, _ in self.plan.blackboard.telemetry}
        statements = tuple(map(_Statement, script.statements))
        decides = script.statements[-1].sign not in ASSIGNMENTS
        can_fail = attribute in {*PRECONDITIONS[:-1], "if"} and node.kind.name != "WaitFor"
        can_fail = can_fail or any(each.assigned for each in statements)
        key = script.text, *sorted(cells_of_script(script.statements))

        def run(cells: Cells) -> Value:
            value: Value = 0.0
            for each in statements:
                before = [cells[cell] for cell in each.assigned]
                value, seen = each.run(cells, measured, inexact)
                if value == ANY and each.risk:
                    self.limits.add((node.location.line, each.risk))
                choice = ("unknown", key, seen)
                if seen is not None and can_fail and self.chooser.choose(2, choice):
                    for cell, old in zip(each.assigned, before, strict=True):
                        cells[cell] = old
                    raise UnknownValueError(seen)
            if value == ANY:
                return float(not self.chooser.choose(2, key)) if decides else 1.0
            return value

        return replace(script, run=run)


class _Statement:
    """A statement that is evaluated if nothing it reads is `ANY`.

    Attributes:
        assigned: the cells that it assigns.
        risk: why its evaluation may fail for some values; empty if it cannot.
    """

    def __init__(self, statement: Expression) -> None:
        self._reads = tuple(cells_of_script((statement,)))
        found = expressions((statement,))
        self.assigned = tuple(each.cell for each in found if each.sign in ASSIGNMENTS)
        self.risk = next(filter(None, map(_risk, expressions((statement,)))), "")
        self._run: Evaluation = compile_script("", (statement,)).run

    def run(self, cells: Cells, measured: set[int], inexact: bool) -> tuple[Value, int | None]:
        """Return its value, and the telemetry that it reads, if any."""
        for cell in self._reads:
            if cells[cell] is None:
                raise UnknownValueError(cell)
        if all(cells[cell] != ANY for cell in self._reads):
            value = self._run(cells)
            for cell in self.assigned if inexact else ():
                if cell in self._reads:
                    cells[cell] = value = ANY
            return value, None
        for cell in self.assigned:
            cells[cell] = ANY
        return ANY, next((cell for cell in self._reads if cell in measured), None)


def _risk(expression: Expression) -> str:
    """Return why an operation may fail for some values; empty if it cannot."""
    if expression.sign in {"/", "/="}:
        divisor = expression.operands[-1]
        if divisor.sign == LITERAL and divisor.value not in {0.0, ""}:
            return ""
        return "a divisor that is not constant"
    return "bits of a value that may have none" if expression.sign in {*"&|^~"} else ""
