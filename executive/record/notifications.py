"""`Notifications` numbers reports without gaps, commits them to the ledger, then sends them."""

import logging
from collections.abc import Sequence
from typing import Any

from executive.commands import Command
from executive.commands.lifecycle import StageDetails
from executive.record.ledger import Ledger
from executive.values.clock import Clock
from executive.values.ports import Downlink
from executive.values.reasons import Figure, Reason
from executive.values.reports import PlanUpdate, Report, ReportKind, Severity, Stage, printable

_LOG = logging.getLogger(__name__)

_SEVERITY = {
    Stage.REJECTED: Severity.WARNING,
    Stage.FAILED: Severity.ALARM,
    Stage.CANCELLED: Severity.WARNING,
    Stage.EXPIRED: Severity.WARNING,
}


class Notifications:
    """The only output of the core for reports."""

    def __init__(self, clock: Clock, ledger: Ledger, downlinks: Sequence[Downlink]) -> None:
        self._clock = clock
        self._ledger = ledger
        self._downlinks = downlinks
        self._outbox: list[list[Report] | PlanUpdate] = []

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
        self._outbox.append(update)

    def resend(self, report: Report) -> None:
        """Send a report again, under its own number."""
        self._send_later(report)

    @property
    def pending(self) -> bool:
        """Whether reports are pending since the last flush."""
        return bool(self._outbox)

    def flush(self) -> None:
        """Commit pending reports, then send them.

        Raises:
            LedgerError: the commit failed; nothing is sent, and the next flush tries again.
        """
        self._ledger.commit()
        outbox, self._outbox = self._outbox, []
        for report in outbox:
            for downlink in self._downlinks:
                if isinstance(report, PlanUpdate):
                    downlink.send_plan_update(report)
                else:
                    downlink.send_reports(report)

    def _send_later(self, report: Report) -> None:
        if self._outbox and isinstance(last := self._outbox[-1], list):
            last.append(report)
        else:
            self._outbox.append([report])

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
