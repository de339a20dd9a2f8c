"""Measured figures, each with its unit, its comparison and its goal; as a table and as JSON."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text


@dataclass(frozen=True, slots=True)
class Goal:
    """A bound that a figure should keep.

    Attributes:
        at_least: whether the bound is the least wanted instead of the greatest.
    """

    bound: float
    at_least: bool = False

    def __str__(self) -> str:
        return f"{'≥' if self.at_least else '≤'} {self.bound:g}"

    def met_by(self, value: float) -> bool:
        return value >= self.bound if self.at_least else value <= self.bound


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured number.

    Attributes:
        compared_with: what stands beside it, or what it was measured on.
    """

    name: str
    value: float
    unit: str
    compared_with: str = ""
    goal: Goal | None = None

    @property
    def met(self) -> bool | None:
        """Whether the goal was met; None without a goal."""
        return None if self.goal is None else self.goal.met_by(self.value)


def quantile(values: Sequence[float], ratio: float) -> float:
    """Return the value below which this share of the values lies (nearest rank)."""
    ordered = sorted(values)
    return ordered[max(math.ceil(ratio * len(ordered)), 1) - 1]


def write_json(figures: Sequence[Figure], path: Path) -> None:
    rows = [asdict(figure) | {"met": figure.met} for figure in figures]
    path.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


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


def cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)
