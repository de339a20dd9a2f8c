"""The bundle agent and the rovers behind it: deliveries find their rover, and fates too."""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from typing import Final

from adapters.bundle import ContactPlan, Delivery, Eid, NeighbourHealth, Notice, make_agent, node_of
from adapters.mops.dictionary import Dictionary
from adapters.orbiter.health import Outlook, Watch, outlook_of
from adapters.orbiter.record import Record
from adapters.orbiter.rover import RelayedRover
from adapters.orbiter.settings import OrbiterSettings
from adapters.orbiter.unrecorded import write_down
from executive.ledger import LedgerError
from executive.reports import Severity

GRACE_S: Final = 120.0
"""How much later than its lifetime a command is given up where nothing is asked for again."""
_LOG: Final = logging.getLogger(__name__)
_BUNDLES: Final = "bundles.sqlite"
_AGAIN_S: Final = 1.0
_STORE: Final = "the orbiter's store"


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
                settings.ask_again_s or GRACE_S,
            )
            for each in settings.rovers
        }
        self._full = False
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
        health = self.agent.health()
        return self._outlook(
            next(each for each in health.neighbours if each.node == node), health.room_octets
        )

    def look(self) -> None:
        """Tell of contacts that opened or closed, of a full store, and of what waits too long."""
        health = self.agent.health()
        self._tell_if_full(health.no_room)
        for neighbour in health.neighbours:
            if not neighbour.queued:
                self.rovers[neighbour.node].record.asked.all_left(self._utc_s())
            outlook = self._outlook(neighbour, health.room_octets)
            self._watches[neighbour.node].look(outlook, self._utc_s())

    async def ask_again(self) -> None:
        """Ask for what should have been answered, wherever the way there and back is open."""
        settings = self._settings
        if settings.ask_again_s is None:
            return
        for each in self.agent.health().neighbours:
            silent_s = inf if each.last_heard_s is None else each.last_heard_s
            if each.contact and silent_s <= settings.silent_after_s and not each.queued:
                await self.rovers[each.node].ask_again(settings.ask_again_s)

    def prune(self) -> None:
        """Forget what is more than the records are to keep."""
        for rover in self.rovers.values():
            rover.record.prune(self._utc_s())

    def _outlook(self, health: NeighbourHealth, room_octets: int) -> Outlook:
        oldest_utc_s = self.rovers[health.node].record.asked.oldest_utc_s()
        return outlook_of(health, room_octets, oldest_utc_s, self._utc_s())

    def _tell_if_full(self, why: str) -> None:
        if bool(why) == self._full:
            return
        self._full = bool(why)
        severity = Severity.WARNING if why else Severity.INFORMATIONAL
        text = f"{_STORE} is full: {why}" if why else f"{_STORE} has room again"
        for rover in self.rovers.values():
            rover.tell(severity, text)

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
