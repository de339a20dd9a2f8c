"""`Queries` of a client to a rover, repeated if the link was lost before the answer."""

from typing import Any, Final, TypeVar

from adapters.explanation import UnknownCommandError
from adapters.mal import MalError, NamedValue, StandardError
from adapters.mrs import spec as wire
from adapters.mrs.ground.session import RoverSession
from adapters.mrs.spec import (
    CHECK_LIMIT_S,
    AssetInfo,
    AssetStatus,
    CameraState,
    FaultStatus,
    FileInfo,
    History,
    Notification,
    ParameterDefinition,
    ParameterValue,
    PlanCheck,
    PlanCheckLevel,
    PlanPreview,
    Pose,
    Preview,
    ReceivedReport,
    ReceivedValue,
    ServiceDescriptor,
    Speeds,
    arguments_from,
    definition_of,
    frame_supplements,
    history_of,
    plan_node_of,
    plan_update_of,
    preview_request,
    received_report,
    received_value,
    to_ns,
    wire_definition,
)
from executive.commands import Motion, PlanDefinition
from executive.history import RunHistory
from executive.values.plan_nodes import PlanNodeReport
from executive.values.reports import Identity, PlanUpdate

T = TypeVar("T")

LINK_LOST_ERRORS: Final = {StandardError.DESTINATION_LOST.value, StandardError.SHUTDOWN.value}
"""Errors of an interaction if the link or the rover is lost before the answer."""

PREVIEW_TIMEOUT_S: Final = 70.0
"""Timeout of a preview, s; the rover aborts it after 60 s."""

CHECK_MARGIN_S: Final = 10.0
"""Timeout of a check of a plan beyond its limit aboard, s."""

MAX_COMMAND_ID: Final = (1 << 63) - 1


def _is_number(text: str) -> bool:
    """Whether a text is a command number that fits the wire type."""
    digits = text.removeprefix("-")
    return digits.isascii() and digits.isdigit() and int(digits) <= MAX_COMMAND_ID


