"""A rover that carries out whole motions by itself, without physics."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from executive.settings import LocomotionKind, Settings, load_settings
from executive.values.facts import MotionEnded
from executive.values.geometry import STANDING, Velocity
from executive.values.ports import DelegatedMotion, DriveBy, TurnBy, VelocityHold
from tests.support.kinematic import Bench, KinematicRover


@dataclass
class SelfMovingRover(KinematicRover):
    """Takes one motion at a time; another one takes its place.

    Attributes:
        reported: what it was told, in order; None for halt.
        refuses: whether it ends every motion at once, not executed.
        deaf: whether it does nothing at all, not even halt.
        slip: what part of each motion it loses without noticing.
    """

    spin_centre_m: float = 0.0
    reported: list[DelegatedMotion | None] = field(default_factory=list)
    refuses: bool = False
    deaf: bool = False
    slip: float = 0.0
    _motion: DelegatedMotion | None = None
    _left_s: float = 0.0

    def execute_motion(self, motion: DelegatedMotion) -> None:
        self.reported.append(motion)
        if self.deaf:
            return
        if self.refuses:
            self.facts.append(MotionEnded(motion.number, False, "motor stuck"))
            return
        self._motion = motion
        match motion.primitive:
            case TurnBy(angle_rad, speed_radps):
                self._left_s = abs(angle_rad) / speed_radps
                self.velocity = Velocity(0.0, speed_radps if angle_rad > 0 else -speed_radps)
            case DriveBy(distance_m, speed_mps):
                self._left_s = abs(distance_m) / speed_mps
                self.velocity = Velocity(speed_mps if distance_m > 0 else -speed_mps, 0.0)
            case VelocityHold(velocity, duration_s):
                self._left_s, self.velocity = duration_s, velocity

    def halt(self) -> None:
        self.reported.append(None)
        if not self.deaf:
            self._end(executed=False, text="halted")

    def lock(self, held: bool) -> None:
        pass

    def emergency_stop(self) -> None:
        self.halt()

    def advance(self, step_s: float) -> None:
        moving_s = min(step_s, self._left_s)
        super().advance(moving_s * (1.0 - self.slip))
        self._left_s -= moving_s
        if self._motion is not None and self._left_s <= 0.0:
            self._end(executed=True)

    def _end(self, executed: bool, text: str = "") -> None:
        self.velocity = STANDING
        if self._motion is not None:
            self.facts.append(MotionEnded(self._motion.number, executed, text))
        self._motion = None
        self._left_s = 0.0


class SelfMovingBench(Bench):
    """An executive over a rover that moves by itself."""

    rover: SelfMovingRover

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, settings(), rover=SelfMovingRover())


def settings() -> Settings:
    """Return the settings of an asset that moves by itself."""
    jackal = load_settings("jackal")
    law = replace(jackal.turn_drive, control_point_m=0.0)
    at_once = replace(jackal.drive, travel_acceleration_mps2=1e9, rotate_acceleration_radps2=1e9)
    return replace(jackal, locomotion=LocomotionKind.DELEGATED, turn_drive=law, drive=at_once)
