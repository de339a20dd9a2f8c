"""`RoverLink`: a session with an asset over one link that reconnects after each loss."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeVar

from adapters.console.archive import to_us
from adapters.console.messages import LinkKind, LinkState
from adapters.mal import CertificateError, MalError, StandardError
from adapters.mrs.ground import NEXT_CONTACT, FileNotification, LinkDelay, MrsClient, Stream
from adapters.mrs.spec import (
    AreaError,
    AssetInfo,
    AssetStatus,
    AuthorityStatus,
    HousekeepingParameter,
    ParameterDefinition,
    ReceivedReport,
    ReceivedValue,
    ServiceDescriptor,
)
from adapters.mrs.transport import TransportSettings
from adapters.system import System
from executive.plans import FINAL_STATUSES, QUESTION
from executive.values.plan_nodes import PlanNodeReport
from executive.values.reports import Identity, PlanStatus, PlanUpdate
from trees import TreeSnapshot

_LOG: Final = logging.getLogger(__name__)
T = TypeVar("T")

ANSWER_S: Final = 5.0
"""Timeout of each request beyond the declared delay, s; after it the link is SILENT."""
STATUS_S: Final = 1.0
"""Poll interval for mode and authority, s; the answers prove that the link is up."""
MEASURED_S: Final = 5.0
"""Interval between two measurements of a link, s."""
DIRECTORY_S: Final = 5.0
"""Poll interval of the directory of registered assets, s."""
MIN_BACKOFF_S: Final = 0.5
MAX_BACKOFF_S: Final = 5.0
NO_NODES: Final = {
    StandardError.UNSUPPORTED_OPERATION.value,
    AreaError.NOT_SUPPORTED.value,
    AreaError.NOT_FOUND.value,
}
"""Errors of a plan without nodes."""
CATCH_UP: Final = 1000
"""Number of earlier notifications to request if none is known."""


ROUND_TRIP: Final = "LINK_ROUND_TRIP"
CLOCK_OFFSET: Final = "LINK_CLOCK_OFFSET"
LINK_HOUSEKEEPING: Final = (
    HousekeepingParameter(ROUND_TRIP, "Round-trip time of the console's last status request", "s"),
    HousekeepingParameter(CLOCK_OFFSET, "Lead of the onboard clock over the console's clock", "s"),
)
"""Parameters that the console measures of each link; the clock offset on the direct link only."""


@dataclass(frozen=True, slots=True)
class LastNotification:
    """Cursor and creation time of the last known notification of an asset."""

    cursor: int
    utc_us: int


class LinkListener(Protocol):
    """Receiver of a link's data; called on the event loop."""

    def on_asset(self, link: "RoverLink", definitions: tuple[ParameterDefinition, ...]) -> None:
        """Called once `link.info` and `link.kind` of the asset are known."""

    def on_state(self, link: "RoverLink") -> None:
        """Called after `link.state` or `link.detail` has changed."""

    def on_value(self, link: "RoverLink", value: ReceivedValue, rx_s: float) -> None:
        """Receive a telemetry value."""

    def on_measured(self, link: "RoverLink", figures: Mapping[str, float], rx_s: float) -> None:
        """Receive figures of `LINK_HOUSEKEEPING`, by name."""

    async def on_notification(
        self, link: "RoverLink", received: ReceivedReport, rx_s: float
    ) -> None:
        """Receive a notification, each once."""

    def on_status(self, link: "RoverLink", status: AssetStatus) -> None:
        """Receive mode and work."""

    def on_authority(self, link: "RoverLink", status: AuthorityStatus) -> None:
        """Receive the authority status."""

    def on_tree(self, link: "RoverLink", snapshot: TreeSnapshot) -> None:
        """Receive the behaviour tree."""

    def on_plan(self, link: "RoverLink", update: PlanUpdate) -> None:
        """Receive the progress of a plan."""

    def on_plan_nodes(
        self, link: "RoverLink", plan_id: str, nodes: tuple[PlanNodeReport, ...]
    ) -> None:
        """Receive the nodes of a plan with questions; the last time after its end."""

    def on_file(self, link: "RoverLink", notification: FileNotification) -> None:
        """Receive the change of a file."""

    def on_services(self, link: "RoverLink", services: tuple[ServiceDescriptor, ...]) -> None:
        """Receive the services registered at the asset."""

    def on_arguments(self, link: "RoverLink", identity: Identity, args: dict[str, Any]) -> None:
        """Receive the requested arguments of a command."""

    async def last_known(self, link: "RoverLink") -> LastNotification | None:
        """Return the last known notification of the asset on this link; None for none."""

    def on_new_ledger(self, link: "RoverLink") -> None:
        """Called if the asset has another ledger, without its former commands."""


