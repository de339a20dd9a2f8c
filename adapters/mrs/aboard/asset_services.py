"""`AssetServices`: an asset's MRS operations except files: commands, state, telemetry, plans."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Sequence
from functools import partial
from importlib.metadata import version
from math import isfinite
from typing import Any, Final, Protocol

from adapters.mal import AttributeType, CallContext, NamedValue, StandardError, TypedAttribute
from adapters.mrs import spec as wire
from adapters.mrs.aboard.gateway import CoreGateway
from adapters.mrs.aboard.served_operations import PeerRateLimiter, ServedOperations
from adapters.mrs.spec import (
    DEFINED,
    LIST_PRECONDITIONS,
    MAX_FIGURES,
    MAX_SOURCE_LENGTH,
    MAX_TEXT_LENGTH,
    NUMBER_TYPES,
    PRECONDITIONS,
    REQUESTS,
    AreaError,
    CommandHeader,
    HousekeepingParameter,
    Notification,
    NotificationKind,
    command_of,
    figure_value,
    figure_values,
    find_or_raise,
    housekeeping_values,
    map_figures,
    notification_keys,
    notification_of,
    parameter_value,
    reported_uncertainty,
    require_at_most,
    to_ns,
    uncertainty_figures,
    wire_arguments,
    wire_definition,
    wire_node,
    wire_update,
    with_text,
)
from executive.commands import Command, Request
from executive.commands.actions import HELP, supported_actions
from executive.core.runner import Executive
from executive.faults import ClearPolicy
from executive.safety import Fault, unmonitored
from executive.settings import Settings
from executive.values.parameters import ParameterValue
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity, PlanUpdate, Report, Severity

PAGE: Final = 1000
"""Maximum notifications in one answer of getNotifications."""
LAST_SEQUENCE: Final = (1 << 63) - 1
"""Maximum sequence number of the ledger."""
SOFTWARE: Final = version("rover-executive")

EVENTS_HZ: Final = 10
"""Maximum events a second that one peer may have reported: the ledger stores them like reports."""
ALL_EVENTS_HZ: Final = 50
"""Maximum events a second of all peers together; both chosen, not measured."""

MONITOR_VALUE: Final = (
    ("Monitoring", "monitorValue"),
    ("MonitoringClient", "monitorAssetValue"),
)
"""Operations that broadcast a value: of this asset, and of all known assets."""
MONITOR_NOTIFICATION: Final = (
    ("Notification", "monitorNotification"),
    ("NotificationClient", "monitorAssetNotification"),
)


class CommandIntake(Protocol):
    """Receiver of commands: the gateway to the core, or an orbiter that forwards them."""

    def submit(self, command: Command) -> Awaitable[None]:
        """Submit a command; raises MalError, here or when awaited, if it is not accepted."""
        ...


class UpstreamPublisher(Protocol):
    """Publishes the data of this asset at another service layer."""

    def publish_value(self, value: wire.ParameterValue) -> None:
        """Publish a value."""

    def publish_notification(self, notification: Notification) -> None:
        """Publish a notification."""


def serve_commands(
    served: ServedOperations,
    intake: CommandIntake,
    known: Callable[[str, str], bool] = lambda *_: True,
) -> None:
    """Serve the operations of `REQUESTS`; each is acknowledged when the intake accepts it.

    `Status.listPreconditions` announces that their preconditions are obeyed.

    This is the path of a stop. Between the octets and the core's inbox a message is only decoded,
    and one command and one future are created.

    Operations for which `known` returns False are not served.
    """
    for (service, operation), make in REQUESTS.items():
        if known(service, operation):
            served.serve(service, operation, partial(_submit, served, intake, make))
    if known(*LIST_PRECONDITIONS):
        served.serve(*LIST_PRECONDITIONS, lambda _: (tuple(PRECONDITIONS),))


def _submit(
    served: ServedOperations,
    intake: CommandIntake,
    make: Callable[..., Request],
    call: CallContext,
    header: CommandHeader,
    *parts: Any,
) -> Awaitable[None]:
    command = command_of(header, call.supplements, make(*parts), call.peer_name)
    answer = intake.submit(command)
    if command.authority is not None and isinstance(answer, asyncio.Future):
        served.prioritize(call.connection, answer)
    return answer


class AssetServices:
    """Serves an executive. Its methods broadcast, and are called on the provider's loop.

    Attributes:
        above: publishes at the service layer that the asset joined; None if it joined none.
        housekeeping: the last housekeeping values of the executive; empty if none are measured.
    """

    def __init__(
        self,
        served: ServedOperations,
        gateway: CoreGateway,
        settings: Settings,
        housekeeping: Sequence[HousekeepingParameter] = (),
    ) -> None:
        self._gateway = gateway
        self._asset = settings.asset
        self.above: UpstreamPublisher | None = None
        self.housekeeping = housekeeping_values(housekeeping, {}, 0.0)
        named = (settings.asset, settings.domain)
        self._publish_value = [
            served.broadcast(*operation, *named, droppable=True) for operation in MONITOR_VALUE
        ]
        self._publish_notification = [
            served.broadcast(*operation, *named) for operation in MONITOR_NOTIFICATION
        ]
        self._publish_plan = served.broadcast("Plan", "monitorPlanExecution", *named)
        serve_commands(served, gateway)
        for service, operation, question in QUERIES:
            served.serve_query(service, operation, gateway, question)
        served.serve_query("Monitoring", "getValue", gateway, self._present_values)
        served.serve_query("Status", "getStatus", gateway, self._status)
        definitions = (*DEFINED, *(each.definition for each in housekeeping))
        served.serve("Monitoring", "listDefinition", lambda _: (definitions,))
        loop = asyncio.get_running_loop()
        self._of_peer = PeerRateLimiter(EVENTS_HZ, loop.time)
        self._of_all = PeerRateLimiter(ALL_EVENTS_HZ, loop.time)
        served.serve("Notification", "sendNotification", self._send_notification)

    def report(self, reports: Sequence[Report]) -> None:
        """Broadcast reports, and the housekeeping values that they change."""
        for report in reports:
            notification = notification_of(report)
            keys = notification_keys(self._asset, notification)
            for notify in self._publish_notification:
                notify(notification, keys=keys)
            if self.above is not None:
                self.above.publish_notification(notification)
            changed = reported_uncertainty(report).items() if self.housekeeping else ()
            self._broadcast(figure_value(*each, report.utc_s) for each in changed)

    def publish_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Broadcast parameter values of the rover."""
        self._broadcast(map(parameter_value, values))

    def publish_housekeeping(self, values: tuple[wire.ParameterValue, ...]) -> None:
        """Broadcast the executive's housekeeping, and store it for queries."""
        self.housekeeping = values
        self._broadcast(values)

    def _broadcast(self, values: Iterable[wire.ParameterValue]) -> None:
        for value in values:
            for notify in self._publish_value:
                notify(value, keys=(self._asset, value.name))
            if self.above is not None:
                self.above.publish_value(value)

    def publish_plan_update(self, update: PlanUpdate) -> None:
        """Broadcast the status of a plan."""
        keys = (self._asset, update.plan_id, update.status.value)
        self._publish_plan(wire_update(update), keys=keys)

    def _present_values(
        self, executive: Executive, names: Sequence[str]
    ) -> tuple[wire.ParameterValue, ...]:
        return present_values(executive, names, self._housekeeping_now(executive))

    def _status(self, executive: Executive) -> wire.AssetStatus:
        values, active = executive.parameters(), executive.active_command
        return wire.AssetStatus(
            timestamp=to_ns(values[0].utc_s),
            mode=wire.AssetMode(executive.mode.value),
            activeCommandId=active.command_id if active else None,
            queuedCommands=executive.queued_goals,
            activePlan=executive.active_plan,
            values=(*map(parameter_value, values), *self._housekeeping_now(executive)),
        )

    def _housekeeping_now(self, executive: Executive) -> tuple[wire.ParameterValue, ...]:
        """Return the stored housekeeping with the present uncertainty of the pose, and map."""
        status = executive.status
        figures = uncertainty_figures(status.uncertainty.figures) | map_figures(status.map_origin)
        utc_s = executive.parameters()[0].utc_s
        now = {name: figure_value(name, figure, utc_s) for name, figure in figures.items()}
        return tuple(now.get(each.name, each) for each in self.housekeeping)

    def _send_notification(
        self, call: CallContext, notification: Notification
    ) -> asyncio.Future[None]:
        """Report an event of a client through the executive, with the client's name in its text."""
        text, parameters = notification.text, notification.parameters or ()
        if notification.kind is not NotificationKind.EVENT:
            raise with_text(AreaError.INVALID, "kind: must be EVENT")
        if not text or len(text) > MAX_TEXT_LENGTH:
            raise with_text(AreaError.INVALID, f"text: 1 to {MAX_TEXT_LENGTH} characters")
        if len(parameters) > MAX_FIGURES:
            raise with_text(AreaError.INVALID, f"parameters: at most {MAX_FIGURES}")
        figures = tuple(map(_figure, parameters))
        peer = call.peer_name or call.connection.peer_host
        self._of_peer.admit(peer)
        self._of_all.admit("all peers together")
        own_text, severity = f"{peer}: {text}", notification.severity
        return self._gateway.query(
            lambda executive: _report(executive, severity, own_text, figures)
        )


