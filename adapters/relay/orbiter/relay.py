"""`serve`, the body of `rover-mops`: an `OrbiterRelay` (bundle agent and rovers) until a signal."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import AsyncExitStack, suppress
from functools import partial
from itertools import takewhile
from math import inf
from pathlib import Path
from typing import Final, assert_never

from adapters.bundle import (
    BundleAgent,
    BundleError,
    ContactOverride,
    ContactPlan,
    Delivery,
    DeliveryNotice,
    Eid,
    Ipn,
    NeighbourHealth,
    Queued,
    Security,
    StoreError,
    listen_error,
    load_contact_plan,
    load_security,
    node_of,
)
from adapters.mops import LINK, Dictionary, MopsError, decode, load_dictionary
from adapters.mrs.transport import TransportSettings, start_fault
from adapters.process import ResourceMonitor, StartError, exclusive, termination_event
from adapters.relay.orbiter.link_status import (
    BY_PLAN,
    LinkMonitor,
    PlannedContacts,
    RelayLinkStatus,
    list_contacts,
    measure_link,
)
from adapters.relay.orbiter.metrics import collect
from adapters.relay.orbiter.provider import RoverProvider
from adapters.relay.orbiter.record import RoverRecord
from adapters.relay.orbiter.rover import RelayedRover
from adapters.relay.orbiter.settings import OrbiterSettings
from adapters.system import OPERATING_SYSTEM, System
from executive.commands import Command
from executive.record import LedgerError
from executive.values.reports import Identity, Severity

_LOG: Final = logging.getLogger(__name__)
POLL_S: Final = 1.0
PRUNE_S: Final = 60.0
GRACE_S: Final = 120.0
"""Delay after its lifetime until a command counts as lost, if nothing is retransmitted."""
_BUNDLES: Final = "bundles.sqlite"
_RETRY_S: Final = 1.0
_STORE: Final = "the orbiter's store"


class OrbiterRelay:
    """Bundle agent of the orbiter, and the rovers behind it.

    Args:
        folder: folder of bundles and records.
        read_plan: reads the contact plan; None for permanent contact. Raises BundleError.
        dictionary: MOPS formats of the messages.
        security: signs and verifies bundles; None disables both.
        system: its clock, disk and sockets.

    Attributes:
        usage: measures the resource usage of this process.

    Raises:
        LedgerError: a record cannot be used.
        BundleError: the plan cannot be read.
    """

    def __init__(
        self,
        settings: OrbiterSettings,
        folder: Path,
        read_plan: Callable[[], ContactPlan | None],
        dictionary: Dictionary,
        security: Security | None = None,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self._settings, self._dictionary, self._utc_s = settings, dictionary, system.utc_s
        self._read_plan, store = read_plan, folder / _BUNDLES
        self._node = settings.node().node
        self.agent = BundleAgent(
            settings.node(), store, settings.listen, read_plan(),
            daemon=settings.daemon, security=security, system=system,
        )  # fmt: skip
        self.rovers: Mapping[Eid, RelayedRover] = {
            node_of(each.endpoint): RelayedRover(
                each,
                self.agent,
                dictionary,
                RoverRecord(
                    folder / f"{each.asset}.sqlite",
                    each.numbers_reports,
                    settings.retained_reports,
                    system,
                ),
                system.utc_s,
                settings.lifetime_s,
                settings.retransmit_after_s or GRACE_S,
            )
            for each in settings.rovers
        }
        self.usage = ResourceMonitor(folder, system)
        self._statuses: dict[Eid, RelayLinkStatus] = {}
        self._full = False
        self._planned: dict[Eid, PlannedContacts] = {}
        self._monitors = {
            node: LinkMonitor(settings.queue_warning_s, rover.notify)
            for node, rover in self.rovers.items()
        }

    async def open(self) -> None:
        """Open the agent.

        Raises:
            StoreError: the store cannot be used.
            OSError: a socket cannot be opened.
        """
        await self.agent.open(self._on_notice)
        for rover in self.rovers.values():
            queued = self.agent.queued(rover.settings.endpoint)
            try:
                recover_outbox(queued, rover.record, self._dictionary, self._utc_s())
            except LedgerError as error:  # each use of the record raises it again
                _LOG.error("%s", error)

    async def close(self) -> None:
        """Close the agent and the records; queued bundles are retained."""
        await self.agent.close()
        for rover in self.rovers.values():
            await rover.close()

    async def receive(self) -> None:
        """Dispatch deliveries for as long as the agent is open."""
        while True:
            try:
                async with self.agent.receive() as delivery:
                    self._on_delivery(delivery)
                    if rover := self.rovers.get(node_of(delivery.source)):
                        await rover.settle()
            except LedgerError as error:  # the delivery stays, and is received again
                _LOG.error("%s", error)
                await asyncio.sleep(_RETRY_S)

    def link_status(self, node: Eid) -> RelayLinkStatus:
        """Return the state of the link to a rover."""
        health = self.agent.health()
        return self._measure(
            next(each for each in health.neighbours if each.node == node), health.free_octets
        )

    def last_statuses(self) -> list[RelayLinkStatus | None]:
        """Return the states of the links at the last `poll`, in the order of the rovers."""
        return [self._statuses.get(node) for node in self.rovers]

    def override_contact(self, node: Eid, override: ContactOverride) -> str:
        """Override the contact plan for a rover until this process ends; return the new state.

        The plan is reloaded when an override ends.

        Args:
            node: node of the rover.
            override: the operator's override.

        Raises:
            BundleError: ION sets the contacts, or the plan cannot be read; nothing changes.
        """
        if self._settings.daemon is not None:
            raise BundleError("ION carries the bundles: set its contacts there, with ionadmin")
        if override is ContactOverride.BY_PLAN:
            plan = self._read_plan()
            self.agent.set_plan(plan)
        self.agent.override(node, override)
        match override:
            case ContactOverride.UP:
                return f"contact is held open by the operator until {BY_PLAN}"
            case ContactOverride.DOWN:
                return f"contact is held closed by the operator until {BY_PLAN}"
            case ContactOverride.BY_PLAN if plan is None:
                return "contact is permanent: there is no plan"
            case ContactOverride.BY_PLAN:
                return "contact follows the plan, which was reloaded"
            case _:
                assert_never(override)

    def poll(self) -> None:
        """Notify of contacts that begin or end, a full store, and commands that wait too long."""
        health = self.agent.health()
        self._notify_if_full(health.full_text)
        for neighbour in health.neighbours:
            if not neighbour.queued:
                self.rovers[neighbour.node].record.outstanding.outbox_empty(self._utc_s())
            status = self._measure(neighbour, health.free_octets)
            self._statuses[neighbour.node] = status
            self._monitors[neighbour.node].update(status, self._utc_s())

    async def retransmit_unanswered(self) -> None:
        """Retransmit unanswered commands to all rovers with contact in both directions."""
        settings = self._settings
        if settings.retransmit_after_s is None:
            return
        for each in self.agent.health().neighbours:
            silent_s = inf if each.last_received_s is None else each.last_received_s
            if each.contact and silent_s <= settings.link_timeout_s and not each.queued:
                await self.rovers[each.node].retransmit_unanswered(settings.retransmit_after_s)

    def prune(self) -> None:
        """Prune the records."""
        for rover in self.rovers.values():
            rover.record.prune(self._utc_s())

    def _measure(self, health: NeighbourHealth, free_octets: int) -> RelayLinkStatus:
        node, utc_s = health.node, self._utc_s()
        return measure_link(
            health,
            free_octets,
            self.agent.queued_octets(node),
            self.rovers[node].record.outstanding.earliest_utc_s(),
            self._list_contacts(node, utc_s),
            utc_s,
        )

    def _list_contacts(self, node: Eid, utc_s: float) -> PlannedContacts:
        own, rover = (each.node if isinstance(each, Ipn) else 0 for each in (self._node, node))
        self._planned[node] = list_contacts(
            self.agent.plan, own, rover, self._planned.get(node), utc_s
        )
        return self._planned[node]

    def _notify_if_full(self, why: str) -> None:
        if bool(why) == self._full:
            return
        self._full = bool(why)
        severity = Severity.WARNING if why else Severity.INFORMATIONAL
        text = f"{_STORE} is full: {why}" if why else f"{_STORE} has free space again"
        for rover in self.rovers.values():
            rover.notify(severity, text)

    def _on_delivery(self, delivery: Delivery) -> None:
        rover = self.rovers.get(node_of(delivery.source))
        if rover is None:
            _LOG.warning("%s is not a known rover: %r", delivery.source, delivery.payload[:80])
        else:
            rover.on_delivery(delivery)

    def _on_notice(self, notice: DeliveryNotice) -> None:
        try:
            for rover in self.rovers.values():
                rover.on_status(notice.identity, notice.status)
        except LedgerError as error:  # must not reach the agent
            _LOG.error("%s", error)


def recover_outbox(
    queued: Iterable[Queued], record: RoverRecord, dictionary: Dictionary, utc_s: float
) -> None:
    """Record commands in the outbox that an earlier process did not record before it was killed.

    Commands are recorded in order, so all unrecorded ones are newer than the recorded. None has
    left the outbox: a command is recorded before the next octet is received.

    Args:
        queued: payloads in the outbox to a rover, the newest first.
        record: record of that rover.
        dictionary: MOPS formats of the commands.
        utc_s: present time in seconds since 1970.

    Raises:
        LedgerError: the record cannot be read.
    """
    missing = takewhile(lambda each: not record.outstanding.in_outbox(each.identity), queued)
    for each in reversed(list(missing)):  # oldest first: a kill must not hide older ones
        try:
            message = decode(each.payload)
            request = dictionary.request(message)
        except MopsError:
            continue
        if message.moe_inputs_id is None:
            continue
        identity = Identity(message.source, message.moe_inputs_id)
        if record.ledger.digest_of(identity) is None:
            command = Command(identity, request, LINK, counter=message.moe_inputs_counter)
            _LOG.info("%s was sent before it was recorded", identity)
            with suppress(LedgerError):  # it stays pending, and is written in the next commit
                record.outstanding.add(
                    command, each.payload, each.identity, utc_s, each.expires_utc_s
                )


async def serve(
    settings: OrbiterSettings,
    settings_file: Path,
    host: str,
    data: Path,
    clear_text: bool,
    terms: TransportSettings,
    metrics: tuple[str, int] | None = None,
) -> None:
    """Serve until SIGINT or SIGTERM.

    Args:
        settings: settings of the orbiter and its rovers.
        settings_file: file of the settings; the contact plan's path is relative to it.
        host: listen address of the MRS.
        data: folder of bundles and records.
        clear_text: whether the MRS may be served in clear text beyond this computer.
        terms: encoding and certificates of the MRS.
        metrics: address of the metrics; None for none.

    Raises:
        StartError: it cannot start.
    """
    termination = termination_event()
    with exclusive(data, "orbiter.lock"):
        await run(
            settings, settings_file, host, data, clear_text, terms, termination, metrics=metrics
        )


async def run(
    settings: OrbiterSettings,
    settings_file: Path,
    host: str,
    data: Path,
    clear_text: bool,
    terms: TransportSettings,
    over: asyncio.Event,
    system: System = OPERATING_SYSTEM,
    metrics: tuple[str, int] | None = None,
) -> None:
    """Serve until an event is set; the arguments and errors are those of `serve`."""
    try:
        async with AsyncExitStack() as stack:
            read_plan = partial(
                load_contact_plan,
                *(settings_file, settings.contact_plan, data, settings.node(), system),
            )
            security = load_security(settings_file, settings.security, settings.node().node)
            relay = OrbiterRelay(settings, data, read_plan, load_dictionary(), security, system)
            stack.push_async_callback(relay.close)
            try:
                await relay.open()
            except OSError as error:
                raise StartError(listen_error(error, settings.listen, settings_file)) from error
            providers = [
                RoverProvider(
                    rover,
                    partial(relay.link_status, node),
                    partial(relay.override_contact, node),
                    relay.usage.measure,
                    settings.link_timeout_s,
                    terms,
                    system,
                )
                for node, rover in relay.rovers.items()
            ]
            tls = terms.for_provider()
            for provider in providers:
                stack.push_async_callback(provider.close)
                try:
                    await provider.start(host, tls, clear_text)
                except (ValueError, OSError) as error:
                    what = f"serve {provider.asset} at {host}:{provider.port}"
                    remedy = f", or another port in {settings_file}"
                    raise StartError(start_fault(error, what, host, remedy)) from error
            if metrics is not None:
                from adapters.metrics.exposition import Exposition, MetricsServer

                add = partial(collect, relay.last_statuses, providers, data)
                server = MetricsServer(Exposition("orbiter", add, system).page, metrics)
                stack.callback(server.close)
                print(f"metrics at {server.url}", flush=True)
            for provider in providers:
                print(f"{provider.asset} listens at {provider.uri}", flush=True)
            await _run_until(over, relay, providers, settings.health_interval_s)
    except (BundleError, LedgerError, OSError, ValueError) as error:
        raise StartError(str(error)) from error


async def _run_until(
    over: asyncio.Event,
    relay: OrbiterRelay,
    providers: Sequence[RoverProvider],
    health_interval_s: float,
) -> None:
    work = [
        relay.receive(),
        _run_periodically(POLL_S, relay.poll),
        _run_periodically(POLL_S, relay.retransmit_unanswered),
        _run_periodically(PRUNE_S, relay.prune),
        *(_run_periodically(health_interval_s, provider.publish_health) for provider in providers),
    ]
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(each) for each in work]
        await over.wait()
        for task in tasks:
            task.cancel()


async def _run_periodically(interval_s: float, act: Callable[[], Awaitable[None] | None]) -> None:
    while True:
        try:
            work = act()
            if work is not None:
                await work
        except (LedgerError, StoreError) as error:
            _LOG.error("%s", error)
        await asyncio.sleep(interval_s)
