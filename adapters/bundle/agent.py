"""`BundleAgent`: a bundle node with its store and its links on an asyncio loop."""

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
from adapters.system import OPERATING_SYSTEM, System, rewrite_log

_LOG: Final = logging.getLogger(__name__)
_CONTACT_POLL_S: Final = 0.2
_TICK_S: Final = 1.0
_READ_BATCH: Final = 32
_MISSING: Final = {
    LtpLink: "LTP: set listen.ltp",
    UdpLink: "UDP: set listen.udp",
    DaemonLink: "a daemon: attach to one",
}


@dataclass(frozen=True, slots=True)
class NeighbourHealth:
    """State of the link to one neighbour.

    Attributes:
        queued: bundles that wait for the neighbour or for a confirmation.
        contact: whether sending is possible now.
        override: the operator's override of the contact plan.
        next_contact_utc_s: begin of the next planned contact; infinity if none is planned, or if
            the operator has closed the link.
        last_received_s: time since the last reception; None for never.
        traffic: traffic counters of the link.
    """

    node: Eid
    queued: int
    contact: bool
    override: ContactOverride
    next_contact_utc_s: float
    last_received_s: float | None
    traffic: Traffic


@dataclass(frozen=True, slots=True)
class Health:
    """State of an agent.

    Attributes:
        queued: bundles in the outbox.
        oldest_age_s: time that the first of them has been there.
        undelivered: units that wait for the application.
        expired: bundles that expired here, counted over restarts.
        malformed: received transmissions that could not be decoded, since the start.
        free_octets: free space of the store.
        full_text: text of the reason if the store is full, otherwise empty.
        refused: bundles rejected since the start: invalid signature, or a limit exceeded.
    """

    queued: int
    oldest_age_s: float
    undelivered: int
    expired: int
    malformed: int
    free_octets: int
    full_text: str
    neighbours: tuple[NeighbourHealth, ...]
    refused: int = 0


class _Session:
    """Parts of an open agent: the node, its endpoints, links and contact gates."""

    def __init__(self, context: LinkContext) -> None:
        self.node = context.node
        self.endpoints: dict[type[AnyLink], Endpoint] = {}
        self.links: dict[str, Link] = {}
        self.gates: dict[str, ContactGate] = {}
        self._context = context

    async def open(self, listen: Listen, daemon: IonSettings | None) -> None:
        """Create the endpoints and the links to all neighbours, and open them."""
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
        """Listen addresses of the links, with the actual ports."""
        address = {kind: endpoint.address for kind, endpoint in self.endpoints.items()}
        return Listen(address.get(LtpLink), address[TcpclLink], address.get(UdpLink))

    def _link(self, neighbour: Neighbour) -> Link:
        kind = type(neighbour.link)
        if (endpoint := self.endpoints.get(kind)) is None:
            raise BundleError(f"link to {neighbour.name} needs {_MISSING[kind]}")
        return endpoint.link(neighbour)


