"""Serves what explains a command, or what the rover does now."""

from dataclasses import replace

from adapters.explanation import Chronicle, relevant
from adapters.explanation.builder import ChronicleBuilder
from adapters.mal import Call
from adapters.mrs import spec as wire
from adapters.mrs.aboard.gateway import Gateway
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.spec import wire_history
from executive.runner import Executive


class HistoryService:
    """Serves `Notification.getHistory`.

    On the core's thread values are only copied; what of them is sent is chosen on the link's loop.

    Args:
        served: where.
        gateway: the way to the executive.
        history: what the executive recorded, on the core's thread.
    """

    def __init__(
        self, served: ServedOperations, gateway: Gateway, history: ChronicleBuilder
    ) -> None:
        self._gateway = gateway
        self._history = history
        served.serve("Notification", "getHistory", self._get)

    async def _get(
        self, _: Call, source: str | None, number: int | None, everything: bool
    ) -> tuple[wire.History]:
        known = await self._gateway.ask(lambda executive: self._known(executive, number))
        if everything:
            return (wire_history(replace(known, leaves=(), fastest=())),)
        command = str(number) if source is None else f"{source}:{number}"
        return (wire_history(relevant(known, None if number is None else command)),)

    def _known(self, executive: Executive, number: int | None) -> Chronicle:
        """Return what is known, of a command also what only the ledger knows."""
        chronicle = self._history.chronicle()
        if number is None:
            return chronicle
        reports = {each.sequence: each for each in executive.reports(1, number)}
        reports |= {each.sequence: each for each in chronicle.reports}
        return replace(chronicle, reports=tuple(reports[each] for each in sorted(reports)))
