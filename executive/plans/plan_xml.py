"""The text of a plan: bounded XML, the known nodes of BehaviorTree.CPP v4, and their attributes.

No document type, entity, include or other file is ever read.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from enum import Enum
from itertools import islice
from math import isfinite, radians
from re import IGNORECASE
from re import compile as pattern
from types import MappingProxyType
from typing import Final
from xml.parsers.expat import ExpatError, ParserCreate, XMLParserType

from executive.commands import Argument, Waypoint
from executive.values.reasons import Figure, Reason, Refusal

PLAN_ARGUMENT = 1
"""Index of the plan among the parts of `submitPlan`."""


class PlanError(Exception):
    """A plan is not valid. `executive.plans.builder` turns it into a refusal.

    Args:
        line: of the plan's text; None where the fault is of no line.

    Attributes:
        refusal: what mission control is told.
    """

    def __init__(
        self, reason: Reason, line: int | None, text: str, figures: tuple[Figure, ...] = ()
    ) -> None:
        if line is not None:
            text, figures = f"line {line}: {text}", (Figure("line", line), *figures)
        self.refusal = Refusal(reason, text, figures, PLAN_ARGUMENT)
        super().__init__(self.refusal.text)


LARGEST_PLAN: Final = 256 * 1024
"""Octets of the largest plan."""
DEEPEST: Final = 64
MOST_ELEMENTS: Final = 4000


@dataclass(frozen=True, slots=True)
class Element:
    """One element of the text."""

    tag: str
    attributes: MappingProxyType[str, str]
    line: int
    children: list["Element"] = field(default_factory=list)

    def elements(self) -> Iterator["Element"]:
        """Return this element and all below it, in the order of the text."""
        yield self
        for child in self.children:
            yield from child.elements()

    def fault(self, reason: Reason, text: str) -> PlanError:
        """Return the error that something is wrong with this element."""
        return PlanError(reason, self.line, text)


def read_xml(content: bytes) -> Element:
    """Return the root element of a text.

    Raises:
        PlanError: it is too large, not well-formed XML, has a document type, or has more
            or deeper elements than a plan needs.
    """
    if len(content) > LARGEST_PLAN:
        raise PlanError(
            Reason.PLAN_TOO_LARGE, None, f"{len(content)} octets: a plan has {LARGEST_PLAN} at most"
        )
    try:
        return _Reader(ParserCreate(_encoding(content))).read(content)
    except (ExpatError, LookupError, ValueError) as error:  # an encoding may be none of XML
        line, plain = getattr(error, "lineno", 1), str(error).partition(":")[0]
        raise PlanError(Reason.PLAN_NOT_XML, line, f"no XML: {plain}") from error


def _encoding(content: bytes) -> str | None:
    """Return UTF-8 for what is that, whatever it declares; None is what it declares."""
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
        if self._count > MOST_ELEMENTS:
            raise PlanError(
                Reason.PLAN_TOO_LARGE, line, f"a plan has {MOST_ELEMENTS} elements at most"
            )
        if len(self._open) > DEEPEST:
            raise PlanError(Reason.PLAN_TOO_LARGE, line, f"a plan is {DEEPEST} deep at most")
        element = Element(tag, MappingProxyType(attributes), line)
        self._open[-1].children.append(element)
        self._open.append(element)

    def _end(self, _: str) -> None:
        self._open.pop()

    def _doctype(self, *_: object) -> None:
        line = self._parser.CurrentLineNumber
        raise PlanError(Reason.PLAN_NOT_XML, line, "a plan has no document type")


_LONGEST: Final = 40
"""Characters of a wrong word that are looked at and told."""
_MOST: Final = 200
"""Words that a wrong one is held against: looking for more would keep a stop waiting."""

UNSUPPORTED_NODES: Final = {
    node: why
    for why, nodes in {
        "a plan does not stop the rover: who does takes it from the plan": "stop",
        "a plan does not resume the rover: after a stop mission control does": "resume",
        "nodes that begin anew each time are not taken: use Sequence, Fallback, Timeout": (
            "ReactiveSequence ReactiveFallback"
        ),
        "use Sequence, Fallback or Parallel": (
            "SequenceWithMemory SequenceStar AsyncSequence AsyncFallback ParallelAll"
        ),
        "conditions are not taken: a leaf that fails makes a Fallback go on": (
            "IfThenElse WhileDoElse Switch2 Switch3 Condition Precondition"
        ),
        "every plan ends: use Repeat or RetryUntilSuccessful": "KeepRunningUntilFailure",
        "a result that nothing was done for is not taken: use Fallback or Inverter": (
            "ForceSuccess ForceFailure AlwaysSuccess AlwaysFailure"
        ),
        "nothing waits alone: a leaf that takes long is limited by deadline_s or Timeout": (
            "Delay Sleep"
        ),
        "scripts and a blackboard are not taken: give values by {name} and --arg": (
            "Script ScriptCondition SetBlackboard UnsetBlackboard"
        ),
    }.items()
    for node in nodes.split()
}
"""Nodes of other dialects that plans do not have, and what to use instead."""


def quote(word: str) -> str:
    """Return a wrong word as it may stand in a text."""
    return repr(word[:_LONGEST])


def suggest(word: str, known: Iterable[str]) -> str:
    """Return what to append to a text about a wrong word: what it is near, if anything."""
    short = [each for each in islice(known, _MOST) if len(each) <= 2 * _LONGEST]
    near = get_close_matches(word[:_LONGEST], short, 1)
    return f": {near[0]} perhaps" if near else ""


FORMAT: Final = "BTCPP4"
"""Name of the format of plans."""

CONTROLS: Final = frozenset({"Sequence", "Fallback", "Parallel"})
DECORATORS: Final = frozenset({"RetryUntilSuccessful", "Repeat", "Timeout", "Inverter"})
EXPLICIT: Final = frozenset({"Action", "Control", "Decorator"})
"""Elements that name their node by the attribute ID; all others are named by their tag."""

SUBTREE: Final = "SubTree"
AUTOREMAP: Final = "_autoremap"
_OWN: Final = frozenset({"ID", "name"})
_SCRIPT: Final = pattern(
    r"_(skipIf|failureIf|successIf|while|onSuccess|onFailure|onHalted|post)", IGNORECASE
)
"""Conditions and scripts of BehaviorTree.CPP v4; what else begins so, editors note."""

_PLAN_ID: Final = pattern(r"[A-Za-z0-9_.-]{1,64}")
LONGEST_NAME: Final = 80


def is_plan_id(text: str) -> bool:
    """Whether a text can name a plan."""
    return _PLAN_ID.fullmatch(text) is not None


def known_kind(element: Element, trees: Collection[str], leaves: Collection[str]) -> str:
    """Return which node an element means.

    Raises:
        PlanError: there is no such node, or tree, or no ID that should say which.
    """
    kind, named = element.tag, element.attributes.get("ID", "")
    if not named and (kind in EXPLICIT or kind == SUBTREE):
        raise element.fault(Reason.PLAN_BAD_ARGUMENT, f"<{kind}> needs the attribute ID")
    if kind in EXPLICIT:
        kind = named
    if kind == SUBTREE:
        if named not in trees:
            text = f"there is no tree {quote(named)}{suggest(named, trees)}"
            raise element.fault(Reason.PLAN_UNKNOWN_NODE, text)
        return kind
    if kind not in CONTROLS and kind not in DECORATORS and kind not in leaves:
        if kind in UNSUPPORTED_NODES:
            text = f"{kind}: {UNSUPPORTED_NODES[kind]}"
        else:
            near = suggest(kind, [*CONTROLS, *DECORATORS, SUBTREE, *leaves])
            text = f"unknown node {quote(kind)}{near}"
        raise element.fault(Reason.PLAN_UNKNOWN_NODE, text)
    return kind


def name_of(element: Element, default: str) -> str:
    """Return what a node is called.

    Raises:
        PlanError: the name cannot stand in a path.
    """
    name = element.attributes.get("name", default)
    if not name or len(name) > LONGEST_NAME or "/" in name or not name.isprintable():
        raise element.fault(
            Reason.PLAN_BAD_ARGUMENT,
            f"name {name[:40]!r}: 1 to {LONGEST_NAME} printable characters, no slash",
        )
    return name


Value = float | int | str | Enum | tuple[Waypoint, ...]

LONGEST_VALUE: Final = 16_384
"""Characters of an attribute. An argument may stand in as many attributes as a plan has, so that
without a bound one plan could hold the core, and with it a stop, for minutes."""
MOST_PLACES: Final = 200
"""Of one leaf; the asset's own bound is lower."""

