"""Common style of all drawings, and their reproducible output as SVG and PNG."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, Final

from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image

DPI: Final = 100
POINT: Final = 72 / DPI
"""Points per pixel; sizes of lines, marks and texts are in points."""
INK, FAINT, GRID, RULE = "#222222", "#777777", "#e4e4e4", "#cfcfcf"
COMMAND, MOTION, DONE, WRONG, WARNED = "#e07b00", "#0067a5", "#00845f", "#c8321e", "#a87400"
"""Colours for colour-blind readers, too, with the same meaning in every drawing."""
_NO_DATE: Final[Any] = {"Creator": None, "Date": None}
_STYLE: Final[Any] = {
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "font.family": ["DejaVu Sans"],
    "font.size": 12 * POINT,
    "legend.fontsize": 12 * POINT,
    "legend.frameon": False,
    "lines.dash_capstyle": "butt",
    "lines.solid_capstyle": "butt",
    "svg.fonttype": "none",
    "svg.hashsalt": "rover",
    "text.color": INK,
    "text.parse_math": False,
    "xtick.color": INK,
    "ytick.color": INK,
}


@contextmanager
def styled_figure(width_px: float, height_px: float, title: str) -> Iterator[Figure]:
    """Yield a white figure with a title, in the common style."""
    with rc_context(_STYLE):
        figure = Figure(figsize=(width_px / DPI, height_px / DPI), dpi=DPI)
        figure.text(
            24 / width_px, 1 - 32 / height_px, title, fontsize=18 * POINT, fontweight="bold"
        )
        yield figure


def as_svg(figure: Figure) -> str:
    """Return a drawing as an SVG element for a page, without a date."""
    with rc_context(_STYLE):
        figure.savefig(text := StringIO(), format="svg", metadata=_NO_DATE)
    drawn = text.getvalue()
    return drawn[drawn.index("<svg") :]


def as_png(figure: Figure) -> bytes:
    """Return a drawing as PNG with 256 colours."""
    with rc_context(_STYLE):
        figure.savefig(pixels := BytesIO(), format="png")
    quantizer = Image.Quantize.MAXCOVERAGE  # colours of small marks are colours too
    with Image.open(pixels) as picture:
        few = picture.convert("RGB").quantize(256, quantizer, dither=Image.Dither.NONE)
    few.save(octets := BytesIO(), format="png", optimize=True)
    return octets.getvalue()


def write_drawing(folder: Path, name: str, figure: Figure) -> tuple[Path, Path]:
    """Write a drawing as SVG and as PNG, without a date."""
    paths = (folder / f"{name}.svg", folder / f"{name}.png")
    with rc_context(_STYLE):
        figure.savefig(paths[0], metadata=_NO_DATE)
    paths[1].write_bytes(as_png(figure))
    return paths
