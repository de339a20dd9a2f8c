"""Elements as nodes: subtrees put in their places, attributes read, each in its bounds."""

from collections.abc import Mapping
from typing import Final

from executive.plans.faults import PlanError
from executive.plans.leaves import DEADLINE, LEAVES, Leaf
from executive.plans.nodes import (
    Abreast,
    Again,
    Branch,
    Inversion,
    Limit,
    Loop,
    Order,
    Place,
    PlanNode,
    Step,
)
from executive.plans.reading import DEEPEST, Element
from executive.plans.values import Attributes
from executive.plans.vocabulary import (
    CONTROLS,
    DECORATORS,
    SUBTREE,
    known_kind,
    name_of,
)
from executive.reasons import Reason

MOST_NODES: Final = 500
MOST_TIMES: Final = 1000
LONGEST_S: Final = 86_400.0


class Growth:
    """Grows one plan.

    Args:
        trees: elements `BehaviorTree` by their ID.
        root: name of the root of all paths.
    """

    def __init__(self, trees: Mapping[str, Element], root: str) -> None:
        """Have grown nothing."""
        self._trees = trees
        self._root = root
        self._count = 0

    def grow(self, tree: str, given: Mapping[str, str]) -> PlanNode:
        """Return the root node of a tree.

        Args:
            tree: its ID.
            given: the plan's arguments.

        Raises:
            PlanError: it is not valid.
        """
        element = self._trees[tree]
        place = self._place(self._root, element)
        return self._within(place, tree, given, _Surroundings((tree,), limited=False))

    def _within(
        self, place: Place, tree: str, given: Mapping[str, str], around: "_Surroundings"
    ) -> Branch:
        child = self._trees[tree].children[0]
        return Branch(place, Order.SEQUENCE, self._nodes(place, (child,), given, around))

    def _nodes(
        self,
        above: Place,
        elements: tuple[Element, ...],
        given: Mapping[str, str],
        around: "_Surroundings",
    ) -> tuple[PlanNode, ...]:
        taken: set[str] = set()
        grown = []
        for element in elements:
            kind = known_kind(element, self._trees, LEAVES)
            default = element.attributes["ID"] if kind == SUBTREE else kind
            name = first = name_of(element, default)
            again = 1
            while name in taken:
                again += 1
                name = f"{first} {again}"
            taken.add(name)
            place = self._place(f"{above.path}/{name}", element)
            grown.append(self._node(kind, place, element, given, around))
        return tuple(grown)

    def _node(
        self,
        kind: str,
        place: Place,
        element: Element,
        given: Mapping[str, str],
        around: "_Surroundings",
    ) -> PlanNode:
        attributes = Attributes(element, given)
        if kind == SUBTREE:
            tree = element.attributes["ID"]
            if element.children:
                raise PlanError(Reason.PLAN_STRUCTURE, place.line, "<SubTree> has no children")
            if tree in around.trees:
                raise PlanError(
                    Reason.PLAN_STRUCTURE, place.line, f"tree {tree[:40]!r} contains itself"
                )
            return self._within(place, tree, attributes.passed_on(), around.inside(tree))
        if kind in CONTROLS:
            return self._control(kind, place, element, given, around)
        if kind in DECORATORS:
            return self._decorator(kind, place, element, given, around)
        if element.children:
            raise PlanError(Reason.PLAN_STRUCTURE, place.line, f"{kind} has no children")
        return _step(LEAVES[kind], place, attributes, around)

    def _control(
        self,
        kind: str,
        place: Place,
        element: Element,
        given: Mapping[str, str],
        around: "_Surroundings",
    ) -> PlanNode:
        if not element.children:
            raise PlanError(Reason.PLAN_STRUCTURE, place.line, f"{kind} needs a child at least")
        attributes = Attributes(element, given)
        attributes.only({"success_count", "failure_count"} if kind == "Parallel" else set())
        children = self._nodes(place, element.children, given, around)
        if kind == "Parallel":
            successes = _threshold(attributes, "success_count", -1, len(children))
            failures = _threshold(attributes, "failure_count", 1, len(children))
            return Abreast(place, successes, failures, children)
        return Branch(place, Order[kind.upper()], children)

    def _decorator(
        self,
        kind: str,
        place: Place,
        element: Element,
        given: Mapping[str, str],
        around: "_Surroundings",
    ) -> PlanNode:
        attributes = Attributes(element, given)
        if len(element.children) != 1:
            raise PlanError(Reason.PLAN_STRUCTURE, place.line, f"{kind} has exactly 1 child")

        def child(within: _Surroundings) -> PlanNode:
            return self._nodes(place, element.children, given, within)[0]

        match kind:
            case "RetryUntilSuccessful":
                attributes.only({"num_attempts"})
                times = _times(attributes, "num_attempts")
                return Loop(place, Again.FAILURE, times, child(around))
            case "Repeat":
                attributes.only({"num_cycles"})
                times = _times(attributes, "num_cycles")
                return Loop(place, Again.SUCCESS, times, child(around))
            case "Timeout":
                attributes.only({"msec"})
                return Limit(place, _limit_s(attributes), child(around.in_time()))
            case _:
                attributes.only(set())
                return Inversion(place, child(around))

    def _place(self, path: str, element: Element) -> Place:
        if self._count == MOST_NODES:
            raise PlanError(
                Reason.PLAN_TOO_LARGE, element.line, f"a plan has {MOST_NODES} nodes at most"
            )
        if path.count("/") > DEEPEST:
            raise PlanError(
                Reason.PLAN_TOO_LARGE, element.line, f"a plan is {DEEPEST} deep at most"
            )
        place = Place(self._count, path, element.line)
        self._count += 1
        return place


