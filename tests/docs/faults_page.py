"""Writes the tables of docs/faults.md anew: `python -m tests.docs.faults_page`."""

from collections.abc import Iterator
from pathlib import Path

from executive.faults import (
    DECLARED,
    FIGURES,
    ClearPolicy,
    FaultDeclaration,
    FaultParameter,
    FaultResponse,
    Reaction,
    Window,
)

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"
TITLE = "| fault | reason | meaning | monitored | bounds | reaction | pose uncertain by |"
SOURCES = "| fault | source of its figures |"


def faults_page() -> str:
    """Return the page with its tables as the declarations have them."""
    page = PAGE.read_text(encoding="utf-8")
    for rows in (_rows(), _sources()):
        title = next(rows)
        before, _, after = page.partition(title)
        rest = after.partition("\n\n")[2]
        page = before + "\n".join((title, *rows)) + "\n\n" + rest
    return page


def _sources() -> Iterator[str]:
    yield SOURCES
    yield "|---|---|"
    for declared in DECLARED.values():
        yield f"| `{declared.name}` | {declared.source} |"


def _rows() -> Iterator[str]:
    yield TITLE
    yield "|---|---|---|---|---|---|---|"
    for declared in DECLARED.values():
        row = declared.row
        reason = f"{declared.reason.value} {declared.reason.name}"
        then = _then(row)
        cells = (f"`{declared.name}`", reason, declared.summary, row.when.value)
        disproves = declared.disproves.value if declared.disproves else ""
        yield f"| {' | '.join((*cells, _shows(declared), then, disproves))} |"


def _then(row: FaultResponse) -> str:
    if row.reaction is Reaction.IGNORE:
        return "ignore"
    until = "until a resume" if row.clears is ClearPolicy.ON_RESUME else "while the evidence lasts"
    return f"{row.reaction.value}, {until}"


def _shows(declared: FaultDeclaration) -> str:
    first, *others = declared.row.windows
    message = [f"`{each.name}: {{{_plain(each)}}}`" for each in (first, *others) if others]
    meant = (declared.above, declared.below, declared.ratio, declared.window)
    for key, bound, value in zip(FIGURES, meant, _figures(first), strict=False):
        if bound is not None and value is not None:
            figure = f"in {bound.unit}" if others else f"{value:g} {bound.unit}"
            message.append(_bounded(key, figure if bound.unit or not others else "", bound))
    if first.for_s and not others:
        message.append(f"`for` {first.for_s:g} s")
    return "<br>".join(message) or "at once"


def _plain(window: Window) -> str:
    figures = zip(FIGURES, _figures(window), strict=True)
    return ", ".join(f"{key}: {value:g}" for key, value in figures if value)


def _figures(window: Window) -> tuple[float | None, ...]:
    return window.above, window.below, window.ratio, window.window_s, window.for_s


def _bounded(key: str, figure: str, bound: FaultParameter) -> str:
    what = "" if key == "window" else f": {bound.description}"
    return f"`{key}` {figure}".rstrip() + f"{what} ({bound.low:g} to {bound.high:g})"


if __name__ == "__main__":
    PAGE.write_text(faults_page(), encoding="utf-8")
