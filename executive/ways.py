"""How the rover of an asset is moved: its settings choose."""

from typing import assert_never

from executive.by_velocity import VelocityLocomotion, VelocityMover
from executive.by_whole_motion import WholeLocomotion, WholeMotionMover
from executive.clock import Clock
from executive.locomotion import Locomotion, Mover
from executive.ports import MotionRover, VelocityRover
from executive.settings import Settings, Way
from executive.status import Status


def ways(
    rover: VelocityRover | MotionRover, clock: Clock, settings: Settings, status: Status
) -> tuple[Locomotion, Mover]:
    """Return what makes motions, and what commands them, of an asset.

    Raises:
        TypeError: the rover is not of the kind that the settings name.
    """
    match settings.locomotion:
        case Way.VELOCITY if isinstance(rover, VelocityRover):
            mover = VelocityMover(clock, settings, status, rover)
            return VelocityLocomotion(clock, settings, status), mover
        case Way.WHOLE_MOTION if isinstance(rover, MotionRover):
            return WholeLocomotion(settings, status), WholeMotionMover(clock, status, rover)
        case Way.VELOCITY | Way.WHOLE_MOTION:
            raise TypeError(f"{rover} does not move by {settings.locomotion.value}")
        case _:
            assert_never(settings.locomotion)