def present_values(
    executive: Executive,
    names: Sequence[str],
    housekeeping: Sequence[wire.ParameterValue] = (),
) -> tuple[wire.ParameterValue, ...]:
    """Return the present values of the asset with its housekeeping; all if `names` is empty.

    Raises:
        MalError: NotFound, a parameter does not exist; TOO_MANY.
    """
    require_at_most(names)
    own = map(parameter_value, executive.parameters())
    by_name = {value.name: value for value in (*own, *housekeeping)}
    return tuple(find_or_raise(by_name, name) for name in names or by_name)


def past_notifications(
    executive: Executive, since: int | None, command_id: int | None, maximum: int
) -> tuple[Notification, ...]:
    """Return at most `maximum` notifications of the asset's ledger, 0 for a page; oldest first.

    `since` is the first cursor, aboard equal to the sequence number.
    """
    first = min(since or 0, LAST_SEQUENCE)
    return tuple(map(notification_of, executive.reports(first, command_id, page_size(maximum))))


def _last_notification(executive: Executive) -> Notification | None:
    found = past_notifications(executive, executive.last_sequence, None, 1)
    return found[0] if found else None


def page_size(maximum: int) -> int:
    """Return the number of notifications of an answer, given the requested maximum; 0 for all."""
    return min(maximum, PAGE) or PAGE


