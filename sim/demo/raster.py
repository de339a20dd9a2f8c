"""Drawings as PNG, by Pillow, which brings its own font."""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise
from math import hypot
from typing import Final, assert_never

from PIL import Image, ImageDraw, ImageFont

from sim.demo.drawing import Anchor, Drawing, Label, Polyline, Spot

_FINER: Final = 3
"""It is painted so many times larger and then reduced, which smooths the edges."""
_ANCHOR: Final = {Anchor.START: "ls", Anchor.MIDDLE: "ms", Anchor.END: "rs"}


def as_image(drawing: Drawing) -> Image.Image:
    """Return a drawing as a picture of its size, in few colours."""
    sheet = Image.new("RGB", (drawing.width * _FINER, drawing.height * _FINER), "#ffffff")
    brush = ImageDraw.Draw(sheet)
    for shape in drawing.shapes:
        match shape:
            case Polyline():
                _paint(brush, shape)
            case Label():
                _write(brush, shape)
            case _:
                assert_never(shape)
    finest = Image.Quantize.MAXCOVERAGE  # colours of small marks are colours too
    return sheet.reduce(_FINER).quantize(128, finest, dither=Image.Dither.NONE)


def _paint(brush: ImageDraw.ImageDraw, line: Polyline) -> None:
    spots = [(x * _FINER, y * _FINER) for x, y in line.spots]
    if line.closed:
        spots.append(spots[0])
    if line.fill:
        brush.polygon(spots, fill=line.fill)
    if not line.stroke:
        return
    width = max(1, round(line.width * _FINER))
    for piece in _dashed(spots, line.dash) if line.dash else [spots]:
        brush.line(piece, fill=line.stroke, width=width, joint="curve")


def _dashed(spots: Sequence[Spot], dash: tuple[float, float]) -> Iterator[list[Spot]]:
    """Cut a line into strokes; each starts anew at a corner of the line."""
    stroke, gap = (length * _FINER for length in dash)
    for (x, y), (to_x, to_y) in pairwise(spots):
        length = hypot(to_x - x, to_y - y)
        at = 0.0
        while at < length:
            yield [
                (x + (to_x - x) * part / length, y + (to_y - y) * part / length)
                for part in (at, min(at + stroke, length))
            ]
            at += stroke + gap


def _write(brush: ImageDraw.ImageDraw, label: Label) -> None:
    x, y = label.spot
    brush.text(
        (x * _FINER, y * _FINER),
        label.text,
        fill=label.colour,
        font=_font(label.size),
        anchor=_ANCHOR[label.anchor],
        stroke_width=1 if label.bold else 0,
        stroke_fill=label.colour,
    )


@cache
def _font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size * _FINER)
