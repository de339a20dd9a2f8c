"""Loss of the ground link: its timeouts in stages of each mode, and the `ReturnPath` to drive back.

Any message of the ground on either link counts as contact; queries and commands from aboard do
not. By default the rover continues. Once a stage is reached, the further stages of its mode follow,
even if the motion has ended, until the next contact.
"""

from dataclasses import dataclass
from math import sin
from typing import Final

from executive.commands import Mode, Waypoint
from executive.settings import LinkLossSettings, LinkLossStage
from executive.values.clock import Clock
from executive.values.geometry import Point, Pose

MIN_SEGMENT_M: Final = 0.3
"""Minimum length of a line segment of the return path; chosen, not measured."""
MAX_CROSS_TRACK_M: Final = 0.1
"""Maximum lateral deviation of the track from a line segment of the return path."""


@dataclass(frozen=True, slots=True)
class LinkLossStageReached:
    """A stage that has been reached, and the seconds since the last contact."""

    stage: LinkLossStage
    silent_s: float


class ReturnPath:
    """The rover's track as line segments, to return along."""

    def __init__(self) -> None:
        self._began: Pose | None = None
        self._corners: list[Point] = []
        self._ahead: Point | None = None
        self._last = Point(0.0, 0.0)

    def extend(self, pose: Pose) -> None:
        """Extend the track to the present pose; frequent calls make it more accurate."""
        point = pose.point
        if self._began is None:
            self._began, self._corners = pose, [point]
        corner = self._corners[-1]
        if self._ahead is None:
            if corner.distance_m(point) >= MIN_SEGMENT_M:
                self._ahead = point
        elif _cross_track_m(corner, self._ahead, point) > MAX_CROSS_TRACK_M:
            self._corners.append(self._last)
            self._ahead = None
        self._last = point

    @property
    def path_back(self) -> tuple[Waypoint, ...]:
        """Waypoints back to the start of the track and its heading; empty without a track."""
        if self._began is None:
            return ()
        *path, end = (Waypoint(corner.x_m, corner.y_m) for corner in reversed(self._corners))
        return (*path, Waypoint(end.x_m, end.y_m, self._began.heading_rad))


def _cross_track_m(start: Point, ahead: Point, point: Point) -> float:
    """Return the lateral distance of a point from the line through two others."""
    return start.distance_m(point) * abs(sin(start.bearing_rad(point) - start.bearing_rad(ahead)))


class GroundMonitor:
    """Measures the time since the last contact with the ground.

    Attributes:
        in_contact: whether the last `update` found a contact.
        had_contact: whether any `update` did; until then the silence began before this process.
        stage: the last stage reached since the last contact; None before the first.
        trail: track since the last contact, if the settings use it.
    """

    def __init__(self, clock: Clock, settings: LinkLossSettings) -> None:
        self._clock = clock
        self._settings, self._returns = settings, settings.returns
        self._last_contact_s = clock.now_s()
        self._contact_flag = False
        self._mode = Mode.IDLE
        self.in_contact = self.had_contact = False
        self.stage: LinkLossStage | None = None
        self.trail = ReturnPath()

    def record_contact(self) -> None:
        """Note a contact with the ground, from any thread."""
        self._contact_flag = True

    @property
    def silent_s(self) -> float:
        """Seconds since the last contact."""
        return self._clock.now_s() - self._last_contact_s

    def update(self, mode: Mode, pose: Pose | None, returning: bool) -> LinkLossStageReached | None:
        """Return the stage that is newly reached, or None.

        Args:
            mode: the present mode.
            pose: the present pose; None if it is not known.
            returning: whether the only motion is the reaction to an earlier stage.
        """
        self.in_contact = self._contact_flag
        if self.in_contact:
            self.had_contact = True
            self._contact_flag, self._last_contact_s, self.stage = False, self._clock.now_s(), None
            self.trail = ReturnPath()
        if pose is not None and not returning and self._returns:
            self.trail.extend(pose)
        if not returning and (self.stage is None or self._stages(mode)):
            self._mode = mode
        silent_s = self.silent_s
        reached = [each for each in self._stages(self._mode) if silent_s >= each.after_s]
        if not reached or reached[-1] == self.stage:
            return None
        self.stage = reached[-1]
        return LinkLossStageReached(self.stage, silent_s)

    def _stages(self, mode: Mode) -> tuple[LinkLossStage, ...]:
        match mode:
            case Mode.TELEOP:
                return self._settings.teleop
            case Mode.MOVING:
                return self._settings.motion
            case Mode.PLAN:
                return self._settings.plan
            case _:
                return ()