def own_info(executive: Executive) -> wire.AssetInfo:
    """Return the description of this asset."""
    settings = executive.settings
    return wire.AssetInfo(
        asset=settings.asset,
        domain=settings.domain,
        description=settings.description,
        softwareVersion=SOFTWARE,
        mode=wire.AssetMode(executive.mode.value),
    )


def _camera_state(executive: Executive) -> wire.CameraState:
    video = executive.video
    return wire.camera_state(executive, video is not None and video.enabled)


def _actions(executive: Executive) -> tuple[NamedValue, ...]:
    """Return the supported text commands, each with its help."""
    return tuple(
        NamedValue(name=action.value, value=TypedAttribute(AttributeType.STRING, HELP[action]))
        for action in supported_actions(executive.video)
    )


def _fault_status(executive: Executive) -> wire.FaultStatus:
    """Return the reason for standstill, the active faults, and the checks that do not run."""
    return wire.FaultStatus(
        timestamp=to_ns(executive.parameters()[0].utc_s),
        why=executive.why[:MAX_TEXT_LENGTH],
        active=tuple(map(_active_fault, executive.safety.active)),
        unmonitored=unmonitored(executive.settings, executive.safety.history),
    )


def _active_fault(fault: Fault) -> wire.ActiveFault:
    why = fault.refusal
    return wire.ActiveFault(
        name=fault.name,
        began=to_ns(fault.begun_utc_s),
        severity=fault.severity,
        reaction=wire.FaultReaction[fault.row.reaction.name],
        onResume=fault.row.clears is ClearPolicy.ON_RESUME,
        code=why.reason.value,
        text=why.text[:MAX_TEXT_LENGTH],
        parameters=figure_values(why.figures) or None,
    )


