"""`CommandOutcome` from a command's notifications, or from its storage or loss at an orbiter."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import inf, isinf
from typing import Final

from adapters.mal import MalError
from adapters.mrs.spec import ReceivedReport, ReceivedValue, lost_command
from executive.commands import Command
from executive.values.reports import Report, ReportKind, Stage

OnReport = Callable[[ReceivedReport], None]


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """The outcome of a command.

    Attributes:
        reports: the reports of its stages, in the order of reception.
        refusal: the error answer, if it was not accepted.
        loss: the relay's report of its loss: whether the rover received it is unknown.
        prediction: the rover's motion prediction; None without one.
    """

    command: Command
    reports: tuple[Report, ...]
    refusal: MalError | None = None
    loss: Report | None = None
    prediction: Report | None = None

    @property
    def executed(self) -> bool:
        """Whether this command was executed with success."""
        return self.refusal is None and self.stage is Stage.EXECUTED

    @property
    def stage(self) -> Stage | None:
        """The last known stage, or None."""
        return self.reports[-1].stage if self.reports else None


class CommandWatch:
    """Collects the reports of one command until it ends or is lost at a relay.

    Attributes:
        outcome: its outcome by the received reports.
        ended: completes at the last expected report.
    """

    def __init__(self, command: Command, on_report: OnReport) -> None:
        self._on_report = on_report
        self.outcome = CommandOutcome(command, ())
        self.ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    @property
    def has_reports(self) -> bool:
        """Whether a report was received, or the watch has ended."""
        return bool(self.outcome.reports) or self.ended.done()

    def on_report(self, received: ReceivedReport) -> None:
        """Process a report of this command; an exception of the callback ends the watch."""
        report, known = received.report, self.outcome
        if self.ended.done():
            return
        if lost_command(report) == known.command.identity:
            self.outcome = replace(known, loss=report)
        elif not self._is_new(report):
            return
        elif report.stage is None:
            self.outcome = replace(known, prediction=report)
        else:
            self.outcome = replace(known, reports=(*known.reports, report))
        try:
            self._on_report(received)
        except Exception as fault:
            self.fail(fault)
        if self.ended.done():
            return
        if self.outcome.loss is not None or (report.stage is not None and report.stage.terminal):
            self.ended.set_result(None)

    def fail(self, fault: Exception) -> None:
        """End the watch with an unknown result of the command."""
        if not self.ended.done():
            self.ended.set_exception(fault)
            self.ended.exception()  # marks it as retrieved; waiting tasks still receive it

    def _is_new(self, report: Report) -> bool:
        known = self.outcome
        return (
            report.identity == known.command.identity
            and report.kind is not ReportKind.LINK
            and all(
                each is None or each.sequence != report.sequence
                for each in (*known.reports, known.prediction)
            )
        )


DTN_QUEUED: Final = "DTN_QUEUED"
DTN_OLDEST_AGE: Final = "DTN_OLDEST_AGE"
NEXT_CONTACT: Final = "DTN_NEXT_CONTACT"
"""Parameter of every relay: time until the next contact in s, 0 during one."""
LAST_RECEIVED: Final = "DTN_LAST_RECEIVED"
"""Parameter: time since the last contact with the rover, in s."""
OVERRIDE: Final = "DTN_OVERRIDE"
"""Parameter: operator's override of the contact: 1 up, -1 down, 0 as planned."""


async def describe_storage(
    get_value: Callable[..., Awaitable[Sequence[ReceivedValue]]],
) -> str | None:
    """Return the storage of an accepted command without report; None without a relay.

    Args:
        get_value: queries the peer for parameters by name.

    Raises:
        ConnectionError: the link does not recover.
    """
    try:
        values = await get_value(NEXT_CONTACT, LAST_RECEIVED, OVERRIDE)
    except MalError:
        return None
    left, age, override = (each.value for each in values)
    when = describe_next_contact(left if isinstance(left, float) else inf, values[0].utc_s)
    if isinstance(override, float) and override < 0:
        when = "contact disabled by the operator until CONTACT PLAN"
    elif age is None:
        when += "; no contact with the rover yet"
    return f"at the orbiter; {when}"


def describe_next_contact(left_s: float, utc_s: float) -> str:
    """Return a text on the next contact, `left_s` seconds after a UTC time."""
    if isinf(left_s):
        return "no contact, and none is planned"
    if left_s <= 0.0:
        return "contact now"
    return f"next contact at {datetime.fromtimestamp(utc_s + left_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