_NUMBER: Final = pattern(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")
_COUNT: Final = pattern(r"[+-]?[0-9]{1,9}")


class Attributes:
    """The attributes of one element, seen from where it stands.

    Args:
        given: the values of `{names}` there.

    Raises:
        PlanError: from every method that reads, if an attribute does not fit, or stands for an
            argument that was not given.
    """

    def __init__(self, element: Element, given: Mapping[str, str]) -> None:
        self._element = element
        self._given = given

    def only(self, names: set[str]) -> None:
        """Check that there is no attribute but these."""
        known = _OWN if self._element.tag in EXPLICIT else {"name"}
        for name in self._ports():
            if name not in known and name not in names:
                raise self.fault(f"unknown attribute {quote(name)}{suggest(name, sorted(names))}")

    def text(self, name: str) -> str | None:
        """Return the text of an attribute, or None if it is not there."""
        text = self._element.attributes.get(name)
        if text is None:
            return None
        text = self._resolved(name, text)
        if len(text) > LONGEST_VALUE:
            raise self.fault(f"{name} has {len(text)} characters: {LONGEST_VALUE} at most")
        return text

    def number(self, name: str) -> float | None:
        """Return a number."""
        text = self.text(name)
        return None if text is None else self._number(name, text)

    def count(self, name: str) -> int | None:
        """Return a whole number."""
        text = self.text(name)
        if text is None:
            return None
        if not _COUNT.fullmatch(text.strip()):
            raise self.fault(f"{name} {text[:40]!r} is no whole number")
        return int(text)

    def value(self, argument: Argument) -> Value | None:
        """Return what an argument of a leaf holds."""
        name = argument.name
        if argument.kind is float:
            return self.number(name)
        if argument.kind is int:
            return self.count(name)
        text = self.text(name)
        if text is None or argument.kind is str:
            return text
        if issubclass(argument.kind, Enum):
            return self._choice(name, text, argument.kind)
        return self._places(name, text)

    def passed_on(self, defaults: Mapping[str, str]) -> dict[str, str]:
        """Return what a `SubTree` gives to its tree: its attributes, and all with `_autoremap`.

        Without that, what is lacking is taken from the defaults of its model.
        """
        all_of_them = self._element.attributes.get(AUTOREMAP, "false").lower() in {"true", "1"}
        own = {} if all_of_them else dict(defaults)
        own |= {name: self._element.attributes[name] for name in self._ports()}
        resolved = {name: self._resolved(name, own[name]) for name in own if name not in _OWN}
        return {**(self._given if all_of_them else {}), **resolved}

    def fault(self, text: str) -> PlanError:
        """Return the fault that something is wrong with these attributes."""
        return self._element.fault(Reason.PLAN_BAD_ARGUMENT, text)

    def _ports(self) -> list[str]:
        """Return the names of the attributes, but what editors note (`_uid`, `_fullpath` …)."""
        names = self._element.attributes.keys()
        for name in names:
            if _SCRIPT.fullmatch(name):
                raise self.fault(f"attribute {quote(name)}: conditions and scripts are not run")
        return [name for name in names if not name.startswith("_")]

    def _resolved(self, name: str, text: str) -> str:
        if not (text.startswith("{") and text.endswith("}")):
            return text
        wanted = text[1:-1]
        if wanted == "=":
            wanted = name
        if wanted not in self._given:
            raise self.fault(f"{name}: nothing was given for {{{wanted[:40]}}}")
        return self._given[wanted]

    def _number(self, name: str, text: str) -> float:
        if not _NUMBER.fullmatch(text.strip()) or not isfinite(float(text)):
            raise self.fault(f"{name} {text[:40]!r} is no number{_in_degrees(text)}")
        return float(text)

    def _choice(self, name: str, text: str, kind: type[Enum]) -> Enum:
        words = {str(choice.value): choice for choice in kind}
        if text.strip() not in words:
            near = suggest(text.strip(), words)
            raise self.fault(f"{name} {quote(text)}: {' or '.join(words)} is needed{near}")
        return words[text.strip()]

    def _places(self, name: str, text: str) -> tuple[Waypoint, ...]:
        parts = text.strip().strip(";").split(";")
        if len(parts) > MOST_PLACES:
            raise self.fault(f"{name} are {len(parts)}: {MOST_PLACES} at most")
        places = []
        for place in parts:
            match [self._number(name, part) for part in place.split(",")]:
                case [x_m, y_m]:
                    places.append(Waypoint(x_m, y_m))
                case [x_m, y_m, heading_rad]:
                    places.append(Waypoint(x_m, y_m, heading_rad))
                case _:
                    raise self.fault(f"{name} {place[:40]!r} is neither x,y nor x,y,heading")
        return tuple(places)


def _in_degrees(text: str) -> str:
    """Return what to say of a number in degrees, which plans do not know."""
    figure = text.strip().removesuffix("deg").removesuffix("°").strip()
    if figure == text.strip() or not _NUMBER.fullmatch(figure):
        return ""
    return f": angles are in radians here, {radians(float(figure)):.4g}"
