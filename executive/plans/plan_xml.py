"""`read_xml` parses a plan: bounded size, known nodes of BehaviorTree.CPP v4, their attributes.

No document type, entity, include or other file is read.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from enum import Enum
from itertools import islice
from re import IGNORECASE
from re import compile as pattern
from types import MappingProxyType
from typing import Final
from xml.parsers.expat import ExpatError, ParserCreate, XMLParserType

from executive.commands import Argument, Waypoint
from executive.values.quantities import QuantityError, read_quantity
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


def read_xml(content: bytes) -> Element:
    """Return the root element of a text.

    Raises:
        PlanError: it is too large, not well-formed XML, has a document type, or has too
            many or too deep elements.
    """
    if len(content) > MAX_PLAN_OCTETS:
        raise PlanError(
            Reason.PLAN_TOO_LARGE,
            None,
            f"{len(content)} octets: a plan has {MAX_PLAN_OCTETS} at most",
        )
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
            raise PlanError(
                Reason.PLAN_TOO_LARGE, line, f"a plan has {MAX_ELEMENTS} elements at most"
            )
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


_MAX_QUOTED_LENGTH: Final = 40
"""Maximum length in characters of an invalid word that is compared and quoted."""
_MAX_SUGGESTIONS: Final = 200
"""Maximum number of candidates for a suggestion: more would delay a stop."""

UNSUPPORTED_NODES: Final = {
    node: why
    for why, nodes in {
        "a plan cannot stop the rover: an external stop suspends the plan": "stop",
        "a plan cannot resume the rover: mission control does, after a stop": "resume",
        "reactive nodes are not supported: use Sequence, Fallback, Timeout": (
            "ReactiveSequence ReactiveFallback"
        ),
        "use Sequence, Fallback or Parallel": (
            "SequenceWithMemory SequenceStar AsyncSequence AsyncFallback ParallelAll"
        ),
        "conditions are not supported: a leaf that fails makes a Fallback continue": (
            "IfThenElse WhileDoElse Switch2 Switch3 Condition Precondition"
        ),
        "every plan must end: use Repeat or RetryUntilSuccessful": "KeepRunningUntilFailure",
        "forced results are not supported: use Fallback or Inverter": (
            "ForceSuccess ForceFailure AlwaysSuccess AlwaysFailure"
        ),
        "waiting nodes are not supported: limit a leaf by deadline_s or Timeout": ("Delay Sleep"),
        "scripts and a blackboard are not supported: give values by {name} and --arg": (
            "Script ScriptCondition SetBlackboard UnsetBlackboard"
        ),
    }.items()
    for node in nodes.split()
}
"""Unsupported nodes of BehaviorTree.CPP, and their replacements."""


def quote(word: str) -> str:
    """Return an invalid word, quoted and truncated for a message."""
    return repr(word[:_MAX_QUOTED_LENGTH])


def suggest(word: str, known: Iterable[str]) -> str:
    """Return a suffix for a message about an invalid word: the nearest known word, if any."""
    short = [
        each for each in islice(known, _MAX_SUGGESTIONS) if len(each) <= 2 * _MAX_QUOTED_LENGTH
    ]
    near = get_close_matches(word[:_MAX_QUOTED_LENGTH], short, 1)
    return f": did you mean {near[0]}?" if near else ""


FORMAT: Final = "BTCPP4"
"""Name of the format of plans."""

CONTROLS: Final = frozenset({"Sequence", "Fallback", "Parallel"})
DECORATORS: Final = frozenset({"RetryUntilSuccessful", "Repeat", "Timeout", "Inverter"})
EXPLICIT: Final = frozenset({"Action", "Control", "Decorator"})
"""Elements that name their node in the attribute ID; all others name it by their tag."""

SUBTREE: Final = "SubTree"
AUTOREMAP: Final = "_autoremap"
_OWN: Final = frozenset({"ID", "name"})
_SCRIPT: Final = pattern(
    r"_(skipIf|failureIf|successIf|while|onSuccess|onFailure|onHalted|post)", IGNORECASE
)
"""Conditions and scripts of BehaviorTree.CPP v4; other names with `_` are editor metadata."""

_PLAN_ID: Final = pattern(r"[A-Za-z0-9_.-]{1,64}")
MAX_NAME_LENGTH: Final = 80


def is_plan_id(text: str) -> bool:
    """Whether a text is a valid plan id."""
    return _PLAN_ID.fullmatch(text) is not None


def node_kind(element: Element, trees: Collection[str], leaves: Collection[str]) -> str:
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
            text = f"there is no tree {quote(named)}{suggest(named, trees)}"
            raise element.error(Reason.PLAN_UNKNOWN_NODE, text)
        return kind
    if kind not in CONTROLS and kind not in DECORATORS and kind not in leaves:
        if kind in UNSUPPORTED_NODES:
            text = f"{kind}: {UNSUPPORTED_NODES[kind]}"
        else:
            near = suggest(kind, [*CONTROLS, *DECORATORS, SUBTREE, *leaves])
            text = f"unknown node {quote(kind)}{near}"
        raise element.error(Reason.PLAN_UNKNOWN_NODE, text)
    return kind


def name_of(element: Element, default: str) -> str:
    """Return the name of a node.

    Raises:
        PlanError: the name is not valid in a path.
    """
    name = element.attributes.get("name", default)
    if not name or len(name) > MAX_NAME_LENGTH or "/" in name or not name.isprintable():
        raise element.error(
            Reason.PLAN_BAD_ARGUMENT,
            f"name {name[:40]!r}: 1 to {MAX_NAME_LENGTH} printable characters, no slash",
        )
    return name


Value = float | int | str | Enum | tuple[Waypoint, ...]

MAX_VALUE_LENGTH: Final = 16_384
"""Maximum length in characters of an attribute. All attributes of a plan may use an argument:
without a bound one plan could block the core, and with it a stop, for minutes."""
MAX_WAYPOINTS: Final = 200
"""Maximum number of waypoints of one leaf; the asset's own bound is lower."""

