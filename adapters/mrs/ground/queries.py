"""What a client can ask a rover: every served operation that only reads."""

from typing import Any, Final

from adapters.mal import MalError, NamedValue, StandardError
from adapters.mrs.ground.session import Session
from adapters.mrs.spec import (
    AssetInfo,
    AssetStatus,
    CameraState,
    Notification,
    ParameterDefinition,
    ParameterValue,
    Pose,
    ServiceDescriptor,
    Speeds,
)

LOST: Final = {StandardError.DESTINATION_LOST.value, StandardError.SHUTDOWN.value}
"""What an interaction ends with when the link or the rover goes away before the answer."""


class Queries:
    """Asks over a session, and asks again when the link was lost before the answer.

    All methods raise ConnectionError when the rover does not come back in time, and MalError when
    the rover answers with an error.
    """

    def __init__(self, session: Session) -> None:
        """Ask over this session."""
        self._session = session

    async def get_notifications(
        self, since: int | None = None, command_id: int | None = None, max_count: int = 0
    ) -> tuple[Notification, ...]:
        """Return notifications of the past, oldest first; 0 for as many as come at once."""
        arguments = (since, command_id, max_count)
        found: tuple[Notification, ...] = await self._one(
            "Notification", "getNotifications", *arguments
        )
        return found

    async def get_value(self, *names: str) -> tuple[ParameterValue, ...]:
        """Return present parameter values, all if none is named."""
        values: tuple[ParameterValue, ...] = await self._one("Monitoring", "getValue", names)
        return values

    async def list_definition(self) -> tuple[ParameterDefinition, ...]:
        """Return what the parameters mean."""
        definitions: tuple[ParameterDefinition, ...] = await self._one(
            "Monitoring", "listDefinition"
        )
        return definitions

    async def get_pose(self) -> Pose:
        """Return where the rover is; NaN what is not known."""
        pose: Pose = await self._one("MotionControl", "getPose")
        return pose

    async def get_speeds(self) -> Speeds:
        """Return how fast the rover may move, and does; NaN what is not known."""
        speeds: Speeds = await self._one("MotionControl", "getSpeeds")
        return speeds

    async def list_actions(self) -> tuple[NamedValue, ...]:
        """Return the text commands that there are, each with what it does."""
        actions: tuple[NamedValue, ...] = await self._one("Action", "listActions")
        return actions

    async def get_camera_state(self) -> CameraState:
        """Return where the camera points, NaN what is not known, and whether video is on."""
        state: CameraState = await self._one("Camera", "getState")
        return state

    async def get_status_interval_s(self) -> float:
        """Return how often telemetry is sent, in seconds; 0 for on change."""
        interval_s: float = await self._one("Status", "getStatusInterval")
        return interval_s

    async def get_status(self) -> AssetStatus:
        """Return mode, work and all parameters."""
        status: AssetStatus = await self._one("Status", "getStatus")
        return status

    async def get_asset(self) -> AssetInfo:
        """Return what this rover is."""
        asset: AssetInfo = await self._one("ServiceLayer", "getAsset")
        return asset

    async def list_assets(self) -> tuple[AssetInfo, ...]:
        """Return this rover and all others that it heard of; OFFLINE who does not answer it."""
        assets: tuple[AssetInfo, ...] = await self._one("MonitoringClient", "listAssets")
        return assets

    async def get_asset_value(self, asset: str, *names: str) -> tuple[ParameterValue, ...]:
        """Return the parameter values that this rover last heard of another, all if none named."""
        values: tuple[ParameterValue, ...] = await self._one(
            "MonitoringClient", "getValue", asset, names
        )
        return values

    async def get_asset_notifications(
        self, asset: str, since: int | None = None, max_count: int = 0
    ) -> tuple[Notification, ...]:
        """Return what this rover heard another report, oldest first."""
        found: tuple[Notification, ...] = await self._one(
            "NotificationClient", "getNotifications", asset, since, max_count
        )
        return found

    async def get_services(self) -> tuple[ServiceDescriptor, ...]:
        """Return the services and operations that work there."""
        services: tuple[ServiceDescriptor, ...] = await self._one("ServiceLayer", "getServices")
        return services

    async def get_service(self, name: str) -> ServiceDescriptor:
        """Return one service."""
        service: ServiceDescriptor = await self._one("ServiceLayer", "getService", name)
        return service

    async def _one(self, service: str, operation: str, *arguments: Any) -> Any:
        while True:
            consumer = await self._session.consumer()
            try:
                (answer,) = await consumer.request(service, operation, *arguments)
                return answer
            except MalError as error:
                if error.number not in LOST:
                    raise
                await self._session.drop(consumer)
