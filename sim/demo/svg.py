"""Drawings as SVG."""

from typing import assert_never
from xml.sax.saxutils import escape

from sim.demo.drawing import Drawing, Label, Polyline


def as_svg(drawing: Drawing) -> str:
    """Return a drawing as an SVG document."""
    width, height = drawing.width, drawing.height
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"'
        f' viewBox="0 0 {width} {height}" font-family="Helvetica, Arial, DejaVu Sans, sans-serif"'
        ' stroke-linejoin="round" stroke-linecap="round">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    for shape in drawing.shapes:
        match shape:
            case Polyline():
                lines.append(_polyline(shape))
            case Label():
                lines.append(_label(shape))
            case _:
                assert_never(shape)
    return "\n".join([*lines, "</svg>"]) + "\n"


def _polyline(line: Polyline) -> str:
    spots = "L".join(f"{x:.1f} {y:.1f}" for x, y in line.spots)
    style = f'fill="{line.fill or "none"}"'
    if line.stroke:
        style += f' stroke="{line.stroke}" stroke-width="{line.width:g}"'
    if line.dash:
        style += f' stroke-dasharray="{line.dash[0]:g} {line.dash[1]:g}" stroke-linecap="butt"'
    return f'<path d="M{spots}{"Z" if line.closed else ""}" {style}/>'


def _label(label: Label) -> str:
    x, y = label.spot
    weight = ' font-weight="bold"' if label.bold else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{label.size:g}" fill="{label.colour}"'
        f' text-anchor="{label.anchor.value}"{weight}>{escape(label.text)}</text>'
    )
