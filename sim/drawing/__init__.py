"""Drawings of runs: the map, the timeline, and the style that all pictures share."""

from sim.drawing.map import Drive, draw_map, thinned
from sim.drawing.style import (
    COMMAND,
    DONE,
    DPI,
    FAINT,
    GRID,
    INK,
    MOTION,
    POINT,
    RULE,
    WARNED,
    WRONG,
    sheet,
    write_drawing,
)

__all__ = [
    "COMMAND",
    "DONE",
    "DPI",
    "FAINT",
    "GRID",
    "INK",
    "MOTION",
    "POINT",
    "RULE",
    "WARNED",
    "WRONG",
    "Drive",
    "draw_map",
    "sheet",
    "thinned",
    "write_drawing",
]
