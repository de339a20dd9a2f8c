"""`NodeRecords`: the progress of each node of a plan, as part of its state.

A node has a record as soon as it has begun. The text of a record is computed once after a change,
so that a state with few changes is stored quickly. Beyond `MAX_RECORDS_LENGTH`, the earliest ones
are stored without texts.
"""

import json
from collections.abc import Iterable
from operator import attrgetter
from typing import Any, Final, NamedTuple

from executive.plans.model import PlanNode
from executive.values.clock import Clock

MAX_TEXT_LENGTH: Final = 256
"""Maximum length in characters of a text of a record; the rest is cut; chosen."""
MAX_RECORDS_LENGTH: Final = 64 * 1024
"""Length in characters of all records beyond which texts are omitted; chosen."""


class NodeDetail(NamedTuple):
    """Present knowledge of a node.

    Attributes:
        unknown: name of the telemetry or variable that it needs and that is not known.
        next_utc_s: end of its wait, deadline or window, seconds since 1970-01-01 UTC.
    """

    node: int
    unknown: str = ""
    next_utc_s: float | None = None


class NodeRecord(NamedTuple):
    """Record of a node.

    Attributes:
        since_utc_s: when it began, ended or was halted last, seconds since 1970-01-01 UTC.
        tries: how often it began.
        result: S or F by its last end; empty before.
        reason: number of the reason of its last failure; 0 for none.
        text: why it failed last.
        decision: which branch it took last, and why.
    """

    node: int
    since_utc_s: float = 0.0
    tries: int = 0
    result: str = ""
    reason: int = 0
    text: str = ""
    decision: str = ""


def read_records(text: str) -> tuple[dict[int, NodeRecord], dict[int, NodeDetail]]:
    """Return the records and details of a text by the numbers of the nodes."""
    records, details = json.loads(text or "[[],[]]")
    return (
        {each[0]: NodeRecord(*each) for each in records},
        {each[0]: NodeDetail(*each) for each in details},
    )


def _encoded(record: NodeRecord, has_texts: bool = True) -> str:
    fields: list[Any] = list(record[:5])
    if has_texts and (record.text or record.decision):
        why = record.text
        if len(why) > MAX_TEXT_LENGTH:  # the reason is worth more than the path before it
            path, separator, text = why.partition(": ")
            why = f"{path.rpartition('/')[2]}{separator}{text}"
        fields += [why[:MAX_TEXT_LENGTH], record.decision[:MAX_TEXT_LENGTH]]
    return json.dumps(fields, separators=(",", ":"))


class NodeRecords:
    """Records of the nodes of a running plan.

    Args:
        stored: the records of its state, as text.
    """

    def __init__(self, stored: str, clock: Clock) -> None:
        self._clock = clock
        self._records = read_records(stored)[0]
        self._texts: dict[int, str] = {}
        self._reasons: dict[int, int] = {}

    def note(self, node: PlanNode, begins: bool, result: str, why: str) -> None:
        """Note that a node began, or ended with S or F; an end repeated at once counts once.

        Args:
            node: the node.
            begins: whether it begins.
            result: its result; empty while it runs.
            why: the last failure.
        """
        record = self._record(node)
        if begins and result and result == record.result:
            return
        if result == "F":
            record = record._replace(text=why, reason=self._reason(node, why))
        self._update(
            record._replace(
                since_utc_s=self._clock.utc_s(),
                tries=record.tries + begins,
                result=result or record.result,
            )
        )

    def note_halt(self, node: PlanNode) -> None:
        """Note that a node was halted."""
        self._update(self._record(node)._replace(since_utc_s=self._clock.utc_s()))

    def note_reason(self, number: int, reason: int) -> None:
        """Note the number of the reason of the failure that a node has next."""
        self._reasons[number] = reason

    def note_decision(self, node: PlanNode, text: str) -> None:
        """Note which branch a node took, and why."""
        self._update(self._record(node)._replace(decision=text))

    def note_cause(self, node: PlanNode, text: str) -> None:
        """Note why a node fails, before it ends."""
        self._update(self._record(node)._replace(text=text))

    def cause(self, node: PlanNode) -> str:
        """Return why a node failed last, or fails; empty for none."""
        return self._record(node).text

    def decision(self, node: PlanNode) -> str:
        """Return which branch a node took last, and why; empty for none."""
        record = self._records.get(node.location.number)
        return "" if record is None else record.decision

    def encoded(self, details: Iterable[NodeDetail]) -> str:
        """Return the records and the present details as text; see `read_records`."""
        text = ",".join(map(self._text, self._records.values()))
        if len(text) > MAX_RECORDS_LENGTH:
            text = ",".join(self._shortened())
        shown = json.dumps(tuple(details), separators=(",", ":"))
        return f"[[{text}],{shown}]"

    def _shortened(self) -> Iterable[str]:
        left = MAX_RECORDS_LENGTH
        for each in sorted(self._records.values(), key=attrgetter("since_utc_s"), reverse=True):
            left -= len(self._text(each))
            yield self._text(each) if left > 0 else _encoded(each, has_texts=False)

    def _record(self, node: PlanNode) -> NodeRecord:
        return self._records.get(node.location.number) or NodeRecord(node.location.number)

    def _update(self, record: NodeRecord) -> None:
        self._records[record.node] = record
        self._texts.pop(record.node, None)

    def _text(self, record: NodeRecord) -> str:
        if record.node not in self._texts:
            self._texts[record.node] = _encoded(record)
        return self._texts[record.node]

    def _reason(self, node: PlanNode, why: str) -> int:
        """Return the reason of its command, or that of the child with the same failure."""
        below = (self._records.get(each.location.number) for each in node.children)
        same = (each.reason for each in below if each is not None and each.text == why)
        return self._reasons.pop(node.location.number, 0) or next(same, 0)
