"""Figures as a table for people, within 80 columns."""

from collections.abc import Sequence

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from sim.bench.figures import Figure


def table(figures: Sequence[Figure]) -> Group:
    """Return a table of figures, a row each, and below what the numbers of its last column mean."""
    shown = Table(
        *("figure", "value", "unit", "goal", "", "*"),
        title="rover bench",
        box=box.SIMPLE,
        padding=(0, 0),
        pad_edge=False,
    )
    shown.columns[1].justify = "right"
    beside = list(dict.fromkeys(f.compared_with for f in figures if f.compared_with))
    for figure in figures:
        verdict = {True: "[green]met[/]", False: "[red]missed[/]", None: ""}[figure.met]
        shown.add_row(
            figure.name,
            f"{figure.value:.3g}" if abs(figure.value) < 1000 else f"{figure.value:.0f}",
            figure.unit,
            str(figure.goal or ""),
            verdict,
            str(beside.index(figure.compared_with) + 1) if figure.compared_with else "",
        )
    notes = (Text(f"  *{number}  {text}", "dim") for number, text in enumerate(beside, 1))
    return Group(shown, *notes)
