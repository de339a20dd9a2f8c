"""The bundle agent: a node, its store and its links on an asyncio loop."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Final

from adapters.bundle.codec.bundle import BundleId
from adapters.bundle.codec.eid import Eid
from adapters.bundle.codec.errors import AgentClosed, BundleError, StoreError
from adapters.bundle.links.contact import ContactGate, ContactOverride, ContactPlan
from adapters.bundle.links.link import Endpoint, Link, LinkContext
from adapters.bundle.links.ltp import LtpEndpoint
from adapters.bundle.links.tcpcl import TcpclEndpoint
from adapters.bundle.links.udp import UdpEndpoint
from adapters.bundle.node.database import BundleDatabase
from adapters.bundle.node.node import BundleNode
from adapters.bundle.node.reporting import DeliveryNotice, Traffic
from adapters.bundle.node.security import Security
from adapters.bundle.node.settings import (
    AnyLink,
    DaemonLink,
    IonSettings,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
    TcpclLink,
    UdpLink,
)
from adapters.bundle.node.store import Delivery, Queued
from adapters.system import OPERATING_SYSTEM, System

_LOG: Final = logging.getLogger(__name__)
_CONTACT_LOOK_S: Final = 0.2
_TICK_S: Final = 1.0
_READ_AT_ONCE: Final = 32
_MISSING: Final = {
    LtpLink: "LTP: listen for it",
    UdpLink: "UDP: listen for it",
    DaemonLink: "a daemon: attach to one",
}


@dataclass(frozen=True, slots=True)
class NeighbourHealth:
    """How the link to one neighbour is doing.

    Attributes:
        queued: how many bundles wait for it or for a confirmation.
        contact: whether something may be sent to it now.
        override: what the operator has ordered.
        next_contact_utc_s: when the next contact is planned to begin; infinity if none is, or if
            the operator keeps it closed.
        last_heard_s: how long ago something came from it; None for never.
        traffic: what went over the link.
    """

    node: Eid
    queued: int
    contact: bool
    override: ContactOverride
    next_contact_utc_s: float
    last_heard_s: float | None
    traffic: Traffic


@dataclass(frozen=True, slots=True)
class Health:
    """How an agent is doing.

    Attributes:
        queued: how many bundles are in the outbox.
        oldest_s: how long the oldest of them has been there.
        unread: how many units wait for the application.
        expired: how many bundles ended here with their lifetime, ever.
        malformed: how many could not be read since the start.
        room_octets: how much the store still takes.
        no_room: why it refuses more; empty where it does not.
        refused: how many were not taken since the start: not rightly signed, or beyond a bound.
    """

    queued: int
    oldest_s: float
    unread: int
    expired: int
    malformed: int
    room_octets: int
    no_room: str
    neighbours: tuple[NeighbourHealth, ...]
    refused: int = 0


class _Session:
    """The parts of an open agent: the node, its endpoints, links and contact gates."""

    def __init__(self, context: LinkContext) -> None:
        self.node = context.node
        self.endpoints: dict[type[AnyLink], Endpoint] = {}
        self.links: dict[str, Link] = {}
        self.gates: dict[str, ContactGate] = {}
        self._context = context

    async def open(self, listen: Listen, daemon: IonSettings | None) -> None:
        """Make the endpoints and the links to all neighbours, and open them."""
        self.endpoints[TcpclLink] = TcpclEndpoint(self._context, listen.tcpcl)
        if listen.udp is not None:
            self.endpoints[UdpLink] = UdpEndpoint(self._context, listen.udp)
        if listen.ltp is not None:
            self.endpoints[LtpLink] = LtpEndpoint(self._context, listen.ltp)
        if daemon is not None:
            from adapters.bundle.daemons.ion_client import IonClient

            self.endpoints[DaemonLink] = IonClient(daemon, self._context)
        for neighbour in self.node.settings.neighbours:
            self.links[neighbour.name] = self._link(neighbour)
        for endpoint in self.endpoints.values():
            await endpoint.open()

    async def close(self) -> None:
        """Close the endpoints, the daemon first, then the links."""
        for endpoint in reversed(self.endpoints.values()):
            await endpoint.close()
        for link in self.links.values():
            link.close()

    @property
    def listens(self) -> Listen:
        """Where the links listen, with the actual ports."""
        address = {kind: endpoint.address for kind, endpoint in self.endpoints.items()}
        return Listen(address.get(LtpLink), address[TcpclLink], address.get(UdpLink))

    def _link(self, neighbour: Neighbour) -> Link:
        kind = type(neighbour.link)
        if (endpoint := self.endpoints.get(kind)) is None:
            raise BundleError(f"{neighbour.name} is reached by {_MISSING[kind]}")
        return endpoint.link(neighbour)


class BundleAgent:
    """An agent with a session, an endpoint to send from and endpoints to receive at (thesis 6.3).

    Everything happens on the loop of `open`. A commit waits for the disk, some milliseconds, and
    the loop with it: give the agent a loop, and so a thread, that has nothing urgent to do.

    Args:
        settings: its EIDs and neighbours.
        path: the file of its store.
        listen: where others reach it.
        plan: contacts, by ION's node numbers; None for always.
        daemon: the node of ION that sends and receives for it; None for links of its own.
        security: signs and verifies, see `load_security`; None for neither.
        system: its clock, disk and sockets.

    Raises:
        BundleError: the daemon cannot do what is asked; the text says what.
    """

    def __init__(
        self,
        settings: NodeSettings,
        path: Path,
        listen: Listen | None = None,
        plan: ContactPlan | None = None,
        daemon: IonSettings | None = None,
        security: Security | None = None,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        if daemon is not None and security is not None and not daemon.whole:
            raise BundleError(
                "ION makes its own bundles of what it is given, so it has to sign them"
                " (bpsecadmin): remove section security, or set ion: {whole: true} at both ends"
            )
        if daemon is not None and settings.receivers != (settings.sender,):
            raise BundleError(
                f"a daemon has {settings.sender} receive and send, and no other endpoint"
            )
        self._settings, self._path = settings, path
        self._listen, self._daemon, self._security = listen or Listen(), daemon, security
        self._plan, self._system = plan, system
        self._session: _Session | None = None
        self._arrived = asyncio.Event()
        self._settling = False
        self._timer: asyncio.TimerHandle | None = None
        self._next_tick_s = self._next_look_s = 0.0
        self._read = 0

    async def open(self, on_status: Callable[[DeliveryNotice], None]) -> None:
        """Open the store and the links; `on_status` is told what becomes of what was sent.

        Raises:
            StoreError: the store cannot be used.
            OSError: the network cannot.
            BundleError: a neighbour speaks a protocol for which the agent does not listen, or the
                daemon cannot be used.
        """
        settings, utc_s = self._settings, self._system.utc_s
        database = BundleDatabase(self._path, settings.limits, self._system)
        session = None
        try:
            node = BundleNode(
                settings, database, lambda: int(1000 * utc_s()), on_status, self._security
            )
            now_s = asyncio.get_running_loop().time
            session = _Session(LinkContext(node, now_s, self._wake, self._system))
            await session.open(self._listen, self._daemon)
        except BaseException:
            if session is not None:
                await session.close()
            database.close()
            raise
        for neighbour in settings.neighbours:
            gate = ContactGate(settings.node, neighbour.next_hop, self._plan, utc_s)
            session.gates[neighbour.name] = gate
        self._session = session
        self._look()
        self._wake()

    @property
    def listens(self) -> Listen:
        """Where others reach it, with the actual ports."""
        return self._opened.listens

    async def send(
        self,
        destination: Eid,
        payload: bytes,
        *,
        lifetime_s: float | None = None,
        confirm: bool = False,
        expedited: bool = False,
    ) -> BundleId:
        """Send a payload; return when it is on the disk.

        Args:
            destination: to whom.
            payload: what; one receive there returns all of it.
            lifetime_s: when it is no longer wanted; None for the agent's own.
            confirm: whether it is kept, and sent again, until its receiver has it.
            expedited: whether it goes before all others, here, on the links, at nodes on its way
                and at its receiver, and into room that is reserved for such; at most 4096 octets.

        Raises:
            StoreFull: there is no room; nothing was taken.
            StoreError: the store cannot be written; nothing was taken.
            AgentClosed: the agent is not open.
            ValueError: no neighbour reaches the destination, or nothing that goes there is
                confirmed, or it is too long to be expedited.
        """
        identity = self._opened.node.put(destination, payload, lifetime_s, confirm, expedited)
        await self.settle()
        return identity

    def must_confirm(self, destination: Eid) -> bool:
        """Return whether payloads to a destination may get lost unless sent with `confirm`."""
        neighbour = self._settings.neighbour_of(destination)
        return neighbour is not None and not self._settings.acknowledges(neighbour)

    async def settle(self) -> None:
        """Return when what was delivered until now is on the disk, and does not come again.

        Raises:
            StoreError: that could not be written; it is tried again.
            AgentClosed: the agent is not open.
        """
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
    async def receive(self, *, only_expedited: bool = False) -> AsyncIterator[Delivery]:
        """Wait for the next delivery, and hold it for the time of a `with`; expedited ones first.

        Several may be held at once: with `only_expedited`, a task of its own takes what must not
        wait for what the others are held up with.

        When the `with` ends it counts as delivered and does not come again; when it raises it
        stays. After a crash within the `with`, or before that is on the disk (`settle`), the same
        identity comes again.

        Raises:
            AgentClosed: the agent is not open, or was closed meanwhile.
        """
        async with self.receive_some(1, only_expedited=only_expedited) as (delivery,):
            yield delivery

    @asynccontextmanager
    async def receive_some(
        self, most: int, *, only_expedited: bool = False
    ) -> AsyncIterator[Sequence[Delivery]]:
        """Wait for a delivery, and hold it with those behind it, so many at most, as `receive`."""
        if self._read >= _READ_AT_ONCE:
            self._read = 0
            await asyncio.sleep(0)
        node = self._opened.node
        fetch = partial(node.fetch, only_expedited=only_expedited)
        while not (deliveries := list(islice(iter(fetch, None), most))):
            self._arrived.clear()
            await self._arrived.wait()
            if self._session is None:
                raise AgentClosed
        self._read += len(deliveries)
        try:
            yield deliveries
        except BaseException:
            for delivery in reversed(deliveries):
                node.give_back(delivery)
            self._arrived.set()
            raise
        for delivery in deliveries:
            node.delivered(delivery)
        self._wake()

    async def close(self) -> None:
        """Close the links and the store; what waits is kept."""
        if (session := self._session) is None:
            return
        await session.close()
        session.node.transaction.commit()
        self._session = None
        if self._timer is not None:
            self._timer.cancel()
        self._arrived.set()
        await asyncio.sleep(0)
        session.node.database.close()

    def queued(self, destination: Eid) -> Iterator[Queued]:
        """Yield the payloads for a destination that are still in the store, the newest first."""
        return self._opened.node.outbox.queued(destination)

    def queued_octets(self, neighbour: Eid) -> int:
        """Return how much waits for a neighbour, or for a confirmation."""
        return self._opened.node.outbox.octets(str(neighbour))

    def override(self, neighbour: Eid, override: ContactOverride) -> None:
        """Force contact with a neighbour up or down, or follow the plan."""
        self._opened.gates[str(neighbour)].override = override
        self._look()
        self._wake()

    @property
    def plan(self) -> ContactPlan | None:
        """The contact plan; None for contact always."""
        return self._plan

    def set_plan(self, plan: ContactPlan | None) -> None:
        """Replace the contact plan."""
        self._plan = plan
        for gate in self._opened.gates.values():
            gate.plan = plan
        self._look()
        self._wake()

    def health(self) -> Health:
        """Return how the agent is doing."""
        session = self._opened
        node, database = session.node, session.node.database
        oldest_utc_ms = node.outbox.oldest_utc_ms()
        oldest_s = 0.0 if oldest_utc_ms is None else self._system.utc_s() - oldest_utc_ms / 1000
        return Health(
            queued=node.outbox.depth(),
            oldest_s=max(0.0, oldest_s),
            unread=node.inbox.depth(),
            expired=node.expired,
            malformed=node.receiving.malformed
            + sum(endpoint.malformed for endpoint in session.endpoints.values()),
            room_octets=database.room_octets,
            no_room=str(database.no_room()) if database.full else "",
            neighbours=tuple(
                self._neighbour_health(neighbour.node) for neighbour in self._settings.neighbours
            ),
            refused=node.refusals.count,
        )

    @property
    def _opened(self) -> _Session:
        if self._session is None:
            raise AgentClosed
        return self._session

    def _neighbour_health(self, node: Eid) -> NeighbourHealth:
        session, name = self._opened, str(node)
        link, gate = session.links[name], session.gates[name]
        state, heard_s = gate.state(), link.last_heard_s
        return NeighbourHealth(
            node=node,
            queued=session.node.outbox.depth(name),
            contact=state.contact and link.up,
            override=gate.override,
            next_contact_utc_s=state.next_contact_utc_s,
            last_heard_s=None if heard_s is None else asyncio.get_running_loop().time() - heard_s,
            traffic=replace(session.node.traffic[name]),
        )

    def _look(self) -> None:
        """Tell the links whether there is contact."""
        session = self._opened
        for name, link in session.links.items():
            link.on_contact(session.gates[name].state())

    def _wake(self) -> None:
        """Schedule `_settle`; what comes until then is committed together."""
        if not self._settling and self._session is not None:
            self._settling = True
            asyncio.get_running_loop().call_soon(self._settle)

    def _settle(self) -> None:
        """Commit the transaction, run due timers, let the links send, and set the next timer."""
        self._settling = False
        if (session := self._session) is None:
            return
        transaction = session.node.transaction
        try:
            if transaction.pending:
                self._arrived.set()
                transaction.commit()
            self._pass_time(session)
            for link in session.links.values():
                link.pump()
        except StoreError as error:
            _LOG.error("bundle store: %s", error)
        finally:
            if transaction.pending and not transaction.failing:
                self._wake()
            next_s = min([self._next_look_s, *(link.next_s for link in session.links.values())])
            if self._timer is None or self._timer.when() != next_s:
                if self._timer is not None:
                    self._timer.cancel()
                self._timer = asyncio.get_running_loop().call_at(next_s, self._due)

    def _due(self) -> None:
        self._timer = None
        self._wake()

    def _pass_time(self, session: _Session) -> None:
        now_s = asyncio.get_running_loop().time()
        if now_s >= self._next_look_s:
            self._next_look_s = now_s + _CONTACT_LOOK_S
            self._look()
        for link in session.links.values():
            if link.next_s <= now_s:
                link.tick()
        if now_s >= self._next_tick_s:
            self._next_tick_s = now_s + _TICK_S
            session.node.tick()
