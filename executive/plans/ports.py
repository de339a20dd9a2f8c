"""`read_ports` reads the ports of a node, literals and variables, and checks their rules."""

from collections.abc import Callable, Mapping
from typing import Final

from executive.faults import FaultTable
from executive.plans.arguments import argument_value, check_length, choice, count, number, utc
from executive.plans.blackboard import Scope, variable
from executive.plans.dialect import DEADLINE, NodeKind, Port, PortType
from executive.plans.model import (
    LOOPS,
    MAX_LOOP_CYCLES,
    CellReference,
    PlanNode,
    PortValue,
    part_values,
    parts_of,
)
from executive.plans.scripting import value_of
from executive.plans.syntax import ArgumentError

MAX_DEADLINE_S: Final = 86_400.0
MAX_OPTIONS: Final = 10

_STATUSES: Final = {each: each for each in ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING")}
_FLAGS: Final = {"true": True, "1": True, "false": False, "0": False}
_FAULTS: Final = {each: each for each in FaultTable.__dataclass_fields__}


def read_ports(node: PlanNode, texts: Mapping[str, str], scope: Scope, limited: bool) -> None:
    """Read all ports of a node that are given or have a default; its scripts are there already.

    Args:
        node: the node; its ports are set.
        texts: the texts that are given.
        scope: the names of its tree.
        limited: whether the time is limited above it.

    Raises:
        ArgumentError: a port is not valid, or missing.
    """
    ports = node.ports
    for port in node.kind.ports:
        text = texts.get(port.name, port.default)
        if text is None and port.required:
            raise ArgumentError(f"{node.kind.name} needs {port.name} ({port.meaning})")
        if text is not None and not port.type.is_script:
            ports[port.name] = _value(port, check_length(port.name, text), scope)
    deadline_s = ports.get(DEADLINE)
    if isinstance(deadline_s, float) and not 0.0 < deadline_s <= MAX_DEADLINE_S:
        bounds = f"above 0, {MAX_DEADLINE_S:g} at most"
        raise ArgumentError(f"{DEADLINE} {deadline_s:g}: {bounds}")
    _check_ports(node.kind, ports, len(node.children), limited)


def _literal(name: str, text: str, scope: Scope) -> str | CellReference:
    wanted = variable(text, name)
    if wanted is None:
        return text
    cell = scope.cell_of(name, wanted)
    constant = scope.cells.constant(cell)
    if constant is not None:
        return check_length(name, constant)
    if not scope.cells.has_value(cell):
        outer = scope.cells.names[cell].rpartition("/")[2]
        remapped = "" if outer == wanted else f", which is {{{outer[:40]}}} above"
        remedy = f"set it before, or give --arg {outer[:40]}=VALUE"
        raise ArgumentError(f"{name}: no value given for {{{wanted[:40]}}}{remapped}: {remedy}")
    return CellReference(cell, wanted)


def _value(port: Port, text: str, scope: Scope) -> PortValue:
    name = port.name
    if port.type.is_output:
        wanted = variable(text, name) or text
        return CellReference(scope.resolve(wanted), wanted)
    found = _literal(name, text, scope)
    if isinstance(found, CellReference):
        if port.type not in {PortType.NUMBER, PortType.TEXT, PortType.ANY}:
            remedy = "give a number, or an argument of the plan"
            raise ArgumentError(f"{name}: {{{found.name}}} is not known before the plan: {remedy}")
        return found
    if port.argument is not None:
        return argument_value(port.argument, found)
    if port.type is PortType.NUMBER:
        return number(name, found, port.meaning)
    return _CONVERTED[port.type](name, found)


def _milliseconds(name: str, text: str) -> int:
    msec = count(name, text)
    if not 0 < msec <= MAX_DEADLINE_S * 1000:
        raise ArgumentError(f"{name} {msec}: above 0, {MAX_DEADLINE_S * 1000:.0f} at most")
    return msec


_CONVERTED: Final[dict[PortType, Callable[[str, str], PortValue]]] = {
    PortType.COUNT: count,
    PortType.MILLISECONDS: _milliseconds,
    PortType.SECONDS: number,
    PortType.UTC: utc,
    PortType.STATUS: lambda name, text: choice(name, text, _STATUSES),
    PortType.FLAG: lambda name, text: choice(name, text.lower(), _FLAGS),
    PortType.ANY: lambda _, text: value_of(text),
    PortType.TEXT: lambda _, text: text,
}
"""Functions of name and text that return the value of a port that is no argument."""


def _check_ports(kind: NodeKind, ports: dict[str, PortValue], children: int, limited: bool) -> None:
    match kind.name:
        case "Parallel":
            for name in ("success_count", "failure_count"):
                required = ports[name]
                ports[name] = _threshold(name, required, children)
                if name == "success_count":
                    ports["counts_skipped"] = isinstance(required, int) and required < 0
        case "ParallelAll":
            ports["max_failures"] = _threshold("max_failures", ports["max_failures"], children)
        case "Repeat" | "RetryUntilSuccessful":
            name, times = LOOPS[kind.name], ports[LOOPS[kind.name]]
            assert isinstance(times, int)
            if not 1 <= times <= MAX_LOOP_CYCLES and not (times == -1 and limited):
                ends = "so that every plan ends; -1 below a Timeout, or a Window with until"
                raise ArgumentError(f"{name} {times}: 1 to {MAX_LOOP_CYCLES}, {ends}")
        case "KeepRunningUntilFailure":
            if not limited:
                remedy = "put it below a Timeout, or a Window with until"
                raise ArgumentError(f"{kind.name} has no end of its own: {remedy}, or use Repeat")
        case "LoopString" | "LoopDouble" | "LoopPlace":
            _check_queue(kind.name, ports)
        case "Ask":
            _check_question(ports)
        case "FaultActive":
            choice("name", str(ports["name"]), _FAULTS)
        case "Near":
            within = ports["within"]
            if not (isinstance(within, float) and within > 0.0):
                raise ArgumentError(f"within {within}: above 0 is required")
        case "Window":
            _check_window(ports)
        case _:
            pass


def _threshold(name: str, required: PortValue, children: int) -> int:
    """Return a threshold as a number of children; -1 means all, -2 all except one."""
    assert isinstance(required, int)
    meant = required if required >= 0 else children + 1 + required
    if not 1 <= meant <= children:
        raise ArgumentError(f"{name} {required}: there are {children} children")
    return meant


def _check_queue(loop: str, ports: dict[str, PortValue]) -> None:
    queue = ports["queue"]
    if not isinstance(queue, str):
        return
    parts = parts_of(queue)
    if not parts:
        raise ArgumentError("queue is empty: parts joined by ; are needed")
    if len(parts) > MAX_LOOP_CYCLES:
        raise ArgumentError(f"queue has {len(parts)} parts: {MAX_LOOP_CYCLES} at most")
    for part in parts:
        if "heading" not in part_values(loop, part) and "heading" in ports:
            raise ArgumentError(f"queue {part[:40]!r} has no heading: x,y,heading is needed")


def _check_question(ports: dict[str, PortValue]) -> None:
    for name in ("question", "options", "default"):
        if not isinstance(ports.get(name, ""), str):
            raise ArgumentError(f"{name} is a text that is known before the plan")
    options = parts_of(str(ports["options"]))
    if not 2 <= len(options) <= MAX_OPTIONS or len(set(options)) < len(options):
        raise ArgumentError(f"options: 2 to {MAX_OPTIONS} different texts joined by ; are needed")
    if "default" in ports:
        choice("default", str(ports["default"]), {each: each for each in options})


def _check_window(ports: dict[str, PortValue]) -> None:
    begin, end = ports.get("from"), ports.get("until")
    if begin is None and end is None:
        raise ArgumentError("Window needs from or until")
    if isinstance(begin, float) and isinstance(end, float) and begin >= end:
        raise ArgumentError("from is not before until: the window is never open")
