"""What is looked for in drawings."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from PIL import Image

from sim.drawing import write_drawing


def labels(figure: Figure) -> set[str]:
    texts: list[Any] = figure.findobj(Text)
    return {text.get_text() for text in texts}


def lines(figure: Figure, colour: str) -> list[Line2D]:
    """Return what was drawn in a colour on the first axes."""
    return [line for line in figure.axes[0].lines if to_hex(line.get_color()) == colour]


def spans(figure: Figure, colour: str) -> Iterator[tuple[float, float]]:
    """Yield from where to where each line of a colour reaches."""
    for line in lines(figure, colour):
        across = np.asarray(line.get_xdata(), float)
        yield round(float(across.min()), 3), round(float(across.max()), 3)


def written_alike(figure: Figure, folder: Path, colour: str) -> bool:
    """Return whether a drawing is written the same twice, escaped, with a colour that is kept."""
    svg, png = write_drawing(folder, "first", figure)
    again = write_drawing(folder, "second", figure)
    texts = {element.text for element in ElementTree.fromstring(svg.read_text()).iter()}
    assert any("<" in (text or "") for text in texts), "it is escaped"
    with Image.open(png) as picture:
        shown = np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0).astype(int)
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    assert np.abs(shown - wanted).sum(axis=1).min() < 24, colour
    return [path.read_bytes() for path in again] == [svg.read_bytes(), png.read_bytes()]
