"""`check_plan` validates a whole plan and builds its nodes.

Subtrees are expanded, and nodes and variables numbered; the types of the variables are inferred;
then the ports of the nodes are read.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Final

from executive.commands import FollowPath, MoveTo, PlanArgument, PlanDefinition, Request, Waypoint
from executive.commands.intake import check_arguments
from executive.plans.arguments import check_length, quote, suggest
from executive.plans.blackboard import CellTable, Scope, variable
from executive.plans.dialect import (
    CONDITIONS,
    DEADLINE,
    ROOT_KIND,
    TELEMETRY,
    NodeKind,
    PortType,
    Role,
)
from executive.plans.model import NodeLocation, PlanNode, PlanRoot, PlanStep, steps
from executive.plans.nominal import max_leaves
from executive.plans.plan_xml import (
    AUTOREMAP,
    FORMAT,
    MAX_DEPTH,
    Element,
    PlanError,
    is_plan_id,
    main_tree,
    name_of,
    node_kind,
    ports_of,
    read_xml,
    resumes_after_restart,
    subtree_defaults,
    trees_of,
)
from executive.plans.ports import read_ports
from executive.plans.scripting import (
    NUMBER,
    TEXT,
    Types,
    ValueType,
    compile_script,
    infer,
    type_of,
    value_of,
)
from executive.plans.syntax import (
    ASSIGNMENTS,
    NAME,
    ArgumentError,
    Expression,
    ScriptError,
    expressions,
    parse,
)
from executive.settings import Settings
from executive.values.geometry import Point
from executive.values.reasons import Reason, Refusal

MAX_NODES: Final = 500
MAX_CELLS: Final = 1000
MAX_EXPRESSIONS: Final = 10_000
"""Maximum numbers of variables and operations of scripts, with expanded subtrees; chosen."""
MAX_COMMANDS: Final = 10_000
"""Maximum number of commands of a plan, if all its loops run to their limit; chosen."""


@dataclass(frozen=True, slots=True)
class _Level:
    """Names, trees and time limit that a node is below."""

    scope: Scope
    trees: tuple[str, ...]
    limited: bool = False


@dataclass(frozen=True, slots=True)
class _Draft:
    """A node before its ports are read; `texts` has these, `scripts` its scripts by attribute."""

    node: PlanNode
    element: Element
    level: _Level
    texts: Mapping[str, str]
    scripts: Mapping[str, tuple[Expression, ...]]

    @property
    def scope(self) -> Scope:
        """The names that it uses."""
        return self.level.scope

    @property
    def cells(self) -> frozenset[int]:
        """The cells that its scripts read or set, or that `SetBlackboard` copies."""
        found = {each.cell for script in self.scripts.values() for each in expressions(script)}
        copied = variable(self.texts.get("value", ""), "value")
        if copied is not None and self.node.kind.name == "SetBlackboard":
            found.add(self.scope.resolve(copied))
        return frozenset(found - {-1})

    def finish(self) -> None:
        """Read the ports."""
        node, kind = self.node, self.node.kind
        for attribute, found in self.scripts.items():
            text = self.element.attributes[attribute]
            into = node.conditions if attribute in CONDITIONS else node.ports
            into[attribute] = compile_script(text, found)
        if kind.role is not Role.SUBTREE:
            read_ports(node, self.texts, self.scope, self.level.limited)
        if kind.needs_limit and DEADLINE not in node.ports and not self.level.limited:
            text = f"{kind.name} has no deadline: give deadline_s, or put it below a Timeout"
            raise self.element.error(Reason.PLAN_NO_DEADLINE, text)


class _Expansion:
    """Expands subtrees, and numbers nodes and variables.

    Attributes:
        drafts: the nodes.
        subtrees: inner scope and ports of each `SubTree`, with its element.
    """

    def __init__(
        self, trees: Mapping[str, Element], defaults: Mapping[str, Mapping[str, str]]
    ) -> None:
        self.drafts: list[_Draft] = []
        self.subtrees: list[tuple[Element, Scope, Mapping[str, str]]] = []
        self._trees = trees
        self._defaults = defaults
        self._count = self._operations = 0

    def tree(self, name: str, path: str, scope: Scope) -> PlanNode:
        """Return the root of a plan, which runs a tree."""
        element = self._trees[name]
        location = self._location(path, element)
        children = self._children(element, location, _Level(scope, (name,)))
        return PlanNode(location, ROOT_KIND, children, {}, {})

    def _children(
        self, parent: Element, location: NodeLocation, level: _Level
    ) -> tuple[PlanNode, ...]:
        taken: set[str] = set()
        again: defaultdict[str, Iterator[int]] = defaultdict(lambda: count(2))
        found = []
        for element in parent.children:
            kind = node_kind(element, self._trees)
            first = name_of(element, element.attributes.get("ID") or kind.name)
            name = first
            while name in taken:
                name = f"{first} {next(again[first])}"
            taken.add(name)
            at = self._location(f"{location.path}/{name}", element)
            with element.located():
                found.append(self._node(element, kind, at, level))
        return tuple(found)

    def _node(
        self, element: Element, kind: NodeKind, location: NodeLocation, level: _Level
    ) -> PlanNode:
        texts, scripts = ports_of(element), _scripts(element, kind, level.scope)
        if kind.port("name") is not None and "name" in element.attributes:
            texts["name"] = element.attributes["name"]
        self._check_size(element, level.scope.cells, scripts)
        below, inner = element, level
        if kind.role is Role.SUBTREE:
            tree = element.attributes["ID"]
            if tree in level.trees:
                raise element.error(_STRUCTURE, f"tree {tree[:40]!r} contains itself")
            scope = self._subtree_scope(element, location, texts, level.scope)
            below, inner = self._trees[tree], _Level(scope, (*level.trees, tree), level.limited)
        else:
            _check_structure(element, kind, texts)
            _note_outputs(kind, texts, level.scope)
            if kind.name == "Timeout" or (kind.name == "Window" and "until" in texts):
                inner = replace(level, limited=True)
        make = PlanNode if kind.command is None else PlanStep
        node = make(location, kind, self._children(below, location, inner), {}, {})
        self.drafts.append(_Draft(node, element, level, texts, scripts))
        return node

    def _subtree_scope(
        self, element: Element, location: NodeLocation, texts: Mapping[str, str], scope: Scope
    ) -> Scope:
        if element.children:
            raise element.error(_STRUCTURE, "<SubTree> has no children")
        autoremap = element.attributes.get(AUTOREMAP, "false").lower() in {"true", "1"}
        inner = Scope(scope.cells, f"{location.path.partition('/')[2]}/", scope, autoremap)
        defaults = {} if autoremap else self._defaults.get(element.attributes["ID"], {})
        self.subtrees.append((element, inner, texts))
        for name, text in {**defaults, **texts}.items():
            outer = variable(text, name)
            if outer is not None:
                scope.cell_of(name, outer)
            inner.set(name, text)
            self._check_size(element, scope.cells, {})
        return inner

    def _check_size(
        self, element: Element, cells: CellTable, scripts: Mapping[str, tuple[Expression, ...]]
    ) -> None:
        self._operations += sum(sum(1 for _ in expressions(each)) for each in scripts.values())
        _bound(element, len(cells.texts), MAX_CELLS, "has {} variables")
        _bound(element, self._operations, MAX_EXPRESSIONS, "has {} operations in scripts")

    def _location(self, path: str, element: Element) -> NodeLocation:
        _bound(element, self._count + 1, MAX_NODES, "has {} nodes")
        _bound(element, path.count("/"), MAX_DEPTH, "is {} deep")
        location = NodeLocation(self._count, path, element.line)
        self._count += 1
        return location


def _bound(element: Element, number: int, high: int, text: str) -> None:
    if number > high:
        raise element.error(Reason.PLAN_TOO_LARGE, f"a plan {text.format(high)} at most")


_STRUCTURE: Final = Reason.PLAN_STRUCTURE
_ARGUMENT: Final = Reason.PLAN_BAD_ARGUMENT


def _check_structure(element: Element, kind: NodeKind, texts: Mapping[str, str]) -> None:
    given, low, high = len(element.children), kind.min_children, kind.max_children
    if given < low or (high is not None and given > high):
        number = f"exactly {low}" if low == high else f"{low} to {high}"
        number = f"at least {low}" if high is None else number if high else "no"
        verb = "needs" if high is None else "has"
        plural = "" if (low, high) in {(1, 1), (1, None)} else "ren"
        raise element.error(_STRUCTURE, f"{kind.name} {verb} {number} child{plural}")
    names = sorted(each.name for each in kind.ports)
    for name in texts:
        if name not in names:
            near = suggest(name, names) or ": remove it"
            raise ArgumentError(f"unknown attribute {quote(name)}{near}")


def _scripts(element: Element, kind: NodeKind, scope: Scope) -> dict[str, tuple[Expression, ...]]:
    names, cells = [each.name for each in kind.ports if each.type.is_script], scope.cells
    found = {}
    for attribute in (*CONDITIONS, *names):
        text = element.attributes.get(attribute)
        if text is None:
            continue
        check_length(attribute, text)
        try:
            found[attribute] = parse(text, scope.resolve)
        except ScriptError as error:
            raise ArgumentError(f"{attribute}: {error}") from error
        if not found[attribute]:
            raise ArgumentError(f"{attribute} is empty: a script is needed")
        for each in expressions(found[attribute]):
            if each.sign in ASSIGNMENTS:
                cells.changed.add(each.cell)
                if each.cell in cells.telemetry:
                    text = f"{attribute}: column {each.column}: {each.text} is telemetry"
                    raise ArgumentError(f"{text}, and is not written")
            if each.sign == ":=":
                cells.created.add(each.cell)
    return found


def _note_outputs(kind: NodeKind, texts: Mapping[str, str], scope: Scope) -> None:
    cells = scope.cells
    copied = variable(texts.get("value", ""), "value")
    if copied is not None and kind.name == "SetBlackboard":
        scope.cell_of("value", copied)
    for port in kind.ports:
        if not port.type.is_output or port.name not in texts:
            continue
        text = texts[port.name]
        name = variable(text, port.name)
        if name is None and port.name != "output_key":
            needed = "a variable in braces, as {x}, is needed"
            raise ArgumentError(f"{port.name} {quote(text)}: {needed}")
        cell = scope.cell_of(port.name, name or text)
        if cell in cells.telemetry:
            text = f"{port.name}: {cells.telemetry[cell]} is telemetry, and is not written"
            raise ArgumentError(text)
        cells.created.add(cell)
        cells.changed.add(cell)


_WRITTEN: Final = {PortType.WRITTEN_NUMBER: NUMBER, PortType.WRITTEN_TEXT: TEXT}


def _infer_types(drafts: Sequence[_Draft], cells: CellTable) -> Types:
    types = cells.types()
    for draft in drafts:
        with draft.element.located():
            for port in draft.node.kind.ports:
                if port.type in _WRITTEN:
                    _unite(draft, port.name, _WRITTEN[port.type], types)
    waiting: defaultdict[int, list[_Draft]] = defaultdict(list)
    pending = list(drafts)
    while pending:
        before = list(types)
        for draft in pending:
            with draft.element.located():
                _infer_draft(draft, types)
            for cell in draft.cells:
                if types[cell] is None:
                    waiting[cell].append(draft)
        known = [cell for cell in range(len(types)) if before[cell] is None and types[cell]]
        found = {id(each): each for cell in known for each in waiting.pop(cell, ())}
        pending = list(found.values())
    return types


def _infer_draft(draft: _Draft, types: Types) -> None:
    for attribute, statements in draft.scripts.items():
        try:
            for each in statements:
                infer(each, types)
        except ScriptError as error:
            raise ArgumentError(f"{attribute}: {error}") from error
    if draft.node.kind.name == "SetBlackboard" and "value" in draft.texts:
        text = draft.texts["value"]
        name = variable(text, "value")
        found = type_of(value_of(text)) if name is None else types[draft.scope.resolve(name)]
        if found is not None:
            _unite(draft, "output_key", found, types)


def _unite(draft: _Draft, port: str, kind: ValueType, types: Types) -> None:
    if port not in draft.texts:
        return
    cell = draft.scope.resolve(variable(draft.texts[port], port) or draft.texts[port])
    before, name = types[cell], draft.scope.cells.names[cell]
    if before is not None and before is not kind:
        text = f"{port}: {name} is {before.value}, and gets {kind.value}: use another name"
        raise ArgumentError(text)
    types[cell] = kind


def _check_reads(draft: _Draft) -> None:
    for attribute, statements in draft.scripts.items():
        for each in expressions(statements):
            if each.cell < 0 or draft.scope.cells.has_value(each.cell):
                continue
            text = f"{attribute}: column {each.column}: "
            if each.sign == NAME:
                text += f"nothing sets {each.text}{_remedy(draft.scope, each.text)}"
            else:
                text += f"{each.text} does not exist before {each.sign!r}: use :="
            raise ArgumentError(text)


def _remedy(scope: Scope, name: str) -> str:
    if name in TELEMETRY:
        return f": telemetry is @{name}"
    known = sorted(scope.used - {name, name.removeprefix("@")})
    return suggest(name, [*known, *(f"@{each}" for each in TELEMETRY)])


def check_plan(definition: PlanDefinition, settings: Settings) -> PlanRoot | Refusal:
    """Return the root node of a valid plan, or a refusal.

    Arguments are checked against the asset's bounds, except bounds that depend on the rover's
    position, and arguments from the blackboard: they are checked when the command is due.
    """
    plan = read_plan(definition)
    if isinstance(plan, Refusal):
        return plan
    return check_bounds(plan, settings) or plan


def check_bounds(plan: PlanNode, settings: Settings) -> Refusal | None:
    """Return a refusal if an argument of a plan is outside the bounds of an asset."""
    for step in steps(plan):
        request, line = step.request, step.location.line
        if request and (refusal := check_arguments(request, settings, _from(request))):
            text, figures = refusal.text, refusal.figures
            return PlanError(Reason.PLAN_BAD_ARGUMENT, line, text, figures).refusal
    return None


def read_plan(definition: PlanDefinition) -> PlanRoot | Refusal:
    """Return the root node of a plan that is valid apart from the bounds of an asset."""
    try:
        plan = _read(definition)
        if not steps(plan):
            text = "the plan has no command"
            raise PlanError(Reason.PLAN_STRUCTURE, plan.location.line, text)
        if max_leaves(plan) > MAX_COMMANDS:
            text = f"its loops could execute {max_leaves(plan)} leaves: {MAX_COMMANDS} at most"
            raise PlanError(Reason.PLAN_TOO_LARGE, plan.location.line, text)
        return plan
    except PlanError as fault:
        return fault.refusal


def _read(definition: PlanDefinition) -> PlanRoot:
    if not is_plan_id(definition.plan_id):
        text = "a plan id has 1 to 64 letters, digits or any of _ . -"
        raise PlanError(Reason.BAD_IDENTIFIER, None, text)
    if definition.format != FORMAT:
        text = f"unknown format {definition.format[:40]!r}: use {FORMAT}"
        raise PlanError(Reason.PLAN_FORMAT, None, text)
    root = read_xml(definition.content)
    trees = trees_of(root)
    for tree in trees.values():
        for element in tree.children[0].elements():
            node_kind(element, trees)
    cells = CellTable()
    scope = Scope(cells)
    for argument in definition.arguments:
        scope.set(argument.name, argument.text)
    expansion = _Expansion(trees, subtree_defaults(root))
    main = main_tree(root, trees)
    built = expansion.tree(main, f"plan:{definition.plan_id}", scope)
    _require_used(definition.arguments, root.children, scope)
    for argument in definition.arguments:
        if argument.name in scope.measured & TELEMETRY.keys():
            text = f"a script reads the telemetry @{argument.name}: rename the argument"
            raise PlanError(_ARGUMENT, None, text)
    drafts = sorted(expansion.drafts, key=lambda each: each.node.location.number)
    for draft in drafts:
        with draft.element.located():
            _check_reads(draft)
    types = _infer_types(drafts, cells)
    for draft in drafts:
        with draft.element.located():
            draft.finish()
    board, resumes = cells.blackboard(types), resumes_after_restart(root)
    unused = tuple(_unused(trees, main, expansion.subtrees))
    return PlanRoot(built.location, built.kind, built.children, {}, {}, board, resumes, unused)


def _unused(
    trees: Mapping[str, Element],
    main: str,
    subtrees: Iterable[tuple[Element, Scope, Mapping[str, str]]],
) -> Iterator[tuple[int, str]]:
    for name in trees.keys() - {main, *(each.attributes["ID"] for each, *_ in subtrees)}:
        text = f"nothing runs the tree {name}: remove it, or run it by a SubTree"
        yield trees[name].line, text
    for element, inner, texts in subtrees:
        for name in texts.keys() - inner.used:
            near = suggest(name, sorted(inner.used)) or ": remove it"
            text = f"the tree {element.attributes['ID']} does not read {name}{near}"
            yield element.line, text


def _require_used(
    arguments: Iterable[PlanArgument], trees: Iterable[Element], scope: Scope
) -> None:
    attributes = (
        each for tree in trees for element in tree.elements() for each in element.attributes.items()
    )
    read_there = {variable(text, name) for name, text in attributes} - {None} | scope.used
    for argument in arguments:
        if argument.name not in read_there:
            near = suggest(argument.name, sorted(filter(None, read_there)))
            text = f"no node reads the argument {quote(argument.name)}{near}"
            raise PlanError(Reason.PLAN_BAD_ARGUMENT, None, text)


def _from(request: Request) -> Point:
    """Return a position at zero distance from the target."""
    match request:
        case MoveTo(Waypoint(x_m, y_m)) | FollowPath((Waypoint(x_m, y_m), *_)):
            return Point(x_m, y_m)
        case _:
            return Point(0.0, 0.0)
