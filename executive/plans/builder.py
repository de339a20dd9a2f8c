"""`check_plan` validates a whole plan and builds its nodes: expands subtrees, checks attributes."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count
from typing import Final

from executive.commands import (
    CommandDeclaration,
    FollowPath,
    MoveTo,
    PlanArgument,
    PlanDefinition,
    Request,
    Waypoint,
)
from executive.commands.intake import check_arguments
from executive.plans.model import (
    DEADLINE,
    LEAVES,
    FallbackNode,
    InverterNode,
    LoopNode,
    NodeLocation,
    ParallelNode,
    PlanNode,
    PlanStep,
    RepeatOn,
    SequenceNode,
    TimeoutNode,
    attribute_help,
    children_of,
    steps,
)
from executive.plans.plan_xml import (
    CONTROLS,
    DECORATORS,
    FORMAT,
    MAX_DEPTH,
    SUBTREE,
    Attributes,
    Element,
    PlanError,
    is_plan_id,
    name_of,
    node_kind,
    quote,
    read_xml,
    suggest,
)
from executive.settings import Settings
from executive.values.geometry import Point
from executive.values.reasons import Reason, Refusal

MAX_NODES: Final = 500
MAX_LOOP_CYCLES: Final = 1000
MAX_DEADLINE_S: Final = 86_400.0


@dataclass(frozen=True, slots=True)
class _BuildContext:
    """Context of a node that is built.

    Attributes:
        location: location of the node, or of its parent.
        arguments: the values of `{names}` in its tree.
        trees: the enclosing trees, outermost first.
        limited: whether a Timeout is above it.
    """

    location: NodeLocation
    element: Element
    arguments: Mapping[str, str]
    trees: tuple[str, ...]
    limited: bool

    @property
    def attributes(self) -> Attributes:
        """The attributes of the element, resolved in this context."""
        return Attributes(self.element, self.arguments)

    def error(self, text: str) -> PlanError:
        """Return an error on the plan's structure at this element."""
        return PlanError(Reason.PLAN_STRUCTURE, self.location.line, text)


class PlanBuilder:
    """Builds the nodes of one plan.

    Args:
        trees: the `BehaviorTree` elements by ID.
        defaults: port defaults of each `SubTree`, by ID.
        root: name of the root of all paths.
    """

    def __init__(
        self, trees: Mapping[str, Element], defaults: Mapping[str, Mapping[str, str]], root: str
    ) -> None:
        self._trees = trees
        self._defaults = defaults
        self._root = root
        self._count = 0

    def build(self, tree: str, given: Mapping[str, str]) -> PlanNode:
        """Return the root node of a tree by its ID, with the plan's arguments.

        Raises:
            PlanError: it is not valid.
        """
        element = self._trees[tree]
        location = self._location(self._root, element)
        return self._tree(_BuildContext(location, element, given, (tree,), limited=False))

    def _tree(self, site: _BuildContext) -> SequenceNode:
        children = self._trees[site.trees[-1]].children
        return SequenceNode(site.location, self._children(site, children))

    def _children(self, site: _BuildContext, elements: Iterable[Element]) -> tuple[PlanNode, ...]:
        taken: set[str] = set()
        again: defaultdict[str, Iterator[int]] = defaultdict(lambda: count(2))
        nodes = []
        for element in elements:
            kind = node_kind(element, self._trees, LEAVES)
            first = name_of(element, element.attributes["ID"] if kind == SUBTREE else kind)
            name = first
            while name in taken:
                name = f"{first} {next(again[first])}"
            taken.add(name)
            location = self._location(f"{site.location.path}/{name}", element)
            nodes.append(self._node(kind, replace(site, location=location, element=element)))
        return tuple(nodes)

    def _node(self, kind: str, site: _BuildContext) -> PlanNode:
        if kind == SUBTREE:
            return self._subtree(site)
        if kind in CONTROLS:
            return self._control(kind, site)
        if kind in DECORATORS:
            return self._decorator(kind, site)
        if site.element.children:
            raise site.error(f"{kind} has no children")
        return _step(LEAVES[kind], site)

    def _subtree(self, site: _BuildContext) -> PlanNode:
        tree = site.element.attributes["ID"]
        if site.element.children:
            raise site.error("<SubTree> has no children")
        if tree in site.trees:
            raise site.error(f"tree {tree[:40]!r} contains itself")
        given = site.attributes.forwarded(self._defaults.get(tree, {}))
        return self._tree(replace(site, arguments=given, trees=(*site.trees, tree)))

    def _control(self, kind: str, site: _BuildContext) -> PlanNode:
        location, attributes = site.location, site.attributes
        if not site.element.children:
            raise site.error(f"{kind} needs at least 1 child")
        attributes.require_known(
            {"success_count", "failure_count"} if kind == "Parallel" else set()
        )
        children = self._children(site, site.element.children)
        if kind == "Parallel":
            successes = _threshold(attributes, "success_count", -1, len(children))
            failures = _threshold(attributes, "failure_count", 1, len(children))
            return ParallelNode(location, successes, failures, children)
        return (SequenceNode if kind == "Sequence" else FallbackNode)(location, children)

    def _decorator(self, kind: str, site: _BuildContext) -> PlanNode:
        location, attributes = site.location, site.attributes
        if len(site.element.children) != 1:
            raise site.error(f"{kind} has exactly 1 child")
        below = replace(site, limited=site.limited or kind == "Timeout")
        (child,) = self._children(below, site.element.children)
        match kind:
            case "RetryUntilSuccessful":
                attributes.require_known({"num_attempts"})
                return LoopNode(
                    location, RepeatOn.FAILURE, _times(attributes, "num_attempts"), child
                )
            case "Repeat":
                attributes.require_known({"num_cycles"})
                return LoopNode(location, RepeatOn.SUCCESS, _times(attributes, "num_cycles"), child)
            case "Timeout":
                attributes.require_known({"msec"})
                return TimeoutNode(location, _limit_s(attributes), child)
            case _:
                attributes.require_known(set())
                return InverterNode(location, child)

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


