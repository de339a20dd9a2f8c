"""The nodes of a plan as a table: `rover plan status PLAN`."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

from adapters.mrs.cli.terminal import print_table
from executive.values.plan_nodes import NodeStatus, PlanNodeReport

COLUMNS: Final = ("node", "status", "since, UTC", "tries", "next, UTC", "command", "text")


def print_nodes(nodes: Sequence[PlanNodeReport]) -> None:
    """Print the nodes of a plan, children below their parents."""
    print_table(map(node_row, nodes), *COLUMNS)


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