class RoverLink:
    """Maintains a session with an MRS provider.

    Args:
        uri: its address.
        terms: transport settings.
        listener: receives all data.
        system: clock and network.

    Raises:
        CertificateError: the certificate of the terms cannot be used.

    Attributes:
        proven_name: name that the certificate proves to the asset; None without TLS.
        info: description of the asset; None until it was reached.
        kind: DIRECT for the asset itself, RELAY for an orbiter.
        state, since_s, detail: state, its start time, and its reason.
        last_received_s: last reception time; None for never.
        client: the session while it is up; of a known asset also before its first answers.
        figures: last figures of `LINK_HOUSEKEEPING`, by name.
        preconditions: whether the asset supports preconditions of commands.
    """

    def __init__(
        self, uri: str, terms: TransportSettings, listener: LinkListener, system: System
    ) -> None:
        self.uri = uri
        self._terms, self._system = terms, system
        certificates = terms.certificates
        self.proven_name = None if certificates is None else certificates.name()
        self._listener = listener
        self.info: AssetInfo | None = None
        self.kind = LinkKind.DIRECT
        self.state = LinkState.CONNECTING
        self.since_s = system.utc_s()
        self.detail = ""
        self.last_received_s: float | None = None
        self.client: MrsClient | None = None
        self.figures: dict[str, float] = {}
        self.preconditions = False
        self._plans: dict[str, PlanStatus] = {}
        self._wanted: asyncio.LifoQueue[Identity] = asyncio.LifoQueue()

    @property
    def asset(self) -> str:
        """Name of the asset; empty until it was reached."""
        return "" if self.info is None else self.info.asset

    @property
    def delay(self) -> LinkDelay:
        """Declared and last measured round-trip time."""
        return LinkDelay(self._terms.round_trip_s, self.figures.get(ROUND_TRIP))

    def request_arguments(self, identity: Identity) -> None:
        """Request the arguments of a command, the newest command first."""
        self._wanted.put_nowait(identity)

    async def run(self) -> None:
        """Connect and receive; reconnect after each loss."""
        pause_s = MIN_BACKOFF_S
        while True:
            try:
                await self._run_session()
            except* (ConnectionError, MalError, TimeoutError) as lost:
                self._set_state(LinkState.DOWN, _why(lost))
            except* CertificateError as wrong:
                self._set_state(LinkState.DOWN, _why(wrong))
            pause_s = MIN_BACKOFF_S if self._was_up else min(2 * pause_s, MAX_BACKOFF_S)
            await asyncio.sleep(pause_s)

    async def _run_session(self) -> None:
        self._was_up = False
        client = await MrsClient.connect(
            self.uri, timeout_s=ANSWER_S, patience_s=0.0, terms=self._terms, system=self._system
        )
        async with client:
            notifications = client.notifications()  # before the first await, so that none is missed
            if self.info is not None:  # a stop of a known asset does not wait for its answers
                self.client = client
            try:
                self.info, definitions, telemetry = await asyncio.gather(
                    client.get_asset(), client.list_definition(), self._subscribed(client.telemetry)
                )
                self.preconditions = await client.supports_preconditions()
                relayed = any(each.name == NEXT_CONTACT for each in definitions)
                self.kind = LinkKind.RELAY if relayed else LinkKind.DIRECT
                self.client, self._was_up = client, True
                self._listener.on_asset(self, definitions)
                self._set_state(LinkState.UP, "")
                await self._listen(client, notifications, telemetry)
            finally:
                self.client = None

    async def _listen(
        self,
        client: MrsClient,
        notifications: Stream[ReceivedReport],
        telemetry: Stream[ReceivedValue] | None,
    ) -> None:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._request_values(client))
            tasks.create_task(self._receive_notifications(client, notifications))
            if telemetry is not None:
                tasks.create_task(self._receive_stream(telemetry, self._on_value))
            tasks.create_task(
                self._subscribe_and_receive(client.tree_snapshots, self._listener.on_tree, self)
            )
            tasks.create_task(self._subscribe_and_receive(client.plan_updates, self._on_plan))
            tasks.create_task(self._poll_questions(client))
            tasks.create_task(
                self._subscribe_and_receive(client.file_events, self._listener.on_file, self)
            )
            tasks.create_task(self._poll_status(client))
            if self.kind is LinkKind.DIRECT:
                tasks.create_task(self._poll_directory(client))
                tasks.create_task(self._request_arguments(client))

    async def _request_values(self, client: MrsClient) -> None:
        """Request the initial values, since telemetry intervals may be long."""
        with suppress(MalError):
            for value in await client.get_value():
                self._on_value(value)

    async def _receive_notifications(
        self, client: MrsClient, stream: Stream[ReceivedReport]
    ) -> None:
        known = await self._listener.last_known(self)
        missed, has_new_ledger = await _missed(client, known)
        if has_new_ledger:
            self._listener.on_new_ledger(self)
        elif known is not None and missed and missed[0].cursor > known.cursor + 1:
            gap = (self.asset, known.cursor + 1, missed[0].cursor - 1)
            _LOG.warning("%s: no longer has notifications %d to %d", *gap)
        for received in missed:
            await self._on_notification(received)
        seen = {received.cursor for received in missed}
        async for received in stream:
            if received.cursor not in seen:
                await self._on_notification(received)
            seen.discard(received.cursor)

    async def _on_notification(self, received: ReceivedReport) -> None:
        await self._listener.on_notification(self, received, self._on_received())

    def _on_value(self, value: ReceivedValue) -> None:
        self._listener.on_value(self, value, self._on_received())

    async def _subscribe_and_receive(
        self,
        subscribe: Callable[[], Awaitable[Stream[T]]],
        handler: Callable[..., None],
        *first: Any,
    ) -> None:
        stream = await self._subscribed(subscribe)
        if stream is not None:
            await self._receive_stream(stream, handler, *first)

    async def _subscribed(self, subscribe: Callable[[], Awaitable[Stream[T]]]) -> Stream[T] | None:
        """Subscribe to a stream; None if the provider does not serve this part of the MRS."""
        try:
            return await subscribe()
        except MalError as error:
            _LOG.info("%s: %s", self.uri, error)
            return None

    async def _receive_stream(
        self, stream: Stream[T], handler: Callable[..., None], *first: Any
    ) -> None:
        async for item in stream:
            self._on_received()
            handler(*first, item)

    async def _poll_status(self, client: MrsClient) -> None:
        now_s, measured_s = asyncio.get_running_loop().time, -MEASURED_S
        while True:
            try:
                requested_s, began_s = self._system.utc_s(), now_s()
                status = await client.get_status()
                round_trip_s = now_s() - began_s
                self._on_received()
                self._set_state(LinkState.UP, "")
                self._listener.on_status(self, status)
                if self.kind is LinkKind.RELAY and status.activePlan is not None:
                    self._plans[status.activePlan] = PlanStatus.EXECUTING  # it has a question
                if began_s - measured_s >= MEASURED_S:
                    measured_s = began_s
                    self._report_link_figures(status, requested_s, round_trip_s)
                with suppress(MalError):  # some providers do not serve the authority
                    self._listener.on_authority(self, await client.authority.status())
            except MalError as error:
                self._set_state(LinkState.SILENT, str(error))
            await asyncio.sleep(STATUS_S)

    def _report_link_figures(
        self, status: AssetStatus, requested_s: float, round_trip_s: float
    ) -> None:
        figures = {ROUND_TRIP: round_trip_s}
        if self.kind is LinkKind.DIRECT:  # an orbiter stamps its last contact with the rover
            offset_s = status.timestamp / 1e9 - (requested_s + round_trip_s / 2)
            figures[CLOCK_OFFSET] = offset_s
        self.figures = figures
        self._listener.on_measured(self, figures, self.last_received_s or requested_s)

    async def _request_arguments(self, client: MrsClient) -> None:
        while True:
            identity = await self._wanted.get()
            try:
                args = await client.get_arguments(identity)
            except MalError as error:  # no answer in time, not served, or no longer stored
                _LOG.info("%s: no arguments of %s: %s", self.asset, identity, error)
                if error.number == StandardError.DELIVERY_TIMEDOUT.value:
                    self.request_arguments(identity)
            except ConnectionError:
                self.request_arguments(identity)
                raise
            else:
                self._listener.on_arguments(self, identity, args)

    def _on_plan(self, update: PlanUpdate) -> None:
        self._listener.on_plan(self, update)
        self._plans[update.plan_id] = update.status

    async def _poll_questions(self, client: MrsClient) -> None:
        """Poll the nodes of plans with questions, which are not published.

        An orbiter knows the open questions only, and names the plan of the first one.
        """
        before = set(self._plans)  # of those that are unknown now, the questions end
        known = {each.plan_id: each.status for each in await self._known_plans(client)}
        self._plans |= known
        ended = {plan_id for plan_id, status in known.items() if status in FINAL_STATUSES}
        without = ended - before
        while True:
            for plan_id, status in tuple(self._plans.items()):
                if status is PlanStatus.SUBMITTED:
                    without.discard(plan_id)
                if status is PlanStatus.SUBMITTED or plan_id in without:
                    continue
                try:
                    nodes = await client.get_plan_nodes(plan_id)
                except MalError as error:
                    _LOG.debug("%s: no nodes of %s: %s", self.asset, plan_id, error)
                    if error.number not in NO_NODES:
                        continue  # late or busy: its questions may still be open
                    nodes = ()
                self._listener.on_plan_nodes(self, plan_id, nodes)
                if self.kind is LinkKind.RELAY and not nodes:
                    del self._plans[plan_id]
                elif status in FINAL_STATUSES or not any(each.kind == QUESTION for each in nodes):
                    without.add(plan_id)
            await asyncio.sleep(STATUS_S)

    async def _known_plans(self, client: MrsClient) -> tuple[PlanUpdate, ...]:
        with suppress(MalError):  # some providers do not serve plans
            return await client.get_plan_status()
        return ()

    async def _poll_directory(self, client: MrsClient) -> None:
        while True:
            with suppress(MalError):
                self._listener.on_services(self, await client.get_services())
            await asyncio.sleep(DIRECTORY_S)

    def _on_received(self) -> float:
        self.last_received_s = self._system.utc_s()
        return self.last_received_s

    def _set_state(self, state: LinkState, detail: str) -> None:
        if (state, detail) == (self.state, self.detail):
            return
        if state is not self.state:
            self.since_s = self._system.utc_s()
            log = _LOG.info if state is LinkState.UP else _LOG.warning
            log("%s %s is %s%s", self.uri, self.asset, state.value, detail and f": {detail}")
        self.state, self.detail = state, detail
        self._listener.on_state(self)


async def _missed(
    client: MrsClient, known: LastNotification | None
) -> tuple[list[ReceivedReport], bool]:
    """Return the notifications after a known one, oldest first, and whether the ledger has changed.

    Without a known one, or after a change of the ledger, these are the last `CATCH_UP` ones.
    """
    found = [] if known is None else await client.get_all_notifications(known.cursor)
    if known is not None and _continues(known, found):
        return [each for each in found if each.cursor > known.cursor], False
    last = await client.get_last_notification()
    first = max((0 if last is None else last.cursor) - CATCH_UP, 0) + 1
    return await client.get_all_notifications(first), known is not None


def _continues(known: LastNotification, found: list[ReceivedReport]) -> bool:
    """Whether notifications requested from a known one on are of the same ledger."""
    if not found:
        return False
    first = found[0]
    return first.cursor > known.cursor or to_us(first.report.utc_s) == known.utc_us


def _why(group: BaseExceptionGroup[BaseException]) -> str:
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return str(error)
