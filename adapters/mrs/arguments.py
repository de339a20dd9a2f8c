"""What people type where the MRS wants numbers: angles in degrees or radians, and waypoints."""

from math import radians

import click

from executive.commands import Waypoint


def angle(text: str) -> float:
    """Return radians from `90deg`, `90°`, `1.57rad` or `1.57`."""
    try:
        for unit in ("deg", "°"):
            if text.endswith(unit):
                return radians(float(text.removesuffix(unit)))
        return float(text.removesuffix("rad"))
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is no angle: write 90deg, 1.57rad or 1.57") from error


def place(text: str) -> Waypoint:
    """Return a waypoint from `X,Y`, `X,Y,HEADING` or `X,Y,HEADING,TOLERANCE`.

    HEADING may be empty before a tolerance.
    """
    try:
        match text.split(","):
            case [x, y]:
                return Waypoint(float(x), float(y))
            case [x, y, heading]:
                return Waypoint(float(x), float(y), angle(heading))
            case [x, y, heading, tolerance]:
                heading_rad = angle(heading) if heading else None
                return Waypoint(float(x), float(y), heading_rad, float(tolerance))
            case _:
                raise ValueError(text)
    except ValueError as error:
        raise click.BadParameter(
            f"{text!r} is no waypoint: write X,Y or X,Y,HEADING or X,Y,HEADING,TOLERANCE, such as"
            " 1,0 or 1,0,90deg or 1,0,,0.1"
        ) from error
