"""The marks on a map: rover, waypoint, stop, view. Each is drawn at a spot, towards an angle."""

from math import cos, pi, radians, sin
from typing import Final

from sim.demo.drawing import Anchor, Label, Polyline, Shape, Spot, disc, polygon

HALF_LENGTH_M: Final = 0.254
HALF_WIDTH_M: Final = 0.215
HALF_VIEW_RAD: Final = radians(34.8)
"""What the camera sees to each side: 55° upright in a 4:3 picture."""
PLANNED, STOPPED, SEEN = "#333333", "#c8321e", "#00845f"
_ARROW = 30.0


def waypoint(spot: Spot, number: str, heading_rad: float | None) -> list[Shape]:
    """Return a numbered disc, with an arrow where a heading is wanted."""
    shapes: list[Shape] = []
    if heading_rad is not None:
        tip, left, right = (
            _turned(spot, heading_rad, ahead, aside)
            for ahead, aside in ((_ARROW, 0.0), (_ARROW - 9, 5.0), (_ARROW - 9, -5.0))
        )
        shapes += [
            Polyline((spot, _turned(spot, heading_rad, _ARROW - 6, 0.0)), PLANNED, 2),
            polygon(tip, left, right, fill=PLANNED),
        ]
    x, y = spot
    return [
        *shapes,
        disc(spot, 9, "#ffffff", PLANNED, 1.5),
        Label(number, (x, y + 4), 12, PLANNED, Anchor.MIDDLE, bold=True),
    ]


def rover(spot: Spot, heading_rad: float, pixels_per_m: float, colour: str) -> list[Shape]:
    """Return the outline of the rover, its front marked."""
    length, width = HALF_LENGTH_M * pixels_per_m, HALF_WIDTH_M * pixels_per_m
    hull = [
        _turned(spot, heading_rad, ahead * length, aside * width)
        for ahead, aside in ((1, 1), (1, -1), (-1, -1), (-1, 1))
    ]
    front = [
        _turned(spot, heading_rad, ahead * length, aside * width)
        for ahead, aside in ((0.95, 0), (0.5, 0.45), (0.5, -0.45))
    ]
    return [polygon(*hull, fill=None, stroke=colour, width=2), polygon(*front, fill=colour)]


def stop(spot: Spot) -> list[Shape]:
    """Return a red octagon."""
    corners = [_turned(spot, pi / 8 + i * pi / 4, 9.0, 0.0) for i in range(8)]
    return [polygon(*corners, fill=STOPPED, stroke="#ffffff", width=1.5)]


def view(spot: Spot, direction_rad: float, reach: float) -> list[Shape]:
    """Return what a camera sees, as an open fan."""
    rim = [_turned(spot, direction_rad + HALF_VIEW_RAD * i / 6, reach, 0.0) for i in range(-6, 7)]
    return [
        Polyline((spot, *rim), SEEN, 1.8, dash=(6, 4), closed=True),
        disc(spot, 5, SEEN, "#ffffff", 1.5),
    ]


def _turned(spot: Spot, angle_rad: float, ahead: float, aside: float) -> Spot:
    """Return the spot that lies ahead and to the left of one, counter-clockwise from x."""
    x, y = spot
    return (
        x + ahead * cos(angle_rad) - aside * sin(angle_rad),
        y - ahead * sin(angle_rad) - aside * cos(angle_rad),
    )