class BundleAgent:
    """An agent with a session, an endpoint to send from and endpoints to receive at (thesis 6.3).

    All work runs on the event loop of `open`, except the sync of the store on a thread: while the
    disk works, the timers of the links run, and expedited bundles are sent and delivered.

    Args:
        settings: its EIDs and neighbours.
        path: file of its store.
        plan: contact plan, by ION's node numbers; None for permanent contact.
        daemon: ION node that sends and receives for it; None for links of its own.
        security: signs and verifies bundles, see `load_security`; None disables both.
        system: its clock, disk and sockets.

    Raises:
        BundleError: the daemon does not support the settings; the text gives the reason.
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
                "ION puts payloads into bundles of its own, so ION has to sign them"
                " (bpsecadmin): remove section security, or set ion: {whole: true} at both ends"
            )
        if daemon is not None and settings.receivers != (settings.sender,):
            raise BundleError(
                f"with a daemon {settings.sender} must be the only endpoint to send and receive"
            )
        self._settings, self._path = settings, path
        self._listen, self._daemon, self._security = listen or Listen(), daemon, security
        self._plan, self._system = plan, system
        self._session: _Session | None = None
        self._arrived = asyncio.Event()
        self._settling = False
        self._syncing: asyncio.Task[None] | None = None
        self._on_thread: asyncio.Future[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._next_tick_s = self._next_poll_s = 0.0
        self._read = 0

    async def open(self, on_status: Callable[[DeliveryNotice], None]) -> None:
        """Open the store and the links; `on_status` receives delivery notices of own bundles.

        Raises:
            StoreError: the store cannot be used.
            OSError: a socket cannot be opened.
            BundleError: a neighbour needs a protocol without a listen address, or the daemon
                cannot be used.
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
        self._update_contacts()
        self._wake()

    @property
    def listens(self) -> Listen:
        """Listen addresses, with the actual ports."""
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
            destination: EID of the receiver.
            payload: application data unit; one receive at the destination returns all of it.
            lifetime_s: lifetime; None for the agent's default.
            confirm: whether it is retained and retransmitted until its receiver has confirmed it.
            expedited: whether it precedes all others: here, on links, at intermediate nodes and
                at its receiver. It may use reserved space of the store; at most 4096 octets.

        Raises:
            StoreFull: the store is full; nothing was stored.
            StoreError: the store cannot be written; nothing was stored.
            AgentClosed: the agent is not open.
            ValueError: no neighbour reaches the destination, its link offers no confirmation, or
                the payload is too long to be expedited.
        """
        identity = self._opened.node.put(destination, payload, lifetime_s, confirm, expedited)
        await self.settle()
        return identity

    def must_confirm(self, destination: Eid) -> bool:
        """Return whether payloads to a destination may get lost unless sent with `confirm`."""
        neighbour = self._settings.neighbour_of(destination)
        return neighbour is not None and not self._settings.acknowledges(neighbour)

    async def settle(self) -> None:
        """Return when all earlier deliveries are on the disk, and cannot be repeated.

        Raises:
            StoreError: the commit failed; it is repeated later.
            AgentClosed: the agent is not open.
        """
        committed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

        def on_commit(failure: StoreError | None) -> None:
            if committed.done():
                return
            if failure is None:
                committed.set_result(None)
            else:
                committed.set_exception(failure)

        self._opened.node.transaction.on_commit(on_commit)
        self._wake()
        await committed

    @asynccontextmanager
    async def receive(self, *, only_expedited: bool = False) -> AsyncIterator[Delivery]:
        """Wait for the next delivery and hold it during a `with`; expedited ones first.

        Several may be held at once: a separate task with `only_expedited` receives urgent units
        while other tasks are busy.

        When the `with` ends normally, the unit counts as delivered; if it raises, the unit stays.
        After a crash within the `with`, or before the commit (see `settle`), the unit is delivered
        again with the same identity.

        Raises:
            AgentClosed: the agent is not open, or was closed during the call.
        """
        async with self.receive_some(1, only_expedited=only_expedited) as (delivery,):
            yield delivery

    @asynccontextmanager
    async def receive_some(
        self, maximum: int, *, only_expedited: bool = False
    ) -> AsyncIterator[Sequence[Delivery]]:
        """Wait for a delivery.

        Hold it and those queued behind it, up to `maximum`. See `receive`.
        """
        if self._read >= _READ_BATCH:
            self._read = 0
            await asyncio.sleep(0)
        node = self._opened.node
        fetch = partial(node.fetch, only_expedited=only_expedited)
        while not (deliveries := list(islice(iter(fetch, None), maximum))):
            self._arrived.clear()
            await self._arrived.wait()
            if self._session is None:
                raise AgentClosed
        self._read += len(deliveries)
        try:
            yield deliveries
        except BaseException:
            for delivery in reversed(deliveries):
                node.requeue_delivery(delivery)
            self._arrived.set()
            raise
        for delivery in deliveries:
            node.mark_delivered(delivery)
        self._wake()

    async def close(self) -> None:
        """Close the links and the store; queued bundles are retained."""
        if (session := self._session) is None:
            return
        await session.close()
        if self._syncing is not None:
            self._syncing.cancel()
            await asyncio.wait((self._syncing,))
            if self._on_thread is not None:
                await asyncio.wait((self._on_thread,))
            self._syncing = None
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
        """Return the octets that wait for a neighbour, or for a confirmation."""
        return self._opened.node.outbox.octets(str(neighbour))

    def override(self, neighbour: Eid, override: ContactOverride) -> None:
        """Force contact with a neighbour up or down, or follow the plan."""
        self._opened.gates[str(neighbour)].override = override
        self._update_contacts()
        self._wake()

    @property
    def plan(self) -> ContactPlan | None:
        """The contact plan; None for permanent contact."""
        return self._plan

    def set_plan(self, plan: ContactPlan | None) -> None:
        """Replace the contact plan."""
        self._plan = plan
        for gate in self._opened.gates.values():
            gate.plan = plan
        self._update_contacts()
        self._wake()

    def health(self) -> Health:
        """Return the state of the agent."""
        session = self._opened
        node, database = session.node, session.node.database
        earliest_utc_ms = node.outbox.earliest_utc_ms()
        max_age_s = (
            0.0 if earliest_utc_ms is None else self._system.utc_s() - earliest_utc_ms / 1000
        )
        return Health(
            queued=node.outbox.depth(),
            oldest_age_s=max(0.0, max_age_s),
            undelivered=node.inbox.depth(),
            expired=node.expired,
            malformed=node.receiving.malformed
            + sum(endpoint.malformed for endpoint in session.endpoints.values()),
            free_octets=database.free_octets,
            full_text=str(database.full_error()) if database.full else "",
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
        state, last_s = gate.state(), link.last_received_s
        return NeighbourHealth(
            node=node,
            queued=session.node.outbox.depth(name),
            contact=state.contact and link.up,
            override=gate.override,
            next_contact_utc_s=state.next_contact_utc_s,
            last_received_s=None if last_s is None else asyncio.get_running_loop().time() - last_s,
            traffic=replace(session.node.traffic[name]),
        )

    def _update_contacts(self) -> None:
        """Update the state of contact of the links."""
        session = self._opened
        for name, link in session.links.items():
            link.on_contact(session.gates[name].state())

    def _wake(self) -> None:
        """Schedule `_settle`; changes until then share one commit."""
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
                transaction.write()
            if transaction.unsynced and self._syncing is None:
                self._syncing = asyncio.create_task(self._sync(session))
            self._run_timers(session)
            for link in session.links.values():
                link.send_waiting()
        except StoreError as error:
            _LOG.error("bundle store: %s", error)
        finally:
            if transaction.pending and not transaction.failing:
                self._wake()
            next_s = min([self._next_poll_s, *(link.next_s for link in session.links.values())])
            if self._timer is None or self._timer.when() != next_s:
                if self._timer is not None:
                    self._timer.cancel()
                self._timer = asyncio.get_running_loop().call_at(next_s, self._due)

    async def _sync(self, session: _Session) -> None:
        """Sync the store on a thread, again after a failure; then run the callbacks."""
        transaction = session.node.transaction
        while True:
            try:
                transaction.begin_sync()
                work = asyncio.to_thread(session.node.database.sync)
                self._on_thread = asyncio.ensure_future(work)
                await asyncio.shield(self._on_thread)
                break
            except StoreError as error:
                _LOG.error("%s", error)
                rewrite_log(self._path)
                await asyncio.sleep(_TICK_S)
        self._syncing = None
        try:
            transaction.end_sync()
        finally:  # also if a callback raises
            await asyncio.sleep(0)  # tasks in `settle` run before the deliveries that follow
            transaction.release()
            self._arrived.set()
            self._wake()

    def _due(self) -> None:
        self._timer = None
        self._wake()

    def _run_timers(self, session: _Session) -> None:
        now_s = asyncio.get_running_loop().time()
        if now_s >= self._next_poll_s:
            self._next_poll_s = now_s + _CONTACT_POLL_S
            self._update_contacts()
        for link in session.links.values():
            if link.next_s <= now_s:
                link.tick()
        if now_s >= self._next_tick_s:
            self._next_tick_s = now_s + _TICK_S
            session.node.tick()
