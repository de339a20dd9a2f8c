"""Takes commands for a rover: what is for the way there is done here, the rest goes up."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from adapters.bundle import BundleError, ContactOverride
from adapters.mal.errors import StandardError
from adapters.mops.reports import LINK, UNNUMBERED
from adapters.mrs.errors import AreaError, with_text
from adapters.orbiter.contacts import BY_PLAN
from adapters.orbiter.lines import CONTACT
from adapters.orbiter.rover import RelayedRover
from executive.commands import Command, ExecuteAction
from executive.ledger import LedgerError
from executive.reports import Kind, Report, Severity, Stage

ORDERS: Final = {
    f"{CONTACT} UP": ContactOverride.UP,
    f"{CONTACT} DOWN": ContactOverride.DOWN,
    BY_PLAN: ContactOverride.BY_PLAN,
}
"""Text commands of Action.execute that the orbiter carries out itself."""


class OrbiterIntake:
    """An `adapters.mrs.command_service.Intake`.

    Args:
        rover: to whom commands go.
        order: does what an operator says of the way there, and returns what holds then; raises
            BundleError.
        utc_s: the time in seconds since 1970.
    """

    def __init__(
        self,
        rover: RelayedRover,
        order: Callable[[ContactOverride], str],
        utc_s: Callable[[], float],
    ) -> None:
        """Wait for commands."""
        self._rover, self._order, self._utc_s = rover, order, utc_s

    async def submit(self, command: Command) -> None:
        """Have a command sent up, or carry it out.

        Raises:
            MalError: it was not taken, or was taken before.
        """
        request = command.request
        if isinstance(request, ExecuteAction):
            words = request.action.upper().split()
            if words[:1] == [CONTACT]:
                await self._carry_out(command, " ".join(words))
                return
            if not self._rover.settings.serves("Action", "execute"):
                text = f"the rover has no actions; at the orbiter there are: {', '.join(ORDERS)}"
                raise with_text(AreaError.NOT_SUPPORTED, text)
        await self._rover.submit(command)

    async def _carry_out(self, command: Command, action: str) -> None:
        await self._rover.require_new(command)
        override = ORDERS.get(action)
        if override is None:
            text = f"there is no action {action[:40]!r}; there are: {', '.join(ORDERS)}"
            raise with_text(AreaError.NOT_SUPPORTED, text)
        try:
            said = self._order(override)
        except BundleError as error:
            raise with_text(AreaError.REJECTED, str(error)) from error
        now_s = self._utc_s()
        report = Report(
            *(UNNUMBERED, now_s, Kind.COMMAND, Severity.INFORMATIONAL, said, command.identity),
            *(Stage.EXECUTED, LINK),
        )
        try:
            self._rover.carried_out(replace(command, link=LINK), report)
        except LedgerError as error:
            raise with_text(StandardError.INTERNAL, str(error)) from error
