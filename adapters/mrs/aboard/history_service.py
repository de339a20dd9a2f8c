"""`HistoryService`: sends the history that explains a command or the rover's present state."""

import asyncio
from collections.abc import Container, Iterator, Sequence
from dataclasses import replace
from typing import Final

from adapters.explanation import select_for
from adapters.mal import CallContext
from adapters.mrs import spec as wire
from adapters.mrs.aboard.gateway import CoreGateway
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.spec import wire_history
from executive.commands import request_text
from executive.core.runner import Executive
from executive.history import ReceivedCommand, RunHistory
from executive.history.history_builder import HistoryBuilder
from executive.values.reports import Identity, Report

MAX_REPORTS: Final = 1000
"""Maximum reports read from the ledger at once."""
REPORTS_AFTER_END: Final = 8
"""Reports after the end of a command, which include those of a stop that ended it."""


class HistoryService:
    """Serves `Notification.getHistory`.

    The core's thread, on which `history` runs, only copies references. A separate thread selects
    and encodes the answer, so that a stop is not delayed.
    """

    def __init__(
        self, served: ServedOperations, gateway: CoreGateway, history: HistoryBuilder
    ) -> None:
        self._gateway = gateway
        self._history = history
        served.serve("Notification", "getHistory", self._get)

    async def _get(
        self, _: CallContext, source: str | None, number: int | None, everything: bool
    ) -> tuple[wire.History]:
        known = await self._gateway.query(
            lambda executive: self._recorded_history(executive, number)
        )
        command = str(number) if source is None else f"{source}:{number}"
        wanted = None if number is None else command
        return (await asyncio.to_thread(_wire_history_of, known, wanted, everything),)

    def _recorded_history(self, executive: Executive, number: int | None) -> RunHistory:
        """Return the recorded history; for a command also its reports in the ledger."""
        history = self._history.history()
        if number is None:
            return history
        own = [each for each in executive.reports(1, number) if each.stage is not None]
        reports = {each.sequence: each for each in (*own, *history.reports)}
        first = history.reports[0].sequence if history.reports else executive.last_sequence
        if own and own[0].sequence < first:
            reported = own[-1].sequence - own[0].sequence + 1
            stored = executive.reports(
                own[0].sequence, count=min(reported + REPORTS_AFTER_END, MAX_REPORTS)
            )
            reports |= {each.sequence: each for each in stored}
        received = {each.identity for each in history.received}
        return replace(
            history,
            reports=tuple(reports[each] for each in sorted(reports)),
            received=(*_received_before(executive, own, received), *history.received),
        )


def _received_before(
    executive: Executive, reports: Sequence[Report], known: Container[Identity]
) -> Iterator[ReceivedCommand]:
    """Yield the commands of reports that are not in `known`, as far as the ledger has them."""
    for each in {report.identity: report for report in reversed(reports)}.values():
        if each.identity is None or each.identity in known or each.link is None:
            continue
        request = executive.request_of(each.identity)
        if request is not None:
            name, text = type(request).__name__, request_text(request)
            yield ReceivedCommand(each.identity, text, name, each.link, each.utc_s)


def _wire_history_of(known: RunHistory, command: str | None, everything: bool) -> wire.History:
    if everything:
        return wire_history(replace(known, leaves=(), fastest=()))
    return wire_history(select_for(known, command))
