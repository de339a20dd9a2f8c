"""Attributes of a node as values: plain texts, or `{names}` that stand for a plan's arguments."""

from collections.abc import Mapping
from math import isfinite, radians
from re import compile as pattern
from typing import Final

from executive.commands import Waypoint
from executive.plans.faults import PlanError
from executive.plans.leaves import Kind
from executive.plans.reading import Element
from executive.plans.untaken import perhaps, told
from executive.plans.vocabulary import AUTOREMAP, EXPLICIT, REMARKS, SUBTREE
from executive.reasons import Reason

Value = float | int | str | tuple[Waypoint, ...]

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
    """

    def __init__(self, element: Element, given: Mapping[str, str]) -> None:
        """Look at an element."""
        self._element = element
        self._given = given

    def only(self, names: set[str]) -> None:
        """Check that there is no attribute but these.

        Raises:
            PlanError: there is.
        """
        known = {*names, "name", *REMARKS}
        if self._element.tag in EXPLICIT or self._element.tag == SUBTREE:
            known.add("ID")
        for name in self._element.attributes:
            if name in known:
                continue
            if name.startswith("_"):
                raise self.fault(f"attribute {told(name)}: conditions and scripts are not run")
            raise self.fault(f"unknown attribute {told(name)}{perhaps(name, sorted(names))}")

    def text(self, name: str) -> str | None:
        """Return the text of an attribute, or None if it is not there.

        Raises:
            PlanError: it stands for an argument that was not given, or is too long.
        """
        text = self._element.attributes.get(name)
        if text is None:
            return None
        text = self._resolved(name, text)
        if len(text) > LONGEST_VALUE:
            raise self.fault(f"{name} has {len(text)} characters: {LONGEST_VALUE} at most")
        return text

    def number(self, name: str) -> float | None:
        """Return a number.

        Raises:
            PlanError: it is none.
        """
        text = self.text(name)
        return None if text is None else self._number(name, text)

    def count(self, name: str) -> int | None:
        """Return a whole number.

        Raises:
            PlanError: it is none.
        """
        text = self.text(name)
        if text is None:
            return None
        if not _COUNT.fullmatch(text.strip()):
            raise self.fault(f"{name} {text[:40]!r} is no whole number")
        return int(text)

    def value(self, name: str, kind: Kind) -> Value | None:
        """Return what a parameter of a leaf holds.

        Raises:
            PlanError: the text does not fit its kind.
        """
        match kind:
            case Kind.NUMBER:
                return self.number(name)
            case Kind.COUNT:
                return self.count(name)
            case Kind.TEXT:
                return self.text(name)
            case Kind.PLACES:
                text = self.text(name)
                return None if text is None else self._places(name, text)

    def passed_on(self) -> dict[str, str]:
        """Return what a `SubTree` gives to its tree: its attributes, and all with `_autoremap`.

        Raises:
            PlanError: an attribute stands for an argument that was not given.
        """
        names = self._element.attributes.keys() - {"ID", "name", AUTOREMAP, *REMARKS}
        for name in names:
            if name.startswith("_"):
                raise self.fault(f"attribute {name[:40]!r}: conditions and scripts are not run")
        own = {name: self._resolved(name, self._element.attributes[name]) for name in names}
        all_of_them = self._element.attributes.get(AUTOREMAP, "false").lower() in {"true", "1"}
        return {**(self._given if all_of_them else {}), **own}

    def fault(self, text: str) -> PlanError:
        """Return the fault that something is wrong with these attributes."""
        return PlanError(Reason.PLAN_BAD_ARGUMENT, self._element.line, text)

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
