"""The agent that needs no daemon: a node, its store and its links on an asyncio loop."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from adapters.bundle.attached.daemon import Daemon
from adapters.bundle.contact_plan import ContactPlan
from adapters.bundle.database import Database, Synchronous
from adapters.bundle.eid import Eid
from adapters.bundle.errors import AgentClosed, StoreError
from adapters.bundle.gate import Gate, Override
from adapters.bundle.health import Health, NeighbourHealth
from adapters.bundle.identity import BundleId
from adapters.bundle.link import Link
from adapters.bundle.links import Links, Listen
from adapters.bundle.node import Node
from adapters.bundle.port import Delivery, Notice, Queued
from adapters.bundle.settings import NodeSettings

_LOG = logging.getLogger(__name__)
_LOOK_S: Final = 0.2
_TICK_S: Final = 1.0
_READ_AT_ONCE: Final = 64


@dataclass(slots=True)
class _Open:
    """What there is while a session is open."""

    node: Node
    links: Links
    gates: dict[str, Gate]


class EmbeddedAgent:
    """A bundle agent within this process; see `BundleAgent` for what it does.

    Everything happens on the loop of `open`. A commit waits for the disk, some milliseconds, and
    the loop with it: give the agent a loop, and so a thread, that has nothing urgent to do.

    Args:
        settings: its EIDs and neighbours.
        path: the file of its store.
        listen: where others reach it.
        plan: contacts, by ION's node numbers; None for always.
        utc_s: the time in seconds since 1970.
        synchronous: how far a commit goes.
        daemon: who carries for it, if it is attached to somebody.
    """

    def __init__(
        self,
        settings: NodeSettings,
        path: Path,
        listen: Listen | None = None,
        plan: ContactPlan | None = None,
        utc_s: Callable[[], float] = time.time,
        synchronous: Synchronous = Synchronous.FULL,
        daemon: Daemon | None = None,
    ) -> None:
        """Be ready to be opened."""
        self._settings, self._path = settings, path
        self._listen, self._daemon = listen or Listen(), daemon
        self._plan, self._utc_s, self._synchronous = plan, utc_s, synchronous
        self._state: _Open | None = None
        self._arrived = asyncio.Event()
        self._settling = False
        self._timer: asyncio.TimerHandle | None = None
        self._next_tick_s = self._next_look_s = 0.0
        self._read = 0

    async def open(self, heed: Callable[[Notice], None]) -> None:
        """Open the store and the links; see `BundleAgent`."""
        settings = self._settings
        database = Database(self._path, settings.limits, self._synchronous)
        try:
            node = Node(settings, database, lambda: int(1000 * self._utc_s()), heed)
            links = await Links.open(node, self._listen, self._wake, self._daemon)
        except BaseException:
            database.close()
            raise
        gates = {
            neighbour.name: Gate(settings.node, neighbour.node, self._plan, self._utc_s)
            for neighbour in settings.neighbours
        }
        self._state = _Open(node, links, gates)
        self._look()
        self._wake()

    @property
    def listens(self) -> Listen:
        """Where others reach it, with the ports that were free."""
        return self._opened.links.listens

    async def send(
        self,
        destination: Eid,
        payload: bytes,
        *,
        lifetime_s: float | None = None,
        confirm: bool = False,
    ) -> BundleId:
        """Take responsibility for a payload; see `BundleAgent`."""
        identity = self._opened.node.put(destination, payload, lifetime_s, confirm)
        await self.settle()
        return identity

    def must_confirm(self, destination: Eid) -> bool:
        """Return whether `confirm` is needed for what goes there; see `BundleAgent`."""
        return self._settings.must_confirm(destination)

    async def settle(self) -> None:
        """Wait until what was done is on the disk; see `BundleAgent`."""
        committed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

        def tell(failure: StoreError | None) -> None:
            if committed.done():
                return
            if failure is None:
                committed.set_result(None)
            else:
                committed.set_exception(failure)

        self._opened.node.transaction.then(tell)
        self._wake()
        await committed

    @asynccontextmanager
    async def receive(self) -> AsyncIterator[Delivery]:
        """Wait for what has arrived next; see `BundleAgent`.

        Raises:
            AgentClosed: the agent was closed meanwhile.
        """
        self._read += 1
        if not self._read % _READ_AT_ONCE:
            await asyncio.sleep(0)
        node = self._opened.node
        while (fetched := node.fetch()) is None:
            self._arrived.clear()
            await self._arrived.wait()
            if self._state is None:
                raise AgentClosed
        arrival = fetched.arrival
        try:
            yield Delivery(arrival.identity, arrival.endpoint, arrival.payload)
        except BaseException:
            node.give_back(fetched)
            self._arrived.set()
            raise
        node.delivered(fetched)
        self._wake()

    async def close(self) -> None:
        """End the session; what waits is kept."""
        if (state := self._state) is None:
            return
        await state.links.close()
        state.node.transaction.commit()
        self._state = None
        if self._timer is not None:
            self._timer.cancel()
        self._arrived.set()
        await asyncio.sleep(0)
        state.node.database.close()

    def queued(self, destination: Eid) -> Iterator[Queued]:
        """Yield what was sent to a destination and is still in the store, the newest first."""
        return self._opened.node.queued(destination)

    def override(self, neighbour: Eid, override: Override) -> None:
        """Say that there is contact with a neighbour, or none, or that the plan says so."""
        self._opened.gates[str(neighbour)].override = override
        self._look()
        self._wake()

    def set_plan(self, plan: ContactPlan | None) -> None:
        """Go by another contact plan."""
        self._plan = plan
        for gate in self._opened.gates.values():
            gate.plan = plan
        self._look()
        self._wake()

    def health(self) -> Health:
        """Return how the agent is doing."""
        state = self._opened
        node = state.node
        oldest_utc_ms = node.outbox.oldest_utc_ms()
        oldest_s = 0.0 if oldest_utc_ms is None else self._utc_s() - oldest_utc_ms / 1000
        return Health(
            queued=node.outbox.depth(),
            oldest_s=max(0.0, oldest_s),
            unread=node.inbox.depth(),
            expired=node.expired,
            malformed=node.receiving.malformed + state.links.malformed,
            room_octets=node.database.room_octets,
            full=node.database.full,
            no_room=str(node.database.no_room()) if node.database.full else "",
            neighbours=tuple(
                self._neighbour_health(neighbour.node, state.links.by_name[neighbour.name])
                for neighbour in self._settings.neighbours
            ),
        )

    @property
    def _opened(self) -> _Open:
        if self._state is None:
            raise AgentClosed
        return self._state

    def _neighbour_health(self, node: Eid, link: Link) -> NeighbourHealth:
        name = str(node)
        gate = self._opened.gates[name]
        outlook = gate.outlook()
        heard_s = link.last_heard_s
        return NeighbourHealth(
            node=node,
            queued=self._opened.node.outbox.depth(name),
            contact=outlook.contact and link.up,
            override=gate.override,
            next_contact_utc_s=outlook.next_contact_utc_s,
            last_heard_s=None if heard_s is None else asyncio.get_running_loop().time() - heard_s,
        )

    def _look(self) -> None:
        """Tell the links what the plan says."""
        state = self._opened
        for name, link in state.links.by_name.items():
            link.heed(state.gates[name].outlook())

    def _wake(self) -> None:
        """Settle soon; what comes until then is committed together."""
        if not self._settling and self._state is not None:
            self._settling = True
            asyncio.get_running_loop().call_soon(self._settle)

    def _settle(self) -> None:
        """Commit what has gathered, tell who waits, send what may go, and wait for time."""
        self._settling = False
        if (state := self._state) is None:
            return
        transaction = state.node.transaction
        try:
            if transaction.pending:
                self._arrived.set()
                transaction.commit()
            self._pass_time(state)
            for link in state.links.by_name.values():
                link.pump()
        except StoreError as error:
            _LOG.error("bundle store: %s", error)
        finally:
            if transaction.pending:
                self._wake()
            self._set_timer(state)

    def _pass_time(self, state: _Open) -> None:
        now_s = asyncio.get_running_loop().time()
        if now_s >= self._next_look_s:
            self._next_look_s = now_s + _LOOK_S
            self._look()
        for link in state.links.by_name.values():
            if (next_s := link.next_s) is not None and next_s <= now_s:
                link.tick()
        if now_s >= self._next_tick_s:
            self._next_tick_s = now_s + _TICK_S
            state.node.tick()

    def _set_timer(self, state: _Open) -> None:
        if self._timer is not None:
            self._timer.cancel()
        times_s = [link.next_s for link in state.links.by_name.values()]
        next_s = min([self._next_look_s, *(time_s for time_s in times_s if time_s is not None)])
        self._timer = asyncio.get_running_loop().call_at(next_s, self._wake)
