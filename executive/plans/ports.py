"""`PortReader` reads the ports of a node: literals, variables, scripts; `check_ports` its rules."""

from collections.abc import Mapping
from typing import Final, assert_never

from executive.commands import CommandDeclaration, Request
from executive.faults import FaultTable
from executive.plans.arguments import (
    ArgumentError,
    ArgumentValue,
    argument_value,
    check_length,
    count,
    number,
    quote,
    suggest,
    utc,
)
from executive.plans.blackboard import Scope, variable
from executive.plans.dialect import DEADLINE, NodeKind, Port, PortType
from executive.plans.model import LOOPS, CellReference, PortValue, part_values, parts_of
from executive.plans.scripting import Script, value_of

MAX_LOOP_CYCLES: Final = 1000
MAX_DEADLINE_S: Final = 86_400.0
MAX_OPTIONS: Final = 10

_STATUSES: Final = ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING")
_FLAGS: Final = {"true": True, "1": True, "false": False, "0": False}
_FAULTS: Final = tuple(FaultTable.__dataclass_fields__)


class PortReader:
    """The ports of one node.

    Args:
        texts: the texts that are given.
        scripts: the scripts among them, compiled.

    Raises:
        ArgumentError: from every method, if a port is not valid.
    """

    def __init__(
        self, kind: NodeKind, texts: Mapping[str, str], scope: Scope, scripts: Mapping[str, Script]
    ) -> None:
        self._kind = kind
        self._texts = texts
        self._scope = scope
        self._scripts = scripts
        self.deadline_s: float | None = None

    def ports(self) -> dict[str, PortValue]:
        """Return the values of all ports that are given or have a default."""
        found: dict[str, PortValue] = {}
        for port in self._kind.ports:
            text = self._texts.get(port.name, port.default)
            if text is None:
                if port.required:
                    raise ArgumentError(f"{self._kind.name} needs {port.name} ({port.meaning})")
                continue
            if port.argument is None:
                found[port.name] = self._value(port, check_length(port.name, text))
        if DEADLINE in found:
            deadline_s = found[DEADLINE]
            assert isinstance(deadline_s, float)
            if not 0.0 < deadline_s <= MAX_DEADLINE_S:
                bounds = f"above 0, {MAX_DEADLINE_S:g} at most"
                raise ArgumentError(f"{DEADLINE} {deadline_s:g}: {bounds}")
            self.deadline_s = deadline_s
        return found

    def command(
        self, declaration: CommandDeclaration
    ) -> tuple[tuple[ArgumentValue | CellReference | None, ...], Request | None]:
        """Return the arguments of a command, and its request if all are known."""
        values: list[ArgumentValue | CellReference | None] = []
        for argument in declaration.user_arguments:
            text = self._texts.get(argument.name)
            if text is None:
                values.append(None)
                continue
            found = self._literal(argument.name, text)
            if isinstance(found, str):
                values.append(argument_value(argument, check_length(argument.name, found)))
            else:
                values.append(found)
        if any(isinstance(each, CellReference) for each in values):
            return tuple(values), None
        return tuple(values), declaration.build_request(*values)

    def _literal(self, name: str, text: str) -> str | CellReference:
        """Return the text of a port, or the cell that it is read from."""
        wanted = variable(text, name)
        if wanted is None:
            return text
        try:
            cell = self._scope.resolve(wanted)
        except ValueError as error:
            raise ArgumentError(f"{name}: {error}") from error
        constant = self._scope.cells.constant(cell)
        if constant is not None:
            return constant
        if not self._scope.cells.has_value(cell):
            outer = self._scope.cells.name(cell).rpartition("/")[2]
            remapped = "" if outer == wanted else f", which is {{{outer[:40]}}} above"
            raise ArgumentError(f"{name}: no value given for {{{wanted[:40]}}}{remapped}")
        return CellReference(cell, wanted)

    def _known(self, name: str, text: str) -> str:
        found = self._literal(name, text)
        if isinstance(found, CellReference):
            remedy = "give a number, or an argument of the plan"
            raise ArgumentError(f"{name}: {{{found.name}}} is not known before the plan: {remedy}")
        return found

    def _value(self, port: Port, text: str) -> PortValue:
        name = port.name
        match port.type:
            case PortType.COUNT:
                return count(name, self._known(name, text))
            case PortType.MILLISECONDS:
                msec = count(name, self._known(name, text))
                if not 0 < msec <= MAX_DEADLINE_S * 1000:
                    bounds = f"above 0, {MAX_DEADLINE_S * 1000:.0f} at most"
                    raise ArgumentError(f"{name} {msec}: {bounds}")
                return msec
            case PortType.SECONDS:
                return number(name, self._known(name, text))
            case PortType.UTC:
                return utc(name, self._known(name, text))
            case PortType.STATUS:
                return _one_of(name, self._known(name, text), _STATUSES)
            case PortType.FLAG:
                return _FLAGS[_one_of(name, self._known(name, text).lower(), tuple(_FLAGS))]
            case PortType.NUMBER:
                found = self._literal(name, text)
                return number(name, found, port.meaning) if isinstance(found, str) else found
            case PortType.TEXT:
                return self._literal(name, text)
            case PortType.ANY:
                found = self._literal(name, text)
                return value_of(found) if isinstance(found, str) else found
            case PortType.CONDITION | PortType.STATEMENTS:
                return self._scripts[name]
            case PortType.WRITTEN_NUMBER | PortType.WRITTEN_TEXT | PortType.WRITTEN:
                wanted = variable(text, name) or text
                return CellReference(self._scope.resolve(wanted), wanted)
            case _:
                assert_never(port.type)


def _one_of(name: str, text: str, choices: tuple[str, ...]) -> str:
    if text not in choices:
        near = suggest(text, choices)
        raise ArgumentError(f"{name} {quote(text)}: {' or '.join(choices)} is required{near}")
    return text


def check_ports(kind: NodeKind, ports: dict[str, PortValue], children: int, limited: bool) -> None:
    """Check the rules of a kind of node, and count thresholds in children.

    Args:
        kind: the kind of node.
        ports: values of the ports; thresholds are replaced.
        children: number of its children.
        limited: whether the time is limited above the node.

    Raises:
        ArgumentError: a rule is violated.
    """
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
            _one_of("name", str(ports["name"]), _FAULTS)
        case "Near":
            if not _positive(ports["within"]):
                raise ArgumentError(f"within {ports['within']}: above 0 is required")
        case "Window":
            _check_window(ports)
        case _:
            pass


def _positive(value: PortValue) -> bool:
    return isinstance(value, float) and value > 0.0


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
        _one_of("default", str(ports["default"]), options)


def _check_window(ports: dict[str, PortValue]) -> None:
    begin, end = ports.get("from"), ports.get("until")
    if begin is None and end is None:
        raise ArgumentError("Window needs from or until")
    if isinstance(begin, float) and isinstance(end, float) and begin >= end:
        raise ArgumentError("from is not before until: the window is never open")
