"""`read_xml` parses a plan: bounded size, known nodes of BehaviorTree.CPP v4, their names.

No document type, entity, include or other file is read.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final
from xml.parsers.expat import ExpatError, ParserCreate, XMLParserType

from executive.plans.arguments import quote, suggest
from executive.plans.dialect import (
    CONDITIONS,
    DIALECT,
    REMARKS,
    ROOT_KIND,
    SUBTREE,
    UNSUPPORTED_NODES,
    NodeKind,
    Role,
)
from executive.plans.syntax import ArgumentError
from executive.values.reasons import Figure, Reason, Refusal

PLAN_ARGUMENT = 1
"""Index of the plan among the parts of `submitPlan`."""


class PlanError(Exception):
    """A plan is not valid. `executive.plans.builder` turns it into a refusal.

    Args:
        line: line of the plan's text; None if the error concerns no line.

    Attributes:
        refusal: the refusal sent to mission control.
    """

    def __init__(
        self, reason: Reason, line: int | None, text: str, figures: tuple[Figure, ...] = ()
    ) -> None:
        if line is not None:
            text, figures = f"line {line}: {text}", (Figure("line", line), *figures)
        self.refusal = Refusal(reason, text, figures, PLAN_ARGUMENT)
        super().__init__(self.refusal.text)


MAX_PLAN_OCTETS: Final = 256 * 1024
"""Maximum size of a plan in octets; chosen, not measured."""
MAX_DEPTH: Final = 64
MAX_ELEMENTS: Final = 4000


@dataclass(frozen=True, slots=True)
class Element:
    """One element of the text."""

    tag: str
    attributes: MappingProxyType[str, str]
    line: int
    children: list["Element"] = field(default_factory=list)

    def elements(self) -> Iterator["Element"]:
        """Return this element and all its descendants, in text order."""
        yield self
        for child in self.children:
            yield from child.elements()

    def error(self, reason: Reason, text: str) -> PlanError:
        """Return an error that concerns this element."""
        return PlanError(reason, self.line, text)

    @contextmanager
    def located(self) -> Iterator[None]:
        """Let an `ArgumentError` be an error that concerns this element."""
        try:
            yield
        except ArgumentError as error:
            raise self.error(Reason.PLAN_BAD_ARGUMENT, str(error)) from error


def read_xml(content: bytes) -> Element:
    """Return the root element of a text.

    Raises:
        PlanError: it is too large, not well-formed XML, has a document type, or has too
            many or too deep elements.
    """
    if len(content) > MAX_PLAN_OCTETS:
        text = f"{len(content)} octets: a plan has {MAX_PLAN_OCTETS} at most"
        raise PlanError(Reason.PLAN_TOO_LARGE, None, text)
    try:
        return _Reader(ParserCreate(_encoding(content))).read(content)
    except (ExpatError, LookupError, ValueError) as error:  # the encoding may be invalid in XML
        line, plain = getattr(error, "lineno", 1), str(error).partition(":")[0]
        raise PlanError(Reason.PLAN_NOT_XML, line, f"invalid XML: {plain}") from error


def _encoding(content: bytes) -> str | None:
    """Return UTF-8 if the content is valid UTF-8; None to use the declared encoding."""
    try:
        content.decode()
    except UnicodeDecodeError:
        return None
    return "utf-8"


class _Reader:
    def __init__(self, parser: XMLParserType) -> None:
        self._parser = parser
        self._count = 0
        self._open = [Element("", MappingProxyType({}), 0)]
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.StartDoctypeDeclHandler = self._doctype

    def read(self, content: bytes) -> Element:
        self._parser.Parse(content, True)
        (root,) = self._open[0].children
        return root

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self._parser.CurrentLineNumber
        self._count += 1
        if self._count > MAX_ELEMENTS:
            text = f"a plan has {MAX_ELEMENTS} elements at most"
            raise PlanError(Reason.PLAN_TOO_LARGE, line, text)
        if len(self._open) > MAX_DEPTH:
            raise PlanError(Reason.PLAN_TOO_LARGE, line, f"a plan is {MAX_DEPTH} deep at most")
        element = Element(tag, MappingProxyType(attributes), line)
        self._open[-1].children.append(element)
        self._open.append(element)

    def _end(self, _: str) -> None:
        self._open.pop()

    def _doctype(self, *_: object) -> None:
        line = self._parser.CurrentLineNumber
        raise PlanError(Reason.PLAN_NOT_XML, line, "a plan has no document type")


FORMAT: Final = "BTCPP4"
"""Name of the format of plans."""

EXPLICIT: Final = frozenset({"Action", "Condition", "Control", "Decorator"})
"""Elements that name their node in the attribute ID; all others name it by their tag."""

AUTOREMAP: Final = "_autoremap"
AFTER_RESTART: Final = "after_restart"
"""Attribute of the root: `suspend` or `resume`."""
_ROOT_ATTRIBUTES: Final = frozenset(
    {"BTCPP_format", "main_tree_to_execute", AFTER_RESTART, "project_name"}
)
"""Attributes of the root; the last one is Groot2's."""

_PLAN_ID: Final = re.compile(r"[A-Za-z0-9_.-]{1,64}")
MAX_NAME_LENGTH: Final = 80


def is_plan_id(text: str) -> bool:
    """Whether a text is a valid plan id."""
    return _PLAN_ID.fullmatch(text) is not None


