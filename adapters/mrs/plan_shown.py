"""How far plans have come, as people read it."""

from collections.abc import Iterable
from datetime import datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from adapters.mrs.types import PlanUpdate


def table(updates: "Iterable[PlanUpdate]") -> "Table":
    """Return plans as a table; nodes are told without the plan's name before them."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    shown = Table("plan", "status", "leaves ended", "at", "said", box=box.SIMPLE_HEAD)
    for update in updates:
        ended = f"{update.done} of {update.total}"
        texts = (update.planId, update.status.name, ended, _node(update), _text(update))
        shown.add_row(*map(escape, texts))
    return shown


class Lines:
    """Updates as lines, in the order in which they come; a remark on a leaf is told once."""

    def __init__(self) -> None:
        """Have told nothing."""
        self._told: dict[str, str] = {}

    def line(self, update: "PlanUpdate") -> str:
        """Return an update as one line: time, plan, status, leaves that ended, where, and why."""
        time = datetime.fromtimestamp(update.timestamp / 1e9)
        news = "" if self._told.get(update.planId) == update.text else _text(update)
        self._told[update.planId] = update.text or ""
        ended = f"{update.done}/{update.total} ended"
        said = (f"{time:%H:%M:%S}", update.planId, f"{update.status.name:<9}", ended, _node(update))
        return "  ".join(part for part in (*said, news) if part)


def _node(update: "PlanUpdate") -> str:
    return _short(update, update.node)


def _text(update: "PlanUpdate") -> str:
    return _short(update, update.text).removeprefix(f"{_node(update)}: ")


def _short(update: "PlanUpdate", text: str | None) -> str:
    return (text or "").replace(f"plan:{update.planId}/", "")
