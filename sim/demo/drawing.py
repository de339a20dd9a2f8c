"""A drawing as a list of shapes, from which SVG and PNG are made alike."""

from dataclasses import dataclass, field
from enum import Enum
from math import cos, pi, sin

Spot = tuple[float, float]
"""A place on the sheet: x to the right, y downward, in pixels."""


@dataclass(frozen=True, slots=True)
class Polyline:
    """A line through spots.

    Attributes:
        stroke, fill: colours as `#rrggbb`; None for none.
        width: of the stroke.
        dash: lengths of stroke and gap; None for a whole line.
        closed: whether the last spot leads back to the first.
    """

    spots: tuple[Spot, ...]
    stroke: str | None = None
    width: float = 1.0
    fill: str | None = None
    dash: tuple[float, float] | None = None
    closed: bool = False


class Anchor(Enum):
    """Which part of a text stands at its spot; its baseline always does."""

    START = "start"
    MIDDLE = "middle"
    END = "end"


@dataclass(frozen=True, slots=True)
class Label:
    """A line of text."""

    text: str
    spot: Spot
    size: float = 13.0
    colour: str = "#222222"
    anchor: Anchor = Anchor.START
    bold: bool = False


Shape = Polyline | Label


@dataclass(slots=True)
class Drawing:
    """A white sheet with shapes, the later over the earlier."""

    width: int
    height: int
    shapes: list[Shape] = field(default_factory=list)

    def add(self, *shapes: Shape) -> None:
        """Put shapes on top."""
        self.shapes.extend(shapes)


def polygon(
    *spots: Spot, fill: str | None, stroke: str | None = None, width: float = 1.0
) -> Polyline:
    """Return a closed shape."""
    return Polyline(spots, stroke, width, fill, closed=True)


def disc(
    centre: Spot, radius: float, fill: str | None, stroke: str | None = None, width: float = 1.0
) -> Polyline:
    """Return a round shape."""
    corners = max(16, round(3 * radius))
    x, y = centre
    return Polyline(
        tuple(
            (x + radius * cos(2 * pi * i / corners), y + radius * sin(2 * pi * i / corners))
            for i in range(corners)
        ),
        stroke,
        width,
        fill,
        closed=True,
    )
