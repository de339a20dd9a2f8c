"""`write_plots` draws several runs side by side, each with its map and its timeline."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

from PIL import Image

from sim.drawing import as_png, draw_run, plot_of


def write_plots(recordings: Sequence[Path], path: Path) -> None:
    """Write the plots of recordings side by side, as PNG.

    Raises:
        RecordingError: a file cannot be used as a recording.
        OSError: the picture cannot be written.
    """
    plots = [Image.open(BytesIO(as_png(draw_run(plot_of(each))))) for each in recordings]
    height = max(each.height for each in plots)
    beside = Image.new("RGB", (sum(each.width for each in plots), height), "white")
    left = 0
    for each in plots:
        beside.paste(each, (left, 0))
        left += each.width
    beside.save(path)