def _plan_updates(executive: Executive, wanted: Sequence[str]) -> tuple[wire.PlanUpdate, ...]:
    require_at_most(wanted)
    known = {update.plan_id: update for update in executive.plans()}
    return tuple(wire_update(find_or_raise(known, plan_id)) for plan_id in wanted or known)


def _plan(executive: Executive, plan_id: str) -> wire.PlanDefinition:
    plan = executive.plan_definition(plan_id)
    if plan is None:
        raise with_text(AreaError.NOT_FOUND, plan_id)
    return wire_definition(plan)


def _plan_nodes(executive: Executive, plan_id: str) -> tuple[wire.PlanNode, ...]:
    found = executive.plan_nodes(plan_id)
    if isinstance(found, Refusal):
        if found.reason is Reason.NO_SUCH_PLAN:
            raise with_text(AreaError.NOT_FOUND, plan_id)
        raise with_text(AreaError.REJECTED, found.text)
    return tuple(map(wire_node, found))


def _arguments(executive: Executive, source: str, command_id: int) -> tuple[NamedValue, ...]:
    identity = Identity(source, command_id)
    request = executive.request_of(identity)
    if request is None:
        raise with_text(AreaError.NOT_FOUND, str(identity))
    return wire_arguments(request)


def _obstacles(executive: Executive) -> tuple[wire.ScannedObstacle, ...]:
    """Return the obstacles that the laser has detected."""
    return tuple(
        wire.ScannedObstacle(x=each.x_m, y=each.y_m, radius=each.radius_m)
        for each in executive.status.obstacles.scanned
    )


def _report(
    executive: Executive, severity: Severity, text: str, figures: tuple[Figure, ...]
) -> None:
    """Report an event; raises INTERNAL if the ledger cannot store it."""
    if not executive.ledger_writable:
        raise with_text(StandardError.INTERNAL, "the ledger cannot be written")
    executive.report_event(severity, text, figures)


def _figure(parameter: NamedValue) -> Figure:
    value = parameter.value
    if len(parameter.name) > MAX_SOURCE_LENGTH:
        text = f"parameters: a name has at most {MAX_SOURCE_LENGTH} characters"
        raise with_text(AreaError.INVALID, text)
    if value is None or value.type not in NUMBER_TYPES or not isfinite(value.value):
        raise with_text(AreaError.INVALID, f"parameters: {parameter.name} is not a finite number")
    return Figure(parameter.name, float(value.value))


QUERIES: Final[tuple[tuple[str, str, Callable[..., Any]], ...]] = (
    ("Action", "listActions", _actions),
    ("Camera", "getState", _camera_state),
    ("MotionControl", "getObstacles", _obstacles),
    ("MotionControl", "getPose", wire.pose),
    ("MotionControl", "getSpeeds", wire.speeds),
    ("Notification", "getArguments", _arguments),
    ("Notification", "getNotifications", past_notifications),
    ("Notification", "getLastNotification", _last_notification),
    ("Plan", "getPlan", _plan),
    ("Plan", "getPlanNodes", _plan_nodes),
    ("Plan", "getPlanStatus", _plan_updates),
    ("Status", "getFaults", _fault_status),
    ("Status", "getStatusInterval", lambda executive: executive.status_interval_s),
    ("ServiceLayer", "getAsset", own_info),
)
"""Queries, answered on the core's thread by `question(executive, *parts)`."""
