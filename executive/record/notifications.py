"""`Notifications` numbers reports without gaps, commits them to the ledger, then sends them."""

import logging
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from executive.commands import Command
from executive.commands.lifecycle import StageDetails
from executive.record.ledger import Ledger
from executive.values.clock import Clock
from executive.values.ports import Downlink
from executive.values.reasons import Figure, Reason
from executive.values.reports import PlanUpdate, Report, ReportKind, Severity, Stage, printable

_LOG = logging.getLogger(__name__)

Answer = Callable[[bool], object]
"""Called with whether all earlier writes are committed."""

_SEVERITY = {
    Stage.REJECTED: Severity.WARNING,
    Stage.FAILED: Severity.ALARM,
    Stage.CANCELLED: Severity.WARNING,
    Stage.EXPIRED: Severity.WARNING,
}


class Notifications:
    """The only output of the core for reports.

    Attributes:
        last_sequence: number of the last committed report.
    """

    def __init__(self, clock: Clock, ledger: Ledger, downlinks: Sequence[Downlink]) -> None:
        self._clock = clock
        self._ledger = ledger
        self._downlinks = downlinks
        self.last_sequence = ledger.last_sequence
        self._outbox: deque[tuple[int, float, list[Report] | PlanUpdate | Answer]] = deque()

    def command(self, command: Command, stage: Stage, note: StageDetails) -> None:
        """Report that a command reached a stage. A stage not requested is only recorded."""
        if stage is Stage.RECEIVED:
            self._ledger.record(command)
        self._ledger.set_stage(command.identity, stage)
        if stage is Stage.STARTED and not command.report_started:
            return
        if stage is Stage.PROGRESS and not command.report_progress:
            return
        refusal = note.refusal
        self._append(
            ReportKind.COMMAND,
            _SEVERITY.get(stage, Severity.INFORMATIONAL),
            refusal.text if refusal else note.text or command.name,
            identity=command.identity,
            stage=stage,
            link=command.link,
            step=note.step,
            step_count=note.step_count,
            reason=refusal.reason if refusal else None,
            figures=(*refusal.figures, *note.figures) if refusal else note.figures,
            fault=refusal.fault if refusal else None,
            cause=refusal.cause if refusal else None,
        )

    def report_event(
        self,
        severity: Severity,
        text: str,
        reason: Reason | None = None,
        figures: tuple[Figure, ...] = (),
        kind: ReportKind = ReportKind.EVENT,
        foreign: bool = False,
        fault: str | None = None,
        publishers: tuple[str, ...] | None = None,
    ) -> None:
        """Report an onboard event that concerns no command, or an event of a link.

        Foreign are events that external senders can cause in any number; see `Retention`.
        """
        details = {"figures": figures, "fault": fault, "publishers": publishers}
        self._append(kind, severity, text, foreign, reason=reason, **details)

    def prediction(self, text: str, figures: tuple[Figure, ...], command: Command | None) -> None:
        """Report the prediction of a command's motion, which is no stage of its life cycle."""
        identity = None if command is None else command.identity
        link = None if command is None else command.link
        severity = Severity.INFORMATIONAL
        self._append(
            ReportKind.EVENT, severity, text, identity=identity, link=link, figures=figures
        )

    def report_plan_update(self, update: PlanUpdate) -> None:
        """Report the progress of a plan."""
        self._add(update)

    def resend(self, report: Report) -> None:
        """Send a report again, under its own number."""
        self._send_later(report)

    def answer(self, answer: Answer) -> None:
        """Call a function once all earlier writes are committed, or the ledger fails."""
        self._add(answer)

    @property
    def pending(self) -> bool:
        """Whether reports wait for the next commit."""
        return bool(self._outbox) and self._outbox[-1][0] > self._ledger.sealed

    @property
    def waiting(self) -> bool:
        """Whether reports or answers are still to be sent."""
        return bool(self._outbox)

    @property
    def commit_wait_s(self) -> float:
        """Waiting time of the first report or answer that is not committed, s; 0 without one."""
        return self._clock.now_s() - self._outbox[0][1] if self._outbox else 0.0

    def send_committed(self) -> None:
        """Send committed reports and answers in order; a failing ledger ends answers as refused."""
        durable = self._ledger.state.durable
        while self._outbox and self._outbox[0][0] <= durable:
            self._send(self._outbox.popleft()[2])
        if self._ledger.failing:
            unsent, self._outbox = self._outbox, deque()
            for each in unsent:
                if callable(each[2]):
                    each[2](False)
                else:
                    self._outbox.append(each)

    def _send(self, item: list[Report] | PlanUpdate | Answer) -> None:
        if callable(item):
            item(True)
            return
        for downlink in self._downlinks:
            if isinstance(item, PlanUpdate):
                downlink.send_plan_update(item)
            else:
                downlink.send_reports(item)
        if isinstance(item, list):
            self.last_sequence = max(self.last_sequence, item[-1].sequence)

    def _send_later(self, report: Report) -> None:
        batch = self._ledger.last_batch
        if self._outbox and self._outbox[-1][0] == batch:
            last = self._outbox[-1][2]
            if isinstance(last, list):
                last.append(report)
                return
        self._add([report])

    def _add(self, item: list[Report] | PlanUpdate | Answer) -> None:
        self._outbox.append((self._ledger.last_batch, self._clock.now_s(), item))

    def _append(
        self, kind: ReportKind, severity: Severity, text: str, foreign: bool = False, **details: Any
    ) -> None:
        number = self._ledger.last_sequence + 1
        report = Report(number, self._clock.utc_s(), kind, severity, printable(text), **details)
        self._ledger.append_report(report, foreign)
        self._send_later(report)
        _LOG.info(
            "%s %s %s",
            report.identity or report.kind.name,
            report.stage.name if report.stage else report.severity.name,
            report.text,
        )
