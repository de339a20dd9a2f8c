"""What the rover does when nothing is heard of the ground, in stages, for what it is about.

Anything that the ground sends on either link is a sign of it; what is asked or commanded aboard is
none. By default the rover goes on. Once a stage is reached, the others of its mode follow, whatever
has become of the motion, until the ground is heard.
"""

from dataclasses import dataclass
from math import sin
from typing import Final

from executive.commands import Mode, Waypoint
from executive.settings import LinkLossSettings, LinkLossStage
from executive.values.clock import Clock
from executive.values.geometry import Point, Pose

SHORTEST_M: Final = 0.3
"""Of a straight line of the way back."""
ASIDE_M: Final = 0.1
"""How far the rover came beside a straight line of the way back, at most, beyond its beginning."""


@dataclass(frozen=True, slots=True)
class LinkLossStageReached:
    """A stage that has been reached, after so many seconds of silence."""

    stage: LinkLossStage
    silent_s: float


class ReturnPath:
    """The way that the rover came, as straight lines."""

    def __init__(self) -> None:
        self._began: Pose | None = None
        self._corners: list[Point] = []
        self._ahead: Point | None = None
        self._last = Point(0.0, 0.0)

    def follow(self, pose: Pose) -> None:
        """Begin where the rover is now, or go on to there; the more often, the better."""
        point = pose.point
        if self._began is None:
            self._began, self._corners = pose, [point]
        corner = self._corners[-1]
        if self._ahead is None:
            if corner.distance_m(point) >= SHORTEST_M:
                self._ahead = point
        elif _aside_m(corner, self._ahead, point) > ASIDE_M:
            self._corners.append(self._last)
            self._ahead = None
        self._last = point

    @property
    def back(self) -> tuple[Waypoint, ...]:
        """The way back to where it began, and the heading there; empty if it has not begun."""
        if self._began is None:
            return ()
        *way, end = (Waypoint(corner.x_m, corner.y_m) for corner in reversed(self._corners))
        return (*way, Waypoint(end.x_m, end.y_m, self._began.heading_rad))


def _aside_m(start: Point, ahead: Point, point: Point) -> float:
    """Return how far a place lies beside the line through two others."""
    return start.distance_m(point) * abs(sin(start.bearing_rad(point) - start.bearing_rad(ahead)))


class GroundMonitor:
    """Counts for how long nothing has been heard of the ground.

    Attributes:
        heard: whether the last look found a sign of it.
        stage: the last stage that was reached since the ground was heard; None before the first.
        trail: the way from where the ground was last heard, if the settings have a use for it.
    """

    def __init__(self, clock: Clock, settings: LinkLossSettings) -> None:
        self._clock = clock
        self._settings = settings
        self._heard_s = clock.now_s()
        self._sign = False
        self._mode = Mode.IDLE
        self.heard = False
        self.stage: LinkLossStage | None = None
        self.trail = ReturnPath()

    def hear(self) -> None:
        """Take a sign of the ground, from any thread."""
        self._sign = True

    @property
    def silent_s(self) -> float:
        """Seconds since the last sign."""
        return self._clock.now_s() - self._heard_s

    def look(self, mode: Mode, pose: Pose | None, returning: bool) -> LinkLossStageReached | None:
        """Return the stage that is reached now, if it is another one than before.

        Args:
            mode: what the rover is about.
            pose: where it is; None if that is not known.
            returning: whether it is about nothing but a stage that was reached before.
        """
        self.heard = self._sign
        if self.heard:
            self._sign, self._heard_s, self.stage = False, self._clock.now_s(), None
            self.trail = ReturnPath()
        if pose is not None and not returning and self._settings.returns:
            self.trail.follow(pose)
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