class Queries:
    """Queries over a session, repeated if the link was lost before the answer.

    All methods raise ConnectionError if the link does not recover in time, and MalError if the
    rover answers with an error.
    """

    def __init__(self, session: RoverSession, round_trip_s: float) -> None:
        self._session, self._round_trip_s = session, round_trip_s

    async def get_notifications(
        self, since: int | None = None, command_id: int | None = None, max_count: int = 0
    ) -> tuple[ReceivedReport, ...]:
        """Return recorded reports from a cursor on; `max_count` 0 for a full page."""
        wanted = (since, command_id, max_count)
        page = await self._list(Notification, "Notification", "getNotifications", *wanted)
        return tuple(map(received_report, page))

    async def get_all_notifications(
        self, since: int | None = None, command_id: int | None = None
    ) -> list[ReceivedReport]:
        """Return all recorded reports from a cursor on, page by page."""
        found: list[ReceivedReport] = []
        while page := await self.get_notifications(since, command_id):
            found += page
            since = page[-1].cursor + 1
        return found

    async def get_last_notification(self) -> ReceivedReport | None:
        """Return the last recorded report, or None."""
        last: Notification | None = await self._query("Notification", "getLastNotification")
        return None if last is None else received_report(last)

    async def get_history(
        self, command: str | None = None, *, everything: bool = False
    ) -> RunHistory:
        """Return the history of a command, or the present state; see `adapters.explanation`.

        Args:
            command: its number, or `SOURCE:NUMBER`; None for the present state.
            everything: return all stored commands, reports and modes.

        Raises:
            UnknownCommandError: the text is no command id.
        """
        source, _, number = (command or "").rpartition(":")
        if command is not None and not _is_number(number):
            raise UnknownCommandError(f"{command} is neither NUMBER nor SOURCE:NUMBER")
        wanted = (source or None, None if command is None else int(number), everything)
        return history_of(await self._one(History, "Notification", "getHistory", *wanted))

    async def get_arguments(self, identity: Identity) -> dict[str, Any]:
        """Return the arguments of a command by name, in SI units and radians.

        Raises:
            MalError: also NotFound, the rover no longer stores the request.
        """
        wanted = (identity.source, identity.command_id)
        return arguments_from(await self._list(NamedValue, "Notification", "getArguments", *wanted))

    async def get_value(self, *names: str) -> tuple[ReceivedValue, ...]:
        """Return present parameter values; all without names."""
        values = await self._list(ParameterValue, "Monitoring", "getValue", names)
        return tuple(map(received_value, values))

    async def list_definition(self) -> tuple[ParameterDefinition, ...]:
        """Return the definitions of the parameters."""
        return await self._list(ParameterDefinition, "Monitoring", "listDefinition")

    async def get_pose(self) -> Pose:
        """Return the pose of the rover; unknown figures are NaN."""
        return await self._one(Pose, "MotionControl", "getPose")

    async def get_obstacles(self) -> tuple[wire.ScannedObstacle, ...]:
        """Return the obstacles that the laser has detected, in the odometry frame."""
        return await self._list(wire.ScannedObstacle, "MotionControl", "getObstacles")

    async def get_speeds(self) -> Speeds:
        """Return the maximum and present speeds; unknown figures are NaN."""
        return await self._one(Speeds, "MotionControl", "getSpeeds")

    async def preview(self, motion: Motion) -> Preview:
        """Return the prediction of a motion command, without sending it."""
        wanted = preview_request(motion)
        parts = (wanted.operation, wanted.waypoints, wanted.figures, wanted.controller)
        preview: Preview = await self._query(
            *("MotionControl", "preview", *parts),
            supplements=frame_supplements(motion),
            timeout_s=PREVIEW_TIMEOUT_S,
        )
        return preview

    async def preview_plan(self, plan: PlanDefinition) -> Preview:
        """Return the prediction of a plan, without submitting it."""
        wanted = ("Plan", "previewPlan", wire_definition(plan))
        preview: Preview = await self._query(*wanted, timeout_s=PREVIEW_TIMEOUT_S)
        return preview

    async def preview_steps(self, plan: PlanDefinition) -> PlanPreview:
        """Return the prediction of a plan and of its steps, without submitting it."""
        wanted = ("Plan", "previewSteps", wire_definition(plan))
        preview: PlanPreview = await self._query(*wanted, timeout_s=PREVIEW_TIMEOUT_S)
        return preview

    async def check_plan(
        self,
        plan: PlanDefinition,
        level: PlanCheckLevel,
        draws: int | None = None,
        begin_utc_s: float | None = None,
    ) -> PlanCheck:
        """Return the result of a check of a plan aboard, without submitting it.

        Args:
            plan: the plan.
            level: depth of the check.
            draws: number of runs of `TRY`; None for the rover's default.
            begin_utc_s: planned begin for `CHECK`, s UTC; None if unknown.

        Raises:
            MalError: also Busy, another check runs or this one exceeded its limits; NotSupported,
                the rover has not the software for `TRY`.
        """
        begin = None if begin_utc_s is None else to_ns(begin_utc_s)
        wanted = ("Plan", "checkPlan", wire_definition(plan), level, draws, begin)
        limit_s = CHECK_LIMIT_S[level] + CHECK_MARGIN_S
        check: PlanCheck = await self._query(*wanted, timeout_s=limit_s)
        return check

    async def list_actions(self) -> tuple[NamedValue, ...]:
        """Return the supported text commands, each with its help."""
        return await self._list(NamedValue, "Action", "listActions")

    async def get_camera_state(self) -> CameraState:
        """Return camera angles, NaN if unknown, and whether video is on."""
        return await self._one(CameraState, "Camera", "getState")

    async def get_status_interval_s(self) -> float:
        """Return the telemetry interval in s; 0 for on change."""
        return await self._one(float, "Status", "getStatusInterval")

    async def get_status(self) -> AssetStatus:
        """Return mode, active command, queue and all parameters."""
        return await self._one(AssetStatus, "Status", "getStatus")

    async def get_faults(self) -> FaultStatus:
        """Return the reason for standstill, the active faults, and the checks that do not run."""
        return await self._one(FaultStatus, "Status", "getFaults")

    async def get_plan_status(self, *plan_ids: str) -> tuple[PlanUpdate, ...]:
        """Return the status of plans; all without ids."""
        plans = await self._list(wire.PlanUpdate, "Plan", "getPlanStatus", plan_ids)
        return tuple(map(plan_update_of, plans))

    async def get_plan_nodes(self, plan_id: str) -> tuple[PlanNodeReport, ...]:
        """Return the nodes of a plan with their progress."""
        found = await self._list(wire.PlanNode, "Plan", "getPlanNodes", plan_id)
        return tuple(plan_node_of(plan_id, each) for each in found)

    async def get_plan(self, plan_id: str) -> PlanDefinition:
        """Return a plan as submitted."""
        return definition_of(await self._one(wire.PlanDefinition, "Plan", "getPlan", plan_id))

    async def list_files(self, folder: str | None = None) -> tuple[FileInfo, ...]:
        """Return the files of a folder and its subfolders, None for all.

        A rover returns at most 1000, those changed last.
        """
        return await self._list(FileInfo, "FileTransfer", "listFiles", folder)

    async def get_attributes(self, path: str) -> FileInfo:
        """Return the attributes of a file with checksum and metadata."""
        return await self._one(FileInfo, "FileManagement", "getAttributes", path)

    async def get_asset(self) -> AssetInfo:
        """Return the description of this rover."""
        return await self._one(AssetInfo, "ServiceLayer", "getAsset")

    async def list_assets(self) -> tuple[AssetInfo, ...]:
        """Return this rover and the assets known to it; OFFLINE if one does not answer."""
        return await self._list(AssetInfo, "MonitoringClient", "listAssets")

    async def get_asset_value(self, asset: str, *names: str) -> tuple[ReceivedValue, ...]:
        """Return the last values that this rover received of another asset; all without names."""
        values = await self._list(ParameterValue, "MonitoringClient", "getValue", asset, names)
        return tuple(map(received_value, values))

    async def get_asset_notifications(
        self, asset: str, since: int | None = None, max_count: int = 0
    ) -> tuple[ReceivedReport, ...]:
        """Return the reports that this rover received of another asset, oldest first."""
        wanted = (asset, since, max_count)
        page = await self._list(Notification, "NotificationClient", "getNotifications", *wanted)
        return tuple(map(received_report, page))

    async def get_services(self) -> tuple[ServiceDescriptor, ...]:
        """Return the services with their supported operations."""
        return await self._list(ServiceDescriptor, "ServiceLayer", "getServices")

    async def get_service(self, name: str) -> ServiceDescriptor:
        """Return one service."""
        return await self._one(ServiceDescriptor, "ServiceLayer", "getService", name)

    async def _one(self, _: type[T], service: str, operation: str, *arguments: Any) -> T:
        answer: T = await self._query(service, operation, *arguments)
        return answer

    async def _list(
        self, _: type[T], service: str, operation: str, *arguments: Any
    ) -> tuple[T, ...]:
        answer: tuple[T, ...] = await self._query(service, operation, *arguments)
        return answer

    async def _query(self, service: str, operation: str, *arguments: Any, **options: Any) -> Any:
        if "timeout_s" in options:
            options["timeout_s"] += self._round_trip_s
        while True:
            consumer = await self._session.consumer()
            try:
                (answer,) = await consumer.request(service, operation, *arguments, **options)
                return answer
            except MalError as error:
                if error.number not in LINK_LOST_ERRORS:
                    raise
                await self._session.drop(consumer)