def _step(leaf: CommandDeclaration, site: _BuildContext) -> PlanStep:
    attributes = site.attributes
    attributes.require_known({argument.name for argument in leaf.user_arguments} | {DEADLINE})
    values = []
    for argument in leaf.user_arguments:
        value = attributes.value(argument)
        if value is None and not argument.optional:
            raise attributes.error(
                f"{leaf.name} needs {argument.name} ({attribute_help(argument)})"
            )
        values.append(value)
    deadline_s = attributes.number(DEADLINE)
    if deadline_s is None and not site.limited:
        text = f"{leaf.name} has no deadline: give deadline_s, or put it below a Timeout"
        raise PlanError(Reason.PLAN_NO_DEADLINE, site.location.line, text)
    if deadline_s is not None and not 0.0 < deadline_s <= MAX_DEADLINE_S:
        raise attributes.error(f"deadline_s {deadline_s:g}: above 0, {MAX_DEADLINE_S:g} at most")
    return PlanStep(site.location, leaf.build_request(*values), deadline_s)


def _times(attributes: Attributes, name: str) -> int:
    times = attributes.count(name)
    if times is None:
        raise attributes.error(f"{name} is required")
    if not 1 <= times <= MAX_LOOP_CYCLES:
        raise attributes.error(f"{name} {times}: 1 to {MAX_LOOP_CYCLES}, so that every plan ends")
    return times


def _limit_s(attributes: Attributes) -> float:
    msec = attributes.count("msec")
    if msec is None:
        raise attributes.error("msec is required")
    if not 0 < msec <= MAX_DEADLINE_S * 1000:
        raise attributes.error(f"msec {msec}: above 0, {MAX_DEADLINE_S * 1000:.0f} at most")
    return msec / 1000


def _threshold(attributes: Attributes, name: str, default: int, children: int) -> int:
    """Return the threshold as a number of children; -1 stands for all, -2 for all but one."""
    given = attributes.count(name)
    required = default if given is None else given
    meant = required if required >= 0 else children + 1 + required
    if not 1 <= meant <= children:
        raise attributes.error(f"{name} {required}: there are {children} children")
    return meant


MAX_COMMANDS = 10_000
"""Maximum number of commands of a plan, if all its loops run to their limit; chosen."""


def check_plan(definition: PlanDefinition, settings: Settings) -> PlanNode | Refusal:
    """Return the root node of a valid plan, or a refusal.

    Arguments are checked against the asset's bounds, except bounds that depend on the rover's
    position: they are checked when the command is due.
    """
    plan = read_plan(definition)
    if isinstance(plan, Refusal):
        return plan
    return check_bounds(plan, settings) or plan


def check_bounds(plan: PlanNode, settings: Settings) -> Refusal | None:
    """Return a refusal if an argument of a plan is outside the bounds of an asset."""
    for step in steps(plan):
        refusal = check_arguments(step.request, settings, _from(step.request))
        if refusal is not None:
            line = step.location.line
            fault = PlanError(Reason.PLAN_BAD_ARGUMENT, line, refusal.text, refusal.figures)
            return fault.refusal
    return None


def read_plan(definition: PlanDefinition) -> PlanNode | Refusal:
    """Return the root node of a plan that is valid apart from the bounds of an asset."""
    try:
        return _read(definition)
    except PlanError as fault:
        return fault.refusal