_COUNT: Final = pattern(r"[+-]?[0-9]{1,9}")


class Attributes:
    """The attributes of one element, resolved in its tree.

    Args:
        given: the values of `{names}` in the tree.

    Raises:
        PlanError: from every method that reads, if an attribute is invalid, or refers to an
            argument without a value.
    """

    def __init__(self, element: Element, given: Mapping[str, str]) -> None:
        self._element = element
        self._arguments = given

    def require_known(self, names: set[str]) -> None:
        """Raise PlanError if there is an attribute outside these names."""
        known = _OWN if self._element.tag in EXPLICIT else {"name"}
        for name in self._ports():
            if name not in known and name not in names:
                raise self.error(f"unknown attribute {quote(name)}{suggest(name, sorted(names))}")

    def text(self, name: str) -> str | None:
        """Return the text of an attribute, or None if it is missing."""
        text = self._element.attributes.get(name)
        if text is None:
            return None
        text = self._resolved(name, text)
        if len(text) > MAX_VALUE_LENGTH:
            raise self.error(f"{name} has {len(text)} characters: {MAX_VALUE_LENGTH} at most")
        return text

    def number(self, name: str, unit: str = "") -> float | None:
        """Return a number in its SI unit, which may be written with another, as `90deg`."""
        text = self.text(name)
        return None if text is None else self._number(name, text, unit)

    def count(self, name: str) -> int | None:
        """Return a whole number."""
        text = self.text(name)
        if text is None:
            return None
        if not _COUNT.fullmatch(text.strip()):
            raise self.error(f"{name} {text[:40]!r} is not a whole number")
        return int(text)

    def value(self, argument: Argument) -> Value | None:
        """Return the value of a leaf's argument."""
        name = argument.name
        if argument.kind is float:
            return self.number(name, argument.unit)
        if argument.kind is int:
            return self.count(name)
        text = self.text(name)
        if text is None or argument.kind is str:
            return text
        if issubclass(argument.kind, Enum):
            return self._choice(name, text, argument.kind)
        return self._waypoints(name, text)

    def forwarded(self, defaults: Mapping[str, str]) -> dict[str, str]:
        """Return the arguments that a `SubTree` forwards: its attributes; with `_autoremap`, all.

        Without `_autoremap`, missing arguments are set to the defaults of its model.
        """
        all_of_them = self._element.attributes.get(AUTOREMAP, "false").lower() in {"true", "1"}
        own = {} if all_of_them else dict(defaults)
        own |= {name: self._element.attributes[name] for name in self._ports()}
        resolved = {name: self._resolved(name, own[name]) for name in own if name not in _OWN}
        return {**(self._arguments if all_of_them else {}), **resolved}

    def error(self, text: str) -> PlanError:
        """Return an error that concerns these attributes."""
        return self._element.error(Reason.PLAN_BAD_ARGUMENT, text)

    def _ports(self) -> list[str]:
        """Return the attribute names without editor metadata (`_uid`, `_fullpath` …)."""
        names = self._element.attributes.keys()
        for name in names:
            if _SCRIPT.fullmatch(name):
                raise self.error(f"attribute {quote(name)}: conditions and scripts are not run")
        return [name for name in names if not name.startswith("_")]

    def _resolved(self, name: str, text: str) -> str:
        if not (text.startswith("{") and text.endswith("}")):
            return text
        wanted = text[1:-1]
        if wanted == "=":
            wanted = name
        if wanted not in self._arguments:
            raise self.error(f"{name}: no value given for {{{wanted[:40]}}}")
        return self._arguments[wanted]

    def _number(self, name: str, text: str, unit: str) -> float:
        try:
            return read_quantity(text, unit)
        except QuantityError:
            of_unit = f" in {unit}" if unit else ""
            raise self.error(f"{name} {text[:40]!r} is not a number{of_unit}") from None

    def _choice(self, name: str, text: str, kind: type[Enum]) -> Enum:
        choices = {str(choice.value): choice for choice in kind}
        if text.strip() not in choices:
            near = suggest(text.strip(), choices)
            raise self.error(f"{name} {quote(text)}: {' or '.join(choices)} is required{near}")
        return choices[text.strip()]

    def _waypoints(self, name: str, text: str) -> tuple[Waypoint, ...]:
        parts = text.strip().strip(";").split(";")
        if len(parts) > MAX_WAYPOINTS:
            raise self.error(f"{name}: {len(parts)} waypoints, {MAX_WAYPOINTS} at most")
        waypoints = []
        for waypoint in parts:
            figures = enumerate(waypoint.split(","))
            match [self._number(name, part, "rad" if at == 2 else "m") for at, part in figures]:
                case [x_m, y_m]:
                    waypoints.append(Waypoint(x_m, y_m))
                case [x_m, y_m, heading_rad]:
                    waypoints.append(Waypoint(x_m, y_m, heading_rad))
                case _:
                    raise self.error(f"{name} {waypoint[:40]!r} is neither x,y nor x,y,heading")
        return tuple(waypoints)
