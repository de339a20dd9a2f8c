"""The marks on a timeline, and what they mean."""

from collections.abc import Callable
from typing import Final

from sim.demo.drawing import Label, Polyline, Shape, Spot, disc, polygon

UP, BUSY, READY, GIVEN_UP = "#e07b00", "#0067a5", "#00845f", "#c8321e"
TURN: Final = (3.0, 4.0)
"""Dash of the line of what waits for its turn."""
_COLUMN: Final = 200
_COLUMNS: Final = 6
_ROW: Final = 22


def sending(spot: Spot) -> list[Shape]:
    """Return a ring: a command leaves the ground."""
    return [disc(spot, 6.5, None, UP, 2.2)]


def arrival(spot: Spot) -> list[Shape]:
    """Return a triangle that points down: a command reaches the rover."""
    x, y = spot
    return [polygon((x - 6, y - 6), (x + 6, y - 6), (x, y + 5), fill=UP, stroke="#ffffff")]


def beginning(spot: Spot) -> list[Shape]:
    """Return a triangle that points ahead: the rover begins."""
    x, y = spot
    return [polygon((x, y - 6), (x, y + 6), (x + 9, y), fill="#ffffff", stroke=BUSY, width=1.5)]


def bar(start: Spot, end: float) -> list[Shape]:
    """Return a bar that ends in a tick: what the rover carries out."""
    x, y = start
    end = max(end, x + 2)
    return [
        polygon((x, y - 6), (end, y - 6), (end, y + 6), (x, y + 6), fill=BUSY),
        Polyline(((end, y - 9), (end, y + 9)), BUSY, 3),
    ]


def cross(spot: Spot) -> list[Shape]:
    """Return a red cross: given up."""
    x, y = spot
    return [
        Polyline(((x - 6, y - 6), (x + 6, y + 6)), GIVEN_UP, 3.5),
        Polyline(((x - 6, y + 6), (x + 6, y - 6)), GIVEN_UP, 3.5),
    ]


def legend(left: float, top: float, *, eclipse: bool) -> list[Shape]:
    """Return what the marks mean; those of waiting and giving up only where there is an eclipse."""
    entries: tuple[tuple[str, bool, Callable[[float, float], list[Shape]]], ...] = (
        ("sent from the ground", True, lambda x, y: sending((x + 14, y))),
        ("stored at the orbiter", True, lambda x, y: _dot(x, y, UP)),
        ("received aboard", True, lambda x, y: arrival((x + 14, y))),
        ("started", True, lambda x, y: beginning((x + 10, y))),
        ("carried out, ended", True, lambda x, y: bar((x, y), x + 28)),
        ("told on the ground", True, lambda x, y: _dot(x, y, READY)),
        ("waits at the orbiter", eclipse, lambda x, y: _dash(x, y, UP, 5)),
        ("given up there", eclipse, lambda x, y: cross((x + 14, y))),
        ("waits aboard for its turn", eclipse, lambda x, y: _dash(x, y, BUSY, 2, TURN)),
        ("report waits aboard", eclipse, lambda x, y: _dash(x, y, READY, 1.8)),
    )
    shapes: list[Shape] = []
    for number, (words, draw) in enumerate(
        (words, draw) for words, shown, draw in entries if shown
    ):
        row, column = divmod(number, _COLUMNS)
        x, y = left + column * _COLUMN, top + row * _ROW
        shapes += [*draw(x, y), Label(words, (x + 38, y + 4), 12)]
    return shapes


def _dot(x: float, y: float, colour: str) -> list[Shape]:
    return [disc((x + 14, y), 4.5, colour, "#ffffff", 1)]


def _dash(
    x: float, y: float, colour: str, width: float, dash: tuple[float, float] | None = None
) -> list[Shape]:
    return [Polyline(((x, y), (x + 28, y)), colour, width, dash=dash)]
