"""Whether a plan is valid, all of it before any of it runs; what comes out is ready to run."""

from collections.abc import Iterable, Iterator

from executive.commands import FollowPath, MoveTo, Request, Waypoint
from executive.geometry import Point
from executive.limits import check as check_request
from executive.plans.definition import PlanArgument, PlanDefinition
from executive.plans.faults import ARGUMENT, PlanError
from executive.plans.growing import Growth
from executive.plans.leaves import LEAVES
from executive.plans.nodes import Loop, PlanNode, Step, children_of, steps
from executive.plans.reading import Element, read
from executive.plans.untaken import perhaps, told
from executive.plans.vocabulary import FORMAT, is_plan_id, known_kind
from executive.reasons import Figure, Reason, Refusal
from executive.settings import Settings

MOST_COMMANDS = 10_000
"""Commands of a plan, if all of its loops run as often as they may."""


def check(definition: PlanDefinition, settings: Settings) -> PlanNode | Refusal:
    """Return the plan ready to run, or why it is not valid.

    Arguments are held against the asset's bounds as far as these do not depend on where the rover
    stands; what does is looked at when the command is due.
    """
    try:
        return _check(definition, settings)
    except PlanError as fault:
        return fault.refusal


def _check(definition: PlanDefinition, settings: Settings) -> PlanNode:
    if not is_plan_id(definition.plan_id):
        raise PlanError(
            Reason.BAD_IDENTITY, None, "a plan's id has 1 to 64 letters, digits or any of _ . -"
        )
    if definition.format != FORMAT:
        raise PlanError(
            Reason.PLAN_FORMAT, None, f"format {definition.format[:40]!r}: {FORMAT} is read here"
        )
    root = read(definition.content)
    trees = _trees(root)
    for tree in trees.values():
        _known(tree.children[0], trees)
    _used(definition.arguments, trees.values())
    plan = Growth(trees, f"plan:{definition.plan_id}").grow(
        _main(root, trees), {argument.name: argument.text for argument in definition.arguments}
    )
    if not steps(plan):
        raise PlanError(Reason.PLAN_STRUCTURE, plan.place.line, "the plan commands nothing")
    if most(plan) > MOST_COMMANDS:
        raise PlanError(
            Reason.PLAN_TOO_LARGE,
            plan.place.line,
            f"its loops could command {most(plan)} times: {MOST_COMMANDS} at most",
        )
    for step in steps(plan):
        _within_bounds(step, settings)
    return plan


def most(node: PlanNode) -> int:
    """Return how many commands a node gives at most."""
    if isinstance(node, Step):
        return 1
    times = node.times if isinstance(node, Loop) else 1
    return times * sum(most(child) for child in children_of(node))


def _trees(root: Element) -> dict[str, Element]:
    if root.tag != "root":
        raise PlanError(
            Reason.PLAN_STRUCTURE, root.line, f"a plan begins with <root>, not <{root.tag}>"
        )
    if root.attributes.get("BTCPP_format") != "4":
        raise PlanError(Reason.PLAN_FORMAT, root.line, '<root> needs BTCPP_format="4"')
    trees: dict[str, Element] = {}
    for element in root.children:
        match element.tag:
            case "BehaviorTree":
                name = element.attributes.get("ID")
                if not name or name in trees:
                    raise PlanError(
                        Reason.PLAN_STRUCTURE,
                        element.line,
                        "each <BehaviorTree> needs an ID of its own",
                    )
                if len(element.children) != 1:
                    raise PlanError(
                        Reason.PLAN_STRUCTURE, element.line, "a <BehaviorTree> has exactly 1 child"
                    )
                trees[name] = element
            case "TreeNodesModel":
                pass
            case _:
                raise PlanError(
                    Reason.PLAN_UNKNOWN_NODE,
                    element.line,
                    f"<{element.tag}> does not belong below <root>",
                )
    return trees


def _known(element: Element, trees: dict[str, Element]) -> None:
    known_kind(element, trees, LEAVES)
    for child in element.children:
        _known(child, trees)


def _used(arguments: Iterable[PlanArgument], trees: Iterable[Element]) -> None:
    """Check that every argument is read somewhere: one that is not was written wrong."""
    read_there = {name for tree in trees for name in _names_in(tree)}
    for argument in arguments:
        name = argument.name
        if name not in read_there:
            text = f"nothing in the plan reads the argument {told(name)}"
            near = perhaps(name, sorted(read_there))
            raise PlanError(Reason.PLAN_BAD_ARGUMENT, None, text + near)


def _names_in(element: Element) -> Iterator[str]:
    for attribute, text in element.attributes.items():
        if text.startswith("{") and text.endswith("}"):
            yield attribute if text == "{=}" else text[1:-1]
    for child in element.children:
        yield from _names_in(child)


def _main(root: Element, trees: dict[str, Element]) -> str:
    name = root.attributes.get("main_tree_to_execute")
    if name is None and len(trees) == 1:
        return next(iter(trees))
    if name is None:
        raise PlanError(
            Reason.PLAN_STRUCTURE, root.line, "main_tree_to_execute must say which tree to run"
        )
    if name not in trees:
        raise PlanError(Reason.PLAN_STRUCTURE, root.line, f"there is no tree {name[:40]!r} to run")
    return name


def _within_bounds(step: Step, settings: Settings) -> None:
    refusal = check_request(step.request, settings, _from(step.request))
    if refusal is not None:
        fault = PlanError(Reason.PLAN_BAD_ARGUMENT, step.place.line, refusal.text)
        fault.refusal = Refusal(
            Reason.PLAN_BAD_ARGUMENT,
            fault.refusal.text,
            (Figure("line", step.place.line), *refusal.figures),
            ARGUMENT,
        )
        raise fault


def _from(request: Request) -> Point:
    """Where the rover would have to stand for no distance to matter."""
    match request:
        case MoveTo(Waypoint(x_m, y_m)) | FollowPath((Waypoint(x_m, y_m), *_)):
            return Point(x_m, y_m)
        case _:
            return Point(0.0, 0.0)