class _Surroundings:
    """What stands above a node: trees, and whether a Timeout does."""

    def __init__(self, trees: tuple[str, ...], limited: bool) -> None:
        self.trees = trees
        self.limited = limited

    def inside(self, tree: str) -> "_Surroundings":
        return _Surroundings((*self.trees, tree), self.limited)

    def in_time(self) -> "_Surroundings":
        return _Surroundings(self.trees, limited=True)


def _step(leaf: Leaf, place: Place, attributes: Attributes, around: _Surroundings) -> Step:
    attributes.only({parameter.name for parameter in leaf.parameters} | {DEADLINE.name})
    values = []
    for parameter in leaf.parameters:
        value = attributes.value(parameter.name, parameter.kind)
        if value is None and parameter.required:
            raise attributes.fault(f"{leaf.name} needs {parameter.name} ({parameter.help})")
        values.append(value)
    deadline_s = attributes.number(DEADLINE.name)
    if deadline_s is None and not around.limited:
        raise PlanError(
            Reason.PLAN_NO_DEADLINE,
            place.line,
            f"{leaf.name} has no deadline: give deadline_s, or put it below a Timeout",
        )
    if deadline_s is not None and not 0.0 < deadline_s <= LONGEST_S:
        raise attributes.fault(f"deadline_s {deadline_s:g}: above 0, {LONGEST_S:g} at most")
    return Step(place, leaf.make(*values), deadline_s)


def _times(attributes: Attributes, name: str) -> int:
    times = attributes.count(name)
    if times is None:
        raise attributes.fault(f"{name} is needed")
    if not 1 <= times <= MOST_TIMES:
        raise attributes.fault(f"{name} {times}: 1 to {MOST_TIMES}, so that every plan ends")
    return times


def _limit_s(attributes: Attributes) -> float:
    msec = attributes.count("msec")
    if msec is None:
        raise attributes.fault("msec is needed")
    if not 0 < msec <= LONGEST_S * 1000:
        raise attributes.fault(f"msec {msec}: above 0, {LONGEST_S * 1000:.0f} at most")
    return msec / 1000


def _threshold(attributes: Attributes, name: str, default: int, children: int) -> int:
    """Return how many children are meant; -1 stands for all, -2 for all but one."""
    count = attributes.count(name)
    count = default if count is None else count
    meant = count if count >= 0 else children + 1 + count
    if not 1 <= meant <= children:
        raise attributes.fault(f"{name} {count}: there are {children} children")
    return meant
