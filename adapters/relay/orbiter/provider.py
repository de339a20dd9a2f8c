"""`RoverProvider`: MRS of one rover at the orbiter, with the operations that work over bundles."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

from adapters.bundle import BundleError, ContactOverride
from adapters.mal import CallContext, MalUri, StandardError, is_loopback
from adapters.metrics import ReportCounter
from adapters.mops import LINK, UNNUMBERED
from adapters.mrs import spec as wire
from adapters.mrs.aboard import LAST_SEQUENCE, ServedOperations, page_size, serve_commands
from adapters.mrs.spec import (
    ABOARD_HOUSEKEEPING,
    DEFINED,
    ORBITER,
    ORBITER_HOUSEKEEPING,
    AreaError,
    camera_state,
    find_or_raise,
    housekeeping_values,
    lost_command,
    notification_keys,
    notification_of,
    parameter_value,
    pose,
    speeds,
    to_ns,
    usage_figures,
    wire_node,
    with_text,
)
from adapters.mrs.transport import TransportSettings
from adapters.process import ResourceUsage
from adapters.relay.orbiter.link_status import (
    BY_PLAN,
    CONTACT,
    ORBITER_PARAMETERS,
    RelayLinkStatus,
    aboard_values,
)
from adapters.relay.orbiter.rover import RelayedRover
from adapters.system import OPERATING_SYSTEM, System
from executive.commands import Command, ExecuteAction
from executive.record import LedgerError
from executive.values.parameters import ParameterValue
from executive.values.plan_nodes import NodeStatus, PlanNodeReport
from executive.values.reports import Report, ReportKind, Severity, Stage

if TYPE_CHECKING:
    import ssl


AUTHORITY: Final = "AUTHORITY"
UNAUTHENTICATED_TEXT: Final = (
    "source names are not authenticated here, because the MRS is served in clear text beyond this"
    " computer: serve with certificates, or have each command claim its epoch itself"
)
DISTRIBUTION: Final = "rover-executive"
_NAMES: Final = tuple(definition.name for definition in (*DEFINED, *ORBITER_PARAMETERS))

ORBITER_ACTIONS: Final = {
    f"{CONTACT} UP": ContactOverride.UP,
    f"{CONTACT} DOWN": ContactOverride.DOWN,
    BY_PLAN: ContactOverride.BY_PLAN,
}
"""Text commands of Action.execute that the orbiter executes itself."""


class RoverProvider:
    """Serves the MRS of one rover, and publishes its reports and telemetry.

    Args:
        link_status: returns the present state of the link to it.
        order: overrides the contact plan for the rover, and returns the resulting state as text;
            raises BundleError.
        usage: returns the resource usage of the orbiter's process.
        link_timeout_s: time without reception after which the rover is OFFLINE.
        terms: encoding and certificates agreed on with the ground.
        system: the clock, and the sockets.

    Attributes:
        reports: counts the rover's reports.
    """

    def __init__(
        self,
        rover: RelayedRover,
        link_status: Callable[[], RelayLinkStatus],
        order: Callable[[ContactOverride], str],
        usage: Callable[[], ResourceUsage],
        link_timeout_s: float,
        terms: TransportSettings,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self.reports = ReportCounter()
        self.reports.resume(rover.record.ledger.published)
        self._rover, self._link_status, self._order = rover, link_status, order
        self._usage = usage
        self._utc_s = system.utc_s
        self._link_timeout_s = link_timeout_s
        self._names_are_authenticated = True
        self._settings = rover.settings
        offer = self._offer = ServedOperations(terms.encoding, system=system)
        serve_commands(offer, self, self._serves)
        named = (self._settings.asset, self._settings.domain)
        self._publish = offer.broadcast("Notification", "monitorNotification", *named)
        self._publish_value = offer.broadcast("Monitoring", "monitorValue", *named, droppable=True)
        offer.serve("Notification", "getNotifications", lambda _, *wanted: self._past(*wanted))
        offer.serve("Notification", "getLastNotification", lambda _: self._last())
        offer.serve("Monitoring", "getValue", lambda _, names: (self._present(names),))
        offer.serve("Monitoring", "listDefinition", lambda _: ((*DEFINED, *ORBITER_PARAMETERS),))
        offer.serve("MotionControl", "getPose", lambda _: (pose(rover),))
        offer.serve("MotionControl", "getSpeeds", lambda _: (speeds(rover),))
        offer.serve("Camera", "getState", lambda _: (camera_state(rover, video_on=False),))
        if self._serves("Plan", "activatePlan"):
            offer.serve("Plan", "getPlanNodes", lambda _, plan_id: (self._questions(plan_id),))
        offer.serve("Status", "getStatus", lambda _: (self._status(),))
        offer.serve("ServiceLayer", "getServices", lambda call: (self._offer.descriptors(call),))
        offer.serve("ServiceLayer", "getService", self._service)
        offer.serve("ServiceLayer", "getAsset", lambda _: (self._asset(),))

    async def start(self, host: str, tls: "ssl.SSLContext | None", clear_text: bool) -> None:
        """Start listening; raise as `Provider.start` does."""
        self._names_are_authenticated = tls is not None or is_loopback(host)
        await self._offer.provider.start(host, self._settings.port, tls, clear_text)
        self._rover.listener = self

    @property
    def asset(self) -> str:
        """Name of the rover."""
        return self._settings.asset

    @property
    def port(self) -> int:
        """TCP port of its MRS by the settings."""
        return self._settings.port

    @property
    def uri(self) -> MalUri:
        """URI of the service, once started."""
        return self._offer.provider.uri

    async def close(self) -> None:
        """Close all connections and stop listening."""
        self._rover.listener = None
        await self._offer.provider.close()

    async def submit(self, command: Command) -> None:
        """Uplink a command, or execute it at the orbiter.

        Raises:
            MalError: the command was rejected, or is a duplicate.
        """
        request = command.request
        if isinstance(request, ExecuteAction):
            parts = request.action.upper().split()
            if parts[:1] in ([CONTACT], [AUTHORITY]):
                await self._carry_out(command, " ".join(parts))
                return
            if not self._settings.serves("Action", "execute"):
                known = ", ".join(ORBITER_ACTIONS)
                text = f"the rover has no actions; the orbiter has: {known}"
                raise with_text(AreaError.NOT_SUPPORTED, text)
        await self._rover.submit(command)
        self.reports.begin(command.identity, command.name)

    def on_report(self, report: Report, cursor: int | None) -> None:
        """Broadcast a report."""
        if cursor is not None:
            self.reports.note(report, cursor, is_lost=lost_command(report) is not None)
        notification = notification_of(report, cursor)
        self._publish(notification, keys=notification_keys(self._settings.asset, notification))

    def on_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Broadcast the rover's values."""
        self._broadcast(tuple(map(parameter_value, values)))

    def publish_health(self) -> None:
        """Broadcast the state of the link to the rover."""
        self._broadcast(self._health())

    def _serves(self, service: str, operation: str) -> bool:
        here = (service, operation) == ("Action", "execute")  # the orbiter has its own actions
        return here or self._settings.serves(service, operation)

    async def _carry_out(self, command: Command, action: str) -> None:
        await self._rover.require_new(command)
        try:
            result = self._act(action, command.identity.source)
        except BundleError as error:
            raise with_text(AreaError.REJECTED, str(error)) from error
        self.reports.begin(command.identity, command.name)
        now_s = self._utc_s()
        report = Report(
            *(
                UNNUMBERED,
                now_s,
                ReportKind.COMMAND,
                Severity.INFORMATIONAL,
                result,
                command.identity,
            ),
            *(Stage.EXECUTED, LINK),
        )
        try:
            await self._rover.carried_out(replace(command, link=LINK), report)
        except LedgerError as error:
            raise with_text(StandardError.INTERNAL, str(error)) from error

    def _act(self, action: str, source: str) -> str:
        """Execute an action of the orbiter for a source; return the resulting state as text."""
        override = ORBITER_ACTIONS.get(action)
        if override is not None:
            return self._order(override)
        epoch = re.fullmatch(f"{AUTHORITY} ([0-9]{{1,18}}|NONE)", action)
        if epoch is None:
            known = f"{', '.join(ORBITER_ACTIONS)}, {AUTHORITY} EPOCH, {AUTHORITY} NONE"
            raise with_text(
                AreaError.NOT_SUPPORTED, f"unknown action {action[:40]!r}; the orbiter has: {known}"
            )
        if not self._names_are_authenticated:
            raise with_text(AreaError.REJECTED, UNAUTHENTICATED_TEXT)
        if epoch[1] == "NONE":
            self._rover.record.set_authority(None, source)
            return f"commands of {source} are uplinked without the authority of the orbiter"
        self._rover.record.set_authority(int(epoch[1]), source)
        return f"commands of {source} are uplinked under the authority of epoch {int(epoch[1])}"

    def _broadcast(self, values: Sequence[wire.ParameterValue]) -> None:
        for value in values:
            self._publish_value(value, keys=(self._settings.asset, value.name))

    def _past(
        self, since: int | None, command_id: int | None, maximum: int
    ) -> tuple[tuple[wire.Notification, ...]]:
        first = min(since or 0, LAST_SEQUENCE)
        ledger = self._rover.record.ledger
        found = ledger.recorded(first, command_id, page_size(maximum))
        return (
            tuple(
                notification_of(each.report, each.cursor)
                for each in found
                if each.cursor <= ledger.published
            ),
        )

    def _last(self) -> tuple[wire.Notification | None]:
        last = self._rover.record.ledger.last()
        return (None if last is None else notification_of(last.report, last.cursor),)

    def _present(self, names: Sequence[str]) -> tuple[wire.ParameterValue, ...]:
        known = {value.name: value for value in self._all_values()}
        return tuple(find_or_raise(known, name) for name in names or _NAMES)

    def _all_values(self) -> tuple[wire.ParameterValue, ...]:
        own = tuple(map(parameter_value, self._rover.parameters()))
        return (*own, *self._health())

    def _health(self) -> tuple[wire.ParameterValue, ...]:
        utc_s, status, aboard = self._utc_s(), self._link_status(), self._rover.aboard
        usage, reported = usage_figures(ORBITER, self._usage()), self._rover.housekeeping
        return (
            *status.values(utc_s),
            *aboard_values(aboard),
            *status.planned.values(),
            *housekeeping_values(ORBITER_HOUSEKEEPING, usage, utc_s),
            *housekeeping_values(ABOARD_HOUSEKEEPING, reported.figures, reported.utc_s),
        )

    def _status(self) -> wire.AssetStatus:
        record, own = self._rover.record, self._rover.parameters()
        return wire.AssetStatus(
            timestamp=to_ns(own[0].utc_s),
            mode=self._mode(),
            activeCommandId=record.outstanding.active(),
            queuedCommands=record.outstanding.queued(),
            activePlan=next((plan_id for plan_id, _ in self._rover.questions.questions), None),
            values=self._all_values(),
        )

    def _questions(self, plan_id: str) -> tuple[wire.PlanNode, ...]:
        """Return the nodes of a plan with an open question: no others are known here."""
        found = [each for plan, each in self._rover.questions.questions if plan == plan_id]
        if not found:
            text = f"{plan_id[:64]}: the orbiter knows open questions only, and none of this plan"
            raise with_text(AreaError.NOT_FOUND, text)
        return tuple(
            wire_node(PlanNodeReport(each.key, "Ask", 0, NodeStatus.RUNNING, question=each))
            for each in found
        )

    def _mode(self) -> wire.AssetMode:
        record = self._rover.record
        if self._link_status().last_received_s > self._link_timeout_s:
            return wire.AssetMode.OFFLINE
        mode = self._rover.mode()
        if mode is not None:
            return wire.AssetMode(mode.value)
        if record.active_stop() is not None:
            return wire.AssetMode.STOPPED
        return wire.AssetMode.IDLE if record.outstanding.active() is None else wire.AssetMode.MOVING

    def _asset(self) -> wire.AssetInfo:
        return wire.AssetInfo(
            asset=self._settings.asset,
            domain=self._settings.domain,
            description=self._settings.description,
            softwareVersion=version(DISTRIBUTION),
            mode=self._mode(),
        )

    def _service(self, call: CallContext, name: str) -> tuple[wire.ServiceDescriptor]:
        return (find_or_raise({each.name: each for each in self._offer.descriptors(call)}, name),)