def _read(definition: PlanDefinition) -> PlanNode:
    if not is_plan_id(definition.plan_id):
        raise PlanError(
            Reason.BAD_IDENTIFIER, None, "a plan id has 1 to 64 letters, digits or any of _ . -"
        )
    if definition.format != FORMAT:
        raise PlanError(
            Reason.PLAN_FORMAT, None, f"unknown format {definition.format[:40]!r}: use {FORMAT}"
        )
    root = read_xml(definition.content)
    trees = _trees(root)
    for tree in trees.values():
        for element in tree.children[0].elements():
            node_kind(element, trees, LEAVES)
    _require_used(definition.arguments, root.children)
    plan = PlanBuilder(trees, _defaults(root), f"plan:{definition.plan_id}").build(
        _main(root, trees), {argument.name: argument.text for argument in definition.arguments}
    )
    if not steps(plan):
        raise PlanError(Reason.PLAN_STRUCTURE, plan.location.line, "the plan has no command")
    if max_commands(plan) > MAX_COMMANDS:
        raise PlanError(
            Reason.PLAN_TOO_LARGE,
            plan.location.line,
            f"its loops could command {max_commands(plan)} times: {MAX_COMMANDS} at most",
        )
    return plan


def max_commands(node: PlanNode) -> int:
    """Return the maximum number of commands of a node."""
    if isinstance(node, PlanStep):
        return 1
    times = node.times if isinstance(node, LoopNode) else 1
    return times * sum(max_commands(child) for child in children_of(node))


def _trees(root: Element) -> dict[str, Element]:
    if root.tag != "root":
        raise root.error(Reason.PLAN_STRUCTURE, f"a plan begins with <root>, not <{root.tag}>")
    if root.attributes.get("BTCPP_format") != "4":
        raise root.error(Reason.PLAN_FORMAT, '<root> needs BTCPP_format="4"')
    trees: dict[str, Element] = {}
    for element in root.children:
        match element.tag:
            case "BehaviorTree":
                name = element.attributes.get("ID")
                if not name or name in trees:
                    raise element.error(
                        Reason.PLAN_STRUCTURE, "each <BehaviorTree> needs an ID of its own"
                    )
                if len(element.children) != 1:
                    raise element.error(
                        Reason.PLAN_STRUCTURE, "a <BehaviorTree> has exactly 1 child"
                    )
                trees[name] = element
            case "TreeNodesModel":
                pass
            case _:
                raise element.error(
                    Reason.PLAN_UNKNOWN_NODE, f"<{element.tag}> does not belong below <root>"
                )
    return trees


def _defaults(root: Element) -> dict[str, dict[str, str]]:
    """Return the port defaults of each `SubTree` from the `TreeNodesModel`."""
    return {
        model.attributes.get("ID", ""): {
            port.attributes["name"]: port.attributes["default"]
            for port in model.children
            if {"name", "default"} <= port.attributes.keys()
        }
        for models in root.children
        if models.tag == "TreeNodesModel"
        for model in models.children
        if model.tag == SUBTREE
    }


def _require_used(arguments: Iterable[PlanArgument], trees: Iterable[Element]) -> None:
    """Raise PlanError for an argument that no node reads, probably misspelt."""
    read_there = {name for tree in trees for name in _names_in(tree)}
    for argument in arguments:
        name = argument.name
        if name not in read_there:
            text = f"no node reads the argument {quote(name)}"
            near = suggest(name, sorted(read_there))
            raise PlanError(Reason.PLAN_BAD_ARGUMENT, None, text + near)


def _names_in(element: Element) -> Iterator[str]:
    for each in element.elements():
        for attribute, text in each.attributes.items():
            if text.startswith("{") and text.endswith("}"):
                yield attribute if text == "{=}" else text[1:-1]


def _main(root: Element, trees: dict[str, Element]) -> str:
    """Return the ID of the main tree: as declared, or the only one that no `SubTree` names."""
    name = root.attributes.get("main_tree_to_execute")
    if name is None:
        below = [element for tree in trees.values() for element in tree.elements()]
        named = {element.attributes["ID"] for element in below if element.tag == SUBTREE}
        first = [each for each in trees if each not in named] or list(trees)
        if len(first) != 1:
            text = "the trees have no single root: main_tree_to_execute must name the tree to run"
            raise root.error(Reason.PLAN_STRUCTURE, text)
        return first[0]
    if name not in trees:
        raise root.error(Reason.PLAN_STRUCTURE, f"there is no tree {name[:40]!r} to run")
    return name


def _from(request: Request) -> Point:
    """Return a position at zero distance from the target."""
    match request:
        case MoveTo(Waypoint(x_m, y_m)) | FollowPath((Waypoint(x_m, y_m), *_)):
            return Point(x_m, y_m)
        case _:
            return Point(0.0, 0.0)
