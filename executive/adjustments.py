"""What settings commands set; it holds over a restart."""

from typing import assert_never

from executive.commands import (
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    Setting,
    SetTravelSpeed,
)
from executive.context import Context
from executive.geometry import Pose
from executive.limits import check
from executive.notifications import Notifications
from executive.reports import Severity
from executive.telemetry import Telemetry


class Adjustments:
    """Sets speeds, the compensation of the position, and the interval of telemetry."""

    def __init__(
        self, context: Context, telemetry: Telemetry, notifications: Notifications
    ) -> None:
        """Leave all as it is."""
        self._context = context
        self._telemetry = telemetry
        self._notifications = notifications

    def make(self, setting: Setting) -> None:
        """Set what a command sets."""
        status = self._context.status
        match setting:
            case SetTravelSpeed(speed_mps):
                status.travel_speed_mps = speed_mps
            case SetRotateSpeed(speed_radps):
                status.rotate_speed_radps = speed_radps
            case SetPositionCompensation(x_m, y_m, z_m, heading_rad):
                status.compensation = Pose(x_m, y_m, z_m, heading_rad)
            case SetCameraRotateSpeed(speed_radps):
                status.camera_speed_radps = speed_radps
            case SetStatusInterval(interval_s):
                self._telemetry.set_interval(interval_s)
            case _:
                assert_never(setting)

    def restore(self, setting: Setting) -> None:
        """Set again what a process before this one had set, if it fits today's configuration."""
        refusal = check(setting, self._context.settings, self._context.status.pose.point)
        if refusal is None:
            self.make(setting)
        else:
            self._notifications.event(
                Severity.WARNING, f"a setting no longer fits and is forgotten: {refusal.text}"
            )
