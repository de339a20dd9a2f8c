"""The text of a plan as elements with their lines. Knows XML and its bounds, no node.

No document type, entity, include or other file is ever read.
"""

from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from executive.plans.faults import PlanError
from executive.reasons import Reason

if TYPE_CHECKING:
    from xml.parsers.expat import XMLParserType

LARGEST: Final = 256 * 1024
"""Octets of the largest plan."""
DEEPEST: Final = 64
MOST_ELEMENTS: Final = 4000


@dataclass(frozen=True, slots=True)
class Element:
    """One element of the text."""

    tag: str
    attributes: MappingProxyType[str, str]
    line: int
    children: tuple["Element", ...]


@dataclass(slots=True)
class _Open:
    tag: str
    attributes: MappingProxyType[str, str]
    line: int
    children: list[Element] = field(default_factory=list)


def read(content: bytes) -> Element:
    """Return the root element of a text.

    Raises:
        PlanError: it is too large, not well-formed XML, has a document type, or has more
            or deeper elements than a plan needs.
    """
    from xml.parsers.expat import ExpatError, ParserCreate

    if len(content) > LARGEST:
        raise PlanError(
            Reason.PLAN_TOO_LARGE, None, f"{len(content)} octets: a plan has {LARGEST} at most"
        )
    parser = ParserCreate("utf-8")
    try:
        return _Reader(parser).read(content)
    except ExpatError as error:
        raise PlanError(Reason.PLAN_NOT_XML, error.lineno, f"no XML: {_plain(error)}") from error


class _Reader:
    def __init__(self, parser: "XMLParserType") -> None:
        self._parser = parser
        self._count = 0
        self._open = [_Open("", MappingProxyType({}), 0)]
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
        self._open.append(_Open(tag, MappingProxyType(attributes), line))

    def _end(self, _: str) -> None:
        done = self._open.pop()
        self._open[-1].children.append(
            Element(done.tag, done.attributes, done.line, tuple(done.children))
        )

    def _doctype(self, *_: object) -> None:
        line = self._parser.CurrentLineNumber
        raise PlanError(Reason.PLAN_NOT_XML, line, "a plan has no document type")


def _plain(error: Exception) -> str:
    return str(error).partition(":")[0]
