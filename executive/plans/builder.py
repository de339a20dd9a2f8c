"""`check_plan` validates a whole plan and builds its nodes.

The first pass expands subtrees, checks the structure and numbers the variables; the types of these
are inferred; the second pass builds the nodes with their ports and scripts.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count
from typing import Final, NoReturn

from executive.commands import FollowPath, MoveTo, PlanArgument, PlanDefinition, Request, Waypoint
from executive.commands.intake import check_arguments
from executive.plans.arguments import ArgumentError, check_length, quote, suggest
from executive.plans.blackboard import CellTable, Scope, variable
from executive.plans.dialect import CONDITIONS, DIALECT, ROOT_KIND, NodeKind, PortType, Role
from executive.plans.model import NodeLocation, PlanNode, PlanRoot, PlanStep, steps
from executive.plans.nominal import max_commands
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
from executive.plans.ports import PortReader, check_ports
from executive.plans.scripting import (
    NUMBER,
    TEXT,
    Script,
    Types,
    ValueType,
    compile_script,
    infer,
    type_of,
    value_of,
)
from executive.plans.syntax import ASSIGNMENTS, NAME, Expression, ScriptError, expressions, parse
from executive.settings import Settings
from executive.values.geometry import Point
from executive.values.reasons import Reason, Refusal

MAX_NODES: Final = 500
MAX_COMMANDS: Final = 10_000
"""Maximum number of commands of a plan, if all its loops run to their limit; chosen."""


@dataclass(slots=True)
class Site:
    """A node between the two passes.

    Attributes:
        limited: whether a Timeout, or a Window with an end, is above it.
        texts: texts of its ports.
        scripts: syntax trees of its scripts, by attribute.
    """

    location: NodeLocation
    element: Element
    kind: NodeKind
    scope: Scope
    limited: bool
    texts: dict[str, str] = field(default_factory=dict)
    scripts: dict[str, tuple[Expression, ...]] = field(default_factory=dict)
    children: list["Site"] = field(default_factory=list)

    def fail(self, text: str, reason: Reason = Reason.PLAN_BAD_ARGUMENT) -> NoReturn:
        """Raise an error on this node."""
        raise PlanError(reason, self.location.line, text)

    def sites(self) -> Iterator["Site"]:
        """Yield this node and all below it."""
        yield self
        for child in self.children:
            yield from child.sites()


class _Expansion:
    """The first pass."""

    def __init__(
        self,
        trees: Mapping[str, Element],
        defaults: Mapping[str, Mapping[str, str]],
        kinds: Mapping[str, NodeKind],
    ) -> None:
        self._trees = trees
        self._defaults = defaults
        self._kinds = kinds
        self._count = 0

    def root(self, tree: str, path: str, scope: Scope) -> Site:
        """Return the root of a plan, which runs a tree."""
        element = self._trees[tree]
        site = Site(self._location(path, element), element, ROOT_KIND, scope, limited=False)
        site.children = self._children(site, element.children, scope, (tree,), limited=False)
        return site

    def _children(
        self,
        site: Site,
        elements: Iterable[Element],
        scope: Scope,
        above: tuple[str, ...],
        limited: bool,
    ) -> list[Site]:
        taken: set[str] = set()
        again: defaultdict[str, Iterator[int]] = defaultdict(lambda: count(2))
        found = []
        for element in elements:
            kind = node_kind(element, self._trees, self._kinds)
            default = element.attributes["ID"] if kind is None else kind.name
            first = name_of(element, default)
            name = first
            while name in taken:
                name = f"{first} {next(again[first])}"
            taken.add(name)
            location = self._location(f"{site.location.path}/{name}", element)
            child = Site(location, element, kind or ROOT_KIND, scope, limited)
            child.texts = ports_of(element)
            if child.kind.port("name") is not None and "name" in element.attributes:
                child.texts["name"] = element.attributes["name"]
            self._read_scripts(child)
            if kind is None:
                self._expand_subtree(child, above)
            else:
                self._expand(child, kind, above)
            found.append(child)
        return found

    def _expand(self, site: Site, kind: NodeKind, above: tuple[str, ...]) -> None:
        given, low, high = len(site.element.children), kind.min_children, kind.max_children
        if given < low or (high is not None and given > high):
            plural = "ren" if low > 1 else ""
            match (low, high):
                case (0, 0):
                    text = f"{kind.name} has no children"
                case (_, None):
                    text = f"{kind.name} needs at least {low} child{plural}"
                case _ if low == high:
                    text = f"{kind.name} has exactly {low} child{plural}"
                case _:
                    text = f"{kind.name} has {low} to {high} children"
            site.fail(text, _STRUCTURE)
        names = [each.name for each in kind.ports]
        for name in site.texts:
            if name not in names:
                site.fail(f"unknown attribute {quote(name)}{suggest(name, sorted(names))}")
        self._note_outputs(site)
        ends = kind.name == "Timeout" or (kind.name == "Window" and "until" in site.texts)
        site.children = self._children(
            site, site.element.children, site.scope, above, site.limited or ends
        )

    def _expand_subtree(self, site: Site, above: tuple[str, ...]) -> None:
        tree, texts = site.element.attributes["ID"], site.texts
        if site.element.children:
            site.fail("<SubTree> has no children", _STRUCTURE)
        if tree in above:
            site.fail(f"tree {tree[:40]!r} contains itself", _STRUCTURE)
        autoremap = site.element.attributes.get(AUTOREMAP, "false").lower() in {"true", "1"}
        label = f"{site.location.path.partition('/')[2]}/"
        inner = Scope(site.scope.cells, label, site.scope, autoremap)
        given = texts if autoremap else {**self._defaults.get(tree, {}), **texts}
        for name, text in given.items():
            outer = variable(text, name)
            if outer is not None:
                _cell(site, name, outer)
            inner.set(name, text)
        site.texts = {}
        children = self._trees[tree].children
        site.children = self._children(site, children, inner, (*above, tree), site.limited)

    def _note_outputs(self, site: Site) -> None:
        cells = site.scope.cells
        for port in site.kind.ports:
            if not port.type.is_output or port.name not in site.texts:
                continue
            text = site.texts[port.name]
            name = variable(text, port.name)
            if name is None and port.name != "output_key":
                site.fail(f"{port.name} {quote(text)}: a variable in braces, as {{x}}, is needed")
            cell = _cell(site, port.name, name or text)
            if cell in cells.telemetry:
                site.fail(f"{port.name}: {cells.telemetry[cell]} is telemetry, and is not written")
            cells.created.add(cell)
            cells.changed.add(cell)

    def _read_scripts(self, site: Site) -> None:
        texts = {each: site.element.attributes.get(each) for each in CONDITIONS}
        for port in site.kind.ports:
            if port.type.is_script:
                texts[port.name] = site.texts.get(port.name)
        cells = site.scope.cells
        for attribute, text in texts.items():
            if text is None:
                continue
            try:
                found = parse(check_length(attribute, text), site.scope.resolve)
            except ArgumentError as error:
                site.fail(str(error))
            except ScriptError as error:
                site.fail(f"{attribute}: {error}")
            if not found:
                site.fail(f"{attribute} is empty: a script is needed")
            site.scripts[attribute] = found
            for each in expressions(found):
                if each.sign in ASSIGNMENTS:
                    if each.cell in cells.telemetry:
                        column = f"{attribute}: column {each.column}"
                        site.fail(f"{column}: {each.text} is telemetry, and is not written")
                    cells.changed.add(each.cell)
                    if each.sign == ":=":
                        cells.created.add(each.cell)

    def _location(self, path: str, element: Element) -> NodeLocation:
        if self._count == MAX_NODES:
            text = f"a plan has {MAX_NODES} nodes at most"
            raise element.error(Reason.PLAN_TOO_LARGE, text)
        if path.count("/") > MAX_DEPTH:
            text = f"a plan is {MAX_DEPTH} deep at most"
            raise element.error(Reason.PLAN_TOO_LARGE, text)
        location = NodeLocation(self._count, path, element.line)
        self._count += 1
        return location


_STRUCTURE: Final = Reason.PLAN_STRUCTURE


def _cell(site: Site, attribute: str, name: str) -> int:
    try:
        return site.scope.resolve(name)
    except ValueError as error:
        site.fail(f"{attribute}: {error}")


def _infer_types(root: Site, cells: CellTable) -> None:
    """Raise PlanError where a variable or an expression mixes types."""
    types = cells.types()
    sites = tuple(root.sites())
    for site in sites:
        for port in site.kind.ports:
            if port.type.is_output and port.name in site.texts and port.type in _WRITTEN:
                _unite(site, port.name, _WRITTEN[port.type], types)
    while True:
        before = list(types)
        for site in sites:
            _infer_site(site, types)
        if before == types:
            return


_WRITTEN: Final = {PortType.WRITTEN_NUMBER: NUMBER, PortType.WRITTEN_TEXT: TEXT}


def _infer_site(site: Site, types: Types) -> None:
    for attribute, statements in site.scripts.items():
        try:
            for each in statements:
                infer(each, types)
        except ScriptError as error:
            site.fail(f"{attribute}: {error}")
    if site.kind.name == "SetBlackboard" and "value" in site.texts:
        name = variable(site.texts["value"], "value")
        if name is None:
            _unite(site, "output_key", type_of(value_of(site.texts["value"])), types)
        elif (found := types[site.scope.resolve(name)]) is not None:
            _unite(site, "output_key", found, types)


def _unite(site: Site, port: str, kind: ValueType, types: Types) -> None:
    if port not in site.texts:
        return
    cell = site.scope.resolve(variable(site.texts[port], port) or site.texts[port])
    if types[cell] not in {None, kind}:
        before = types[cell]
        assert before is not None
        name = site.scope.cells.name(cell)
        site.fail(f"{port}: {name} is {before.value}, and gets {kind.value}: use another name")
    types[cell] = kind


def _check_reads(root: Site, cells: CellTable) -> None:
    """Raise PlanError where a script reads a variable that nothing sets."""
    for site in root.sites():
        for attribute, statements in site.scripts.items():
            for each in expressions(statements):
                if each.cell < 0 or cells.has_value(each.cell):
                    continue
                text, where = each.text, f"{attribute}: column {each.column}"
                if each.sign == NAME:
                    site.fail(f"{where}: nothing sets {text}{_remedy(site.scope, text)}")
                site.fail(f"{where}: {text} does not exist before {each.sign!r}: use :=")


def _remedy(scope: Scope, name: str) -> str:
    from executive.plans.dialect import TELEMETRY

    if name in TELEMETRY:
        return f": telemetry is @{name}"
    return suggest(name.removeprefix("@"), [*sorted(scope.used - {name}), *TELEMETRY])


class _Construction:
    """The second pass."""

    def __init__(self, cells: CellTable) -> None:
        self._cells = cells

    def node(self, site: Site) -> PlanNode:
        """Return a node with all below it."""
        children = tuple(self.node(each) for each in site.children)
        scripts = {
            each: compile_script(site.element.attributes.get(each) or site.texts[each], found)
            for each, found in site.scripts.items()
        }
        conditions: dict[str, Script] = {}
        for each in CONDITIONS:
            if each in scripts:
                conditions[each] = scripts.pop(each)
        if site.kind.role is Role.SUBTREE:
            return PlanNode(site.location, site.kind, children, {}, conditions)
        reader = PortReader(site.kind, site.texts, site.scope, scripts)
        try:
            ports = reader.ports()
            check_ports(site.kind, ports, len(children), site.limited)
            node = PlanNode(site.location, site.kind, children, ports, conditions)
            command = site.kind.command
            values, request = ((), None) if command is None else reader.command(command)
            if site.kind.needs_limit and reader.deadline_s is None and not site.limited:
                above = "give deadline_s, or put it below a Timeout"
                site.fail(f"{site.kind.name} has no deadline: {above}", Reason.PLAN_NO_DEADLINE)
            if command is None:
                return node
            return PlanStep(
                site.location,
                site.kind,
                children,
                ports,
                conditions,
                values,
                reader.deadline_s,
                request,
            )
        except ArgumentError as error:
            site.fail(str(error))


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
        if step.request is None:
            continue
        refusal = check_arguments(step.request, settings, _from(step.request))
        if refusal is not None:
            line = step.location.line
            fault = PlanError(Reason.PLAN_BAD_ARGUMENT, line, refusal.text, refusal.figures)
            return fault.refusal
    return None


def read_plan(definition: PlanDefinition) -> PlanRoot | Refusal:
    """Return the root node of a plan that is valid apart from the bounds of an asset."""
    try:
        plan = _read(definition, DIALECT)
        if not steps(plan):
            text = "the plan has no command"
            raise PlanError(Reason.PLAN_STRUCTURE, plan.location.line, text)
        if max_commands(plan) > MAX_COMMANDS:
            text = f"its loops could command {max_commands(plan)} times: {MAX_COMMANDS} at most"
            raise PlanError(Reason.PLAN_TOO_LARGE, plan.location.line, text)
        return plan
    except PlanError as fault:
        return fault.refusal


def read_tree(definition: PlanDefinition, kinds: Mapping[str, NodeKind]) -> PlanRoot | Refusal:
    """Return the root node of a tree of these kinds of nodes, which may be without a command."""
    try:
        return _read(definition, kinds)
    except PlanError as fault:
        return fault.refusal


def _read(definition: PlanDefinition, kinds: Mapping[str, NodeKind]) -> PlanRoot:
    if not is_plan_id(definition.plan_id):
        raise PlanError(
            Reason.BAD_IDENTIFIER, None, "a plan id has 1 to 64 letters, digits or any of _ . -"
        )
    if definition.format != FORMAT:
        raise PlanError(
            Reason.PLAN_FORMAT, None, f"unknown format {definition.format[:40]!r}: use {FORMAT}"
        )
    root = read_xml(definition.content)
    trees = trees_of(root)
    for tree in trees.values():
        for element in tree.children[0].elements():
            node_kind(element, trees, kinds)
    cells = CellTable()
    scope = Scope(cells)
    for argument in definition.arguments:
        scope.set(argument.name, argument.text)
    expansion = _Expansion(trees, subtree_defaults(root), kinds)
    site = expansion.root(main_tree(root, trees), f"plan:{definition.plan_id}", scope)
    _require_used(definition.arguments, root.children, scope)
    _check_reads(site, cells)
    _infer_types(site, cells)
    built = _Construction(cells).node(site)
    return PlanRoot(
        built.location,
        built.kind,
        built.children,
        built.ports,
        built.conditions,
        cells.blackboard(),
        resumes_after_restart(root),
    )


def _require_used(
    arguments: Iterable[PlanArgument], trees: Iterable[Element], scope: Scope
) -> None:
    """Raise PlanError for an argument that no node reads, probably misspelt."""
    read_there = {name for tree in trees for name in _names_in(tree)} | scope.used
    for argument in arguments:
        name = argument.name
        if name not in read_there:
            text = f"no node reads the argument {quote(name)}"
            near = suggest(name, sorted(read_there))
            raise PlanError(Reason.PLAN_BAD_ARGUMENT, None, text + near)


def _names_in(element: Element) -> Iterator[str]:
    for each in element.elements():
        for attribute, text in each.attributes.items():
            name = variable(text, attribute)
            if name is not None:
                yield name


def _from(request: Request) -> Point:
    """Return a position at zero distance from the target."""
    match request:
        case MoveTo(Waypoint(x_m, y_m)) | FollowPath((Waypoint(x_m, y_m), *_)):
            return Point(x_m, y_m)
        case _:
            return Point(0.0, 0.0)
