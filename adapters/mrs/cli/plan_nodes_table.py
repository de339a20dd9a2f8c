"""The nodes of a plan as a table: `rover plan status PLAN`."""

from collections.abc import Sequence
from datetime import UTC, datetime
from shutil import get_terminal_size
from textwrap import wrap
from typing import Final

import click

from executive.values.plan_nodes import NodeStatus, PlanNodeReport
from executive.values.reports import printable

COLUMNS: Final = ("node", "status", "since, UTC", "tries", "next, UTC", "command")
"""Titles; the text has none."""


def print_nodes(nodes: Sequence[PlanNodeReport]) -> None:
    """Print the nodes of a plan, children below their parents."""
    click.echo("\n".join(node_lines(nodes, get_terminal_size().columns)))


def node_lines(nodes: Sequence[PlanNodeReport], width: int) -> list[str]:
    """Return the nodes as lines without empty columns; a text that is too long is below its node.

    Args:
        nodes: all nodes of the plan.
        width: of the terminal in characters.
    """
    rows = [tuple(map(printable, node_row(each))) for each in nodes]
    *columns, (_, *texts) = zip((*COLUMNS, ""), *rows, strict=True)
    columns = [each for each in columns if any(each[1:])]
    widths = [max(map(len, each)) for each in columns]
    head, *lines = (
        "  ".join(map(str.ljust, cells, widths)) for cells in zip(*columns, strict=True)
    )
    found = [head.rstrip()]
    for line, text in zip(lines, texts, strict=True):
        if len(line) + 2 + len(text) <= width:
            found.append(f"{line}  {text}".rstrip())
        else:
            indent = " " * (len(line) - len(line.lstrip()) + 4)
            below = wrap(text, max(width, 60), initial_indent=indent, subsequent_indent=indent)
            found += (line.rstrip(), *below)
    return found


def node_row(node: PlanNodeReport) -> tuple[str, ...]:
    """Return a node as a table row; instead of IDLE the result of its last end is shown."""
    name = node.path.rpartition("/")[2]
    kind = "" if node.kind in {name, "SubTree"} else f" ({node.kind})"
    status = node.status
    if status is NodeStatus.IDLE and node.result is not None:
        status = node.result
    return (
        f"{'  ' * node.path.count('/')}{name}{kind}",
        "" if status is NodeStatus.IDLE else status.name,
        _time(node.since_utc_s),
        str(node.tries or ""),
        _time(node.next_utc_s),
        "" if node.command is None else str(node.command.command_id),
        "; ".join(filter(None, _texts(node))),
    )


def _texts(node: PlanNodeReport) -> tuple[str, ...]:
    open_question = node.question
    question = default = ""
    if open_question is not None:
        default = "" if open_question.default is None else f", else {open_question.default}"
        question = f"{open_question.text} ({' or '.join(open_question.options)}{default})"
    failure = "" if node.decision else node.text.partition(": ")[2]
    unknown = f"{node.unknown} is not known" if node.unknown and node.unknown not in failure else ""
    return question, unknown, node.decision, failure


def _time(utc_s: float | None) -> str:
    return "" if utc_s is None else f"{datetime.fromtimestamp(utc_s, UTC):%H:%M:%S}"
