"""`sent_commands`: each sent command and its results, as reported to the ground on its links."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from executive.commands import request_text
from executive.values.reports import Report, Stage
from sim.scenario.record import Answer, Receipt, Record, SentCommand, reports_expiry

RELAY: Final = "relay"
DUPLICATE: Final = "DUPLICATE"
"""Ending of a command that was sent before over the same link."""
_ANSWERED: Final = {Answer.REJECTED: Stage.REJECTED.name, Answer.LOST: "LOST"}


@dataclass(frozen=True, slots=True)
class CommandTrace:
    """A command that was sent, or sent again, with its reports.

    Attributes:
        title: text of the request.
        again: whether it was sent before over any link.
        known: whether it was sent before over the same link.
        receipts: receipts of its life-cycle reports on its link, each once and in order.
        expiry: receipt of the report that its lifetime ended at the orbiter.
    """

    sending: SentCommand
    title: str
    again: bool
    known: bool
    receipts: tuple[Receipt, ...]
    expiry: Receipt | None

    @property
    def link(self) -> str:
        """Link over which it was sent."""
        return self.sending.link

    @property
    def stage(self) -> Stage | None:
        """Last reported stage."""
        return self.receipts[-1].report.stage if self.receipts else None

    @property
    def stored(self) -> bool:
        """Whether the orbiter has stored it."""
        return self.link == RELAY and self.sending.answer is Answer.ACCEPTED

    @property
    def ending(self) -> str | None:
        """Ending: name of a stage, DUPLICATE or LOST; None before the end."""
        answer, stage = self.sending.answer, self.stage
        if answer is Answer.DUPLICATE or self.known:
            return DUPLICATE
        if stage is not None and stage.terminal:
            return stage.name
        if self.expiry is not None:
            return Stage.EXPIRED.name
        return _ANSWERED.get(answer)

    @property
    def ended(self) -> Receipt | None:
        """Receipt of its final report."""
        if self.stage is not None and self.stage.terminal:
            return self.receipts[-1]
        return self.expiry

    @property
    def text(self) -> str:
        """Text of its last report: reason of the end, or progress."""
        if self.ending == DUPLICATE:
            if self.receipts:
                return f"reported again: {self._report_text(self.receipts[-1].report)}"
            return self.sending.text.partition(": ")[2]
        if self.expiry is not None:
            return self.expiry.report.text.partition(": ")[2]
        return self._report_text(self.receipts[-1].report) if self.receipts else self.sending.text

    def at(self, stage: Stage) -> Receipt | None:
        """Return the receipt of the first report of a stage, or None."""
        return next((each for each in self.receipts if each.report.stage is stage), None)

    def _report_text(self, report: Report) -> str:
        if report.text == self.title.partition(" ")[0]:
            return ""
        return f"{report.text} (reason {report.reason.value})" if report.reason else report.text


def sent_commands(record: Record) -> Iterator[CommandTrace]:
    """Yield the sent commands of a live run in their order."""
    requests = {each.identity: request_text(each.request) for each in record.requested}
    links: dict[object, set[str]] = {}
    for sending in record.sendings:
        identity = sending.identity
        before = links.setdefault(identity, set())
        received = [
            each
            for each in record.receipts
            if each.link == sending.link and each.time_s >= sending.time_s
        ]
        stages: dict[int, Receipt] = {}
        known = sending.link in before
        if not known:
            for each in received:
                if each.report.identity == identity and each.report.stage is not None:
                    stages.setdefault(each.report.sequence, each)
        expiry = (each for each in received if reports_expiry(each.report, identity))
        yield CommandTrace(
            sending,
            requests.get(identity, sending.label),
            bool(before),
            known,
            tuple(stages[sequence] for sequence in sorted(stages)),
            next(expiry, None),
        )
        if sending.answer is not Answer.LOST:
            before.add(sending.link)
