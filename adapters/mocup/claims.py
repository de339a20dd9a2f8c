"""Tells the direct link's other end which commands the executive carries out (thesis 6.2).

`rover-nxt` stands where both links meet. It has to know the commands that come to the brick in
parts, or not yet, or not at all, to know the relay's copy of one; and what is reported on them, to
tell the relay. A claim is the command as a MOPS message with RECEIVED set; a report is a reply.
"""

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Final

from adapters.mops import Dictionary, Message, MopsError, encode, reply_of
from executive.commands import Request
from executive.reports import Identity, PlanUpdate, Report, Stage
from executive.state import FileEvent, ParameterValue

_TOLD: Final = frozenset(Stage) - {Stage.RECEIVED, Stage.REJECTED, Stage.PROGRESS}
_LOG: Final = logging.getLogger(__name__)


class ClaimAnnouncer:
    """A downlink, as `executive.ports.Downlink` says, to what stands before the brick.

    What the executive refused is not claimed: there is nothing that could be done twice. Nor is
    what no message can ask for.

    Args:
        request_of: returns what a command asked for, if it is known.
        send: takes each message on its way.
        brick: name of the brick, and of who reports.
    """

    def __init__(
        self,
        dictionary: Dictionary,
        request_of: Callable[[Identity], Request | None],
        send: Callable[[Message], None],
        brick: str,
    ) -> None:
        self._dictionary = dictionary
        self._request_of = request_of
        self._send = send
        self._brick = brick

    def report(self, report: Report) -> None:
        """Claim a command that was accepted; tell what else becomes of it."""
        self._tell(report, report.stage is Stage.ACCEPTED)

    def again(self, reports: Iterable[Report]) -> None:
        """Claim the commands of reports, and tell the last one on each: they may be news."""
        last = {each.identity: each for each in reports if each.stage in _TOLD}
        for report in last.values():
            self._tell(report, claimed=True)

    def _tell(self, report: Report, claimed: bool) -> None:
        if report.identity is None or report.stage not in _TOLD:
            return
        request = self._request_of(report.identity)
        if request is None:
            return
        try:
            command = self._dictionary.command(request, report.identity, self._brick)
            told = reply_of(report, self._dictionary.entry(command), self._brick)
            messages = [replace(command, received=True), told] if claimed else [told]
            for message in messages:
                encode(message)
        except MopsError as error:
            _LOG.debug("%s has no message: %s", report.identity, error)
            return
        for message in messages:
            self._send(message)

    def telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Tell nothing: the brick measures."""

    def file(self, event: FileEvent) -> None:
        """Tell nothing."""

    def plan(self, update: PlanUpdate) -> None:
        """Tell nothing: what a plan commands is reported."""
