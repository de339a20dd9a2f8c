"""The bundle agent and the rovers behind it: deliveries find their rover, and fates too."""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from adapters.bundle.agents import make_agent
from adapters.bundle.contact_plan import ContactPlan
from adapters.bundle.eid import Eid, node_of
from adapters.bundle.health import NeighbourHealth
from adapters.bundle.port import Delivery, Notice
from adapters.mops.dictionary import Dictionary
from adapters.orbiter.health import Outlook, Watch, outlook_of
from adapters.orbiter.record import Record
from adapters.orbiter.rover import RelayedRover
from adapters.orbiter.settings import OrbiterSettings
from adapters.orbiter.unrecorded import write_down
from executive.ledger import LedgerError

_LOG: Final = logging.getLogger(__name__)
_BUNDLES: Final = "bundles.sqlite"
_AGAIN_S: Final = 1.0


class Relay:
    """Commands up, reports down, for all rovers of an orbiter.

    Args:
        settings: the orbiter.
        folder: where bundles and records are kept.
        plan: planned contacts; None for always.
        dictionary: spells messages.
        utc_s: the time in seconds since 1970.

    Attributes:
        rovers: the rovers by their nodes.
        agent: the bundle agent.

    Raises:
        LedgerError: a record cannot be used.
    """

    def __init__(
        self,
        settings: OrbiterSettings,
        folder: Path,
        plan: ContactPlan | None,
        dictionary: Dictionary,
        utc_s: Callable[[], float] = time.time,
    ) -> None:
        """Open the records; no bundle moves before `open`."""
        self._settings, self._dictionary, self._utc_s = settings, dictionary, utc_s
        self.agent = make_agent(
            settings.node(), folder / _BUNDLES, settings.daemon, settings.listen, plan, utc_s
        )
        self.rovers: Mapping[Eid, RelayedRover] = {
            node_of(each.endpoint): RelayedRover(
                each,
                self.agent,
                dictionary,
                Record(folder / f"{each.asset}.sqlite", each.numbered, settings.history_reports),
                utc_s,
                settings.lifetime_s,
            )
            for each in settings.rovers
        }
        self._watches = {
            node: Watch(settings.old_after_s, rover.tell) for node, rover in self.rovers.items()
        }

    async def open(self) -> None:
        """Open the agent.

        Raises:
            StoreError: its store cannot be used.
            OSError: the network cannot.
        """
        await self.agent.open(self._heed)
        for rover in self.rovers.values():
            queued = self.agent.queued(rover.settings.endpoint)
            try:
                write_down(queued, rover.record, self._dictionary, self._utc_s())
            except LedgerError as error:  # whoever needs the record is told, too
                _LOG.error("%s", error)

    async def close(self) -> None:
        """Close the agent and the records; what waits is kept."""
        await self.agent.close()
        for rover in self.rovers.values():
            rover.record.close()

    async def receive(self) -> None:
        """Take what comes down, for as long as the agent is open."""
        while True:
            try:
                async with self.agent.receive() as delivery:
                    self._hear(delivery)
            except LedgerError as error:  # the delivery stays, and comes again
                _LOG.error("%s", error)
                await asyncio.sleep(_AGAIN_S)

    def outlook(self, node: Eid) -> Outlook:
        """Return how the way to a rover is."""
        found = next(each for each in self._neighbours() if each.node == node)
        oldest_utc_s = self.rovers[node].record.asked.oldest_utc_s()
        return outlook_of(found, oldest_utc_s, self._utc_s())

    def look(self) -> None:
        """Tell of contacts that opened or closed, and of commands that have waited too long."""
        for health in self._neighbours():
            rover = self.rovers[health.node]
            if not health.queued:
                rover.record.asked.all_left(self._utc_s())
            outlook = outlook_of(health, rover.record.asked.oldest_utc_s(), self._utc_s())
            self._watches[health.node].look(outlook, self._utc_s())

    async def ask_again(self) -> None:
        """Ask for what should have been answered, wherever the way there and back is open."""
        settings = self._settings
        if settings.ask_again_s is None:
            return
        for health in self._neighbours():
            outlook = outlook_of(health, None, self._utc_s())
            heard = outlook.last_heard_s <= settings.silent_after_s
            if outlook.contact and heard and not outlook.queued:
                await self.rovers[health.node].ask_again(settings.ask_again_s)

    def prune(self) -> None:
        """Forget what is more than the records are to keep."""
        for rover in self.rovers.values():
            rover.record.prune(self._utc_s())

    def _neighbours(self) -> tuple[NeighbourHealth, ...]:
        return self.agent.health().neighbours

    def _hear(self, delivery: Delivery) -> None:
        rover = self.rovers.get(node_of(delivery.source))
        if rover is None:
            _LOG.warning("%s is no rover here: %r", delivery.source, delivery.payload[:80])
        else:
            rover.hear(delivery)

    def _heed(self, notice: Notice) -> None:
        try:
            for rover in self.rovers.values():
                rover.heed(notice.identity, notice.fate)
        except LedgerError as error:  # the agent has nothing to do with it
            _LOG.error("%s", error)
