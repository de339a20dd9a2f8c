"""What the orbiter says of commands of which nobody may ever tell the end.

It is no stage of their lives, which are the rover's to tell: kind LINK, without a number.
"""

from enum import Enum
from typing import Final

from adapters.bundle import DeliveryStatus
from adapters.mops.reports import UNNUMBERED
from executive.commands import Identity
from executive.reports import Kind, Report, Severity


class Loss(Enum):
    """Why nothing more is expected; the text says it of a command."""

    EXPIRED = "may not have reached the rover: its lifetime ended at the orbiter"
    DELETED = "may not have reached the rover: a node on its way deleted it"
    GIVEN_UP = "may not have reached the rover: it was given up at the orbiter"
    UNHEARD = "may not have reached the rover: nothing came down on it within its lifetime"
    FORGOTTEN = "may never be heard of again: the rover came back with a new ledger"

    def report(self, identity: Identity, utc_s: float) -> Report:
        """Return what is told."""
        text = f"{identity} {self.value}"
        return Report(UNNUMBERED, utc_s, Kind.LINK, Severity.ALARM, text, identity)


OF_FATE: Final = {DeliveryStatus.EXPIRED: Loss.EXPIRED, DeliveryStatus.DELETED: Loss.DELETED}
"""The fates of a bundle that are a loss."""
