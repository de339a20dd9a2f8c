"""Figures as a table for people."""

from collections.abc import Sequence

from rich.table import Table

from sim.bench.figures import Figure


def table(figures: Sequence[Figure]) -> Table:
    """Return a table of figures, a row each."""
    shown = Table("figure", "value", "unit", "goal", "", "measured against", title="rover bench")
    shown.columns[1].justify = "right"
    for figure in figures:
        verdict = {True: "[green]met[/]", False: "[red]missed[/]", None: ""}[figure.met]
        shown.add_row(
            figure.name,
            f"{figure.value:.3g}" if abs(figure.value) < 1000 else f"{figure.value:.0f}",
            figure.unit,
            str(figure.goal or ""),
            verdict,
            figure.compared_with,
        )
    return shown