def node_kind(element: Element, trees: Collection[str]) -> NodeKind:
    """Return the kind of node of an element.

    Raises:
        PlanError: the node or the tree is unknown, or a required ID is missing.
    """
    kind, named = element.tag, element.attributes.get("ID", "")
    if not named and (kind in EXPLICIT or kind == SUBTREE):
        raise element.error(Reason.PLAN_BAD_ARGUMENT, f"<{kind}> needs the attribute ID")
    if kind in EXPLICIT:
        kind = named
    if kind == SUBTREE:
        if named not in trees:
            text = f"there is no tree {quote(named)}{suggest(named, list(trees))}"
            raise element.error(Reason.PLAN_UNKNOWN_NODE, text)
        return ROOT_KIND
    if kind not in DIALECT:
        if kind in UNSUPPORTED_NODES:
            text = f"{kind}: {UNSUPPORTED_NODES[kind]}"
        else:
            near = suggest(kind, [*DIALECT, SUBTREE]) or ": `rover plan nodes` lists them"
            text = f"unknown node {quote(kind)}{near}"
        raise element.error(Reason.PLAN_UNKNOWN_NODE, text)
    return DIALECT[kind]


def name_of(element: Element, default: str) -> str:
    """Return the name of a node.

    Raises:
        PlanError: the name is not valid in a path.
    """
    name = element.attributes.get("name", default)
    if not name or len(name) > MAX_NAME_LENGTH or "/" in name or not name.isprintable():
        needed = f"1 to {MAX_NAME_LENGTH} printable characters, no slash"
        raise element.error(Reason.PLAN_BAD_ARGUMENT, f"name {name[:40]!r}: {needed}")
    return name


def ports_of(element: Element) -> dict[str, str]:
    """Return the attributes of an element without its name, ID, conditions and editors' remarks.

    Raises:
        PlanError: an attribute begins with an underscore, and is not known.
    """
    found = {}
    is_subtree = element.tag == SUBTREE
    for name, text in element.attributes.items():
        if name.startswith("_"):
            known = name in REMARKS or name in CONDITIONS or (is_subtree and name == AUTOREMAP)
            if not known:
                near = suggest(name, [*CONDITIONS, AUTOREMAP]) or ": remove it"
                text = f"attribute {quote(name)} is neither a condition nor a script{near}"
                raise element.error(Reason.PLAN_BAD_ARGUMENT, text)
        elif name != "name" and (name != "ID" or not (is_subtree or element.tag in EXPLICIT)):
            found[name] = text
    return found


def trees_of(root: Element) -> dict[str, Element]:
    """Return the `BehaviorTree` elements of a plan by ID.

    Raises:
        PlanError: the text is no plan.
    """
    if root.tag != "root":
        raise root.error(Reason.PLAN_STRUCTURE, f"a plan begins with <root>, not <{root.tag}>")
    if root.attributes.get("BTCPP_format") != "4":
        remedy = "Groot2 converts older formats" if "BTCPP_format" in root.attributes else ""
        text = '<root> needs BTCPP_format="4"'
        raise root.error(Reason.PLAN_FORMAT, f"{text}: {remedy}" if remedy else text)
    for name in sorted(root.attributes.keys() - _ROOT_ATTRIBUTES - REMARKS):
        if ":" not in name and name != "xmlns":
            near = suggest(name, sorted(_ROOT_ATTRIBUTES)) or ": remove it"
            text = f"unknown attribute {quote(name)} of <root>{near}"
            raise root.error(Reason.PLAN_BAD_ARGUMENT, text)
    trees: dict[str, Element] = {}
    alone = sum(each.tag == "BehaviorTree" for each in root.children) == 1
    for element in root.children:
        if element.tag == "include":
            text = "<include>: a plan is one file; copy the trees of the other file into it"
            raise element.error(Reason.PLAN_UNKNOWN_NODE, text)
        if element.tag not in {"BehaviorTree", "TreeNodesModel"}:
            text = f"<{element.tag}> does not belong below <root>"
            raise element.error(Reason.PLAN_UNKNOWN_NODE, text)
        if element.tag == "BehaviorTree":
            name = element.attributes.get("ID") or ("Main" if alone else "")
            if not name or name in trees:
                text = "each <BehaviorTree> needs an ID of its own"
                raise element.error(Reason.PLAN_STRUCTURE, text)
            if len(element.children) != 1:
                text = "a <BehaviorTree> has exactly 1 child"
                raise element.error(Reason.PLAN_STRUCTURE, text)
            trees[name] = element
    return trees


def main_tree(root: Element, trees: Mapping[str, Element]) -> str:
    """Return the ID of the main tree: as declared, or the only one that no `SubTree` names.

    Raises:
        PlanError: there is no such tree, or more than one.
    """
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
        near = suggest(name, list(trees))
        raise root.error(Reason.PLAN_STRUCTURE, f"there is no tree {name[:40]!r} to run{near}")
    return name


def subtree_defaults(root: Element) -> dict[str, dict[str, str]]:
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
        if model.tag == Role.SUBTREE.value
    }


def resumes_after_restart(root: Element) -> bool:
    """Return whether a plan continues by itself after a restart.

    Raises:
        PlanError: the attribute has another value.
    """
    text = root.attributes.get(AFTER_RESTART, "suspend")
    if text not in {"suspend", "resume"}:
        problem = f"{AFTER_RESTART} {quote(text)}: suspend or resume is required"
        raise root.error(Reason.PLAN_BAD_ARGUMENT, problem)
    return text == "resume"
