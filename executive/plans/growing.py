"""Elements as nodes: subtrees put in their places, attributes read, each in its bounds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain, count
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


@dataclass(frozen=True, slots=True)
class _Site:
    """Where a node is to grow.

    Attributes:
        place: its own, or that of the node above.
        given: the values of `{names}` there.
        trees: those that it grows in, from the outermost.
        limited: whether a Timeout stands above.
    """

    place: Place
    element: Element
    given: Mapping[str, str]
    trees: tuple[str, ...]
    limited: bool

    @property
    def attributes(self) -> Attributes:
        """The attributes of the element, as seen from here."""
        return Attributes(self.element, self.given)

    def bad(self, text: str) -> PlanError:
        """Return the error that the element does not fit here."""
        return PlanError(Reason.PLAN_STRUCTURE, self.place.line, text)


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
        return self._tree(_Site(place, element, given, (tree,), limited=False))

    def _tree(self, site: _Site) -> Branch:
        children = self._trees[site.trees[-1]].children
        return Branch(site.place, Order.SEQUENCE, self._children(site, children))

    def _children(self, site: _Site, elements: tuple[Element, ...]) -> tuple[PlanNode, ...]:
        taken: set[str] = set()
        grown = []
        for element in elements:
            kind = known_kind(element, self._trees, LEAVES)
            first = name_of(element, element.attributes["ID"] if kind == SUBTREE else kind)
            names = chain([first], (f"{first} {again}" for again in count(2)))
            name = next(name for name in names if name not in taken)
            taken.add(name)
            place = self._place(f"{site.place.path}/{name}", element)
            grown.append(self._node(kind, replace(site, place=place, element=element)))
        return tuple(grown)

    def _node(self, kind: str, site: _Site) -> PlanNode:
        if kind == SUBTREE:
            return self._subtree(site)
        if kind in CONTROLS:
            return self._control(kind, site)
        if kind in DECORATORS:
            return self._decorator(kind, site)
        if site.element.children:
            raise site.bad(f"{kind} has no children")
        return _step(LEAVES[kind], site)

    def _subtree(self, site: _Site) -> PlanNode:
        tree = site.element.attributes["ID"]
        if site.element.children:
            raise site.bad("<SubTree> has no children")
        if tree in site.trees:
            raise site.bad(f"tree {tree[:40]!r} contains itself")
        given = site.attributes.passed_on()
        return self._tree(replace(site, given=given, trees=(*site.trees, tree)))

    def _control(self, kind: str, site: _Site) -> PlanNode:
        place, attributes = site.place, site.attributes
        if not site.element.children:
            raise site.bad(f"{kind} needs a child at least")
        attributes.only({"success_count", "failure_count"} if kind == "Parallel" else set())
        children = self._children(site, site.element.children)
        if kind == "Parallel":
            successes = _threshold(attributes, "success_count", -1, len(children))
            failures = _threshold(attributes, "failure_count", 1, len(children))
            return Abreast(place, successes, failures, children)
        return Branch(place, Order[kind.upper()], children)

    def _decorator(self, kind: str, site: _Site) -> PlanNode:
        place, attributes = site.place, site.attributes
        if len(site.element.children) != 1:
            raise site.bad(f"{kind} has exactly 1 child")
        below = replace(site, limited=site.limited or kind == "Timeout")
        (child,) = self._children(below, site.element.children)
        match kind:
            case "RetryUntilSuccessful":
                attributes.only({"num_attempts"})
                return Loop(place, Again.FAILURE, _times(attributes, "num_attempts"), child)
            case "Repeat":
                attributes.only({"num_cycles"})
                return Loop(place, Again.SUCCESS, _times(attributes, "num_cycles"), child)
            case "Timeout":
                attributes.only({"msec"})
                return Limit(place, _limit_s(attributes), child)
            case _:
                attributes.only(set())
                return Inversion(place, child)

    def _place(self, path: str, element: Element) -> Place:
        if self._count == MOST_NODES:
            text = f"a plan has {MOST_NODES} nodes at most"
            raise PlanError(Reason.PLAN_TOO_LARGE, element.line, text)
        if path.count("/") > DEEPEST:
            text = f"a plan is {DEEPEST} deep at most"
            raise PlanError(Reason.PLAN_TOO_LARGE, element.line, text)
        place = Place(self._count, path, element.line)
        self._count += 1
        return place


def _step(leaf: Leaf, site: _Site) -> Step:
    attributes = site.attributes
    attributes.only({parameter.name for parameter in leaf.parameters} | {DEADLINE.name})
    values = []
    for parameter in leaf.parameters:
        value = attributes.value(parameter.name, parameter.kind)
        if value is None and parameter.required:
            raise attributes.fault(f"{leaf.name} needs {parameter.name} ({parameter.help})")
        values.append(value)
    deadline_s = attributes.number(DEADLINE.name)
    if deadline_s is None and not site.limited:
        text = f"{leaf.name} has no deadline: give deadline_s, or put it below a Timeout"
        raise PlanError(Reason.PLAN_NO_DEADLINE, site.place.line, text)
    if deadline_s is not None and not 0.0 < deadline_s <= LONGEST_S:
        raise attributes.fault(f"deadline_s {deadline_s:g}: above 0, {LONGEST_S:g} at most")
    return Step(site.place, leaf.make(*values), deadline_s)


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
    given = attributes.count(name)
    asked = default if given is None else given
    meant = asked if asked >= 0 else children + 1 + asked
    if not 1 <= meant <= children:
        raise attributes.fault(f"{name} {asked}: there are {children} children")
    return meant
