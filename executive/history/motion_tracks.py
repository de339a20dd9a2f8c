"""`MotionTracks`: poses and velocities of a rover over a run, by each source that reports them."""

from dataclasses import dataclass
from enum import Enum
from statistics import mean
from typing import Final

from executive.core.recording import (
    Entry,
    FactObserved,
    HaltCommanded,
    Item,
    ProcessStart,
    Truth,
    VelocityCommanded,
)
from executive.settings import Settings
from executive.values.facts import Joints, Odometry, SecondOdometry
from executive.values.geometry import Pose, Velocity


class TrackSource(Enum):
    """Source of poses or velocities."""

    COMMANDED = "commanded"
    ODOMETRY = "odometry"
    WHEELS = "wheels"
    SECOND = "second odometry"
    TRUTH = "true"


@dataclass(frozen=True, slots=True)
class PoseAt:
    """A pose and its time; seconds since 1970-01-01 UTC."""

    utc_s: float
    pose: Pose


@dataclass(frozen=True, slots=True)
class VelocityAt:
    """A velocity and its time; seconds since 1970-01-01 UTC."""

    utc_s: float
    velocity: Velocity


TRACK_KINDS: Final = (Odometry, SecondOdometry, Joints, VelocityCommanded, HaltCommanded, Truth)
"""Kinds of items and facts that are used, besides process starts and entries."""


class MotionTracks:
    """A tape that stores all poses and velocities of a run.

    Attributes:
        settings: settings of the asset at the last start of the executive; None before the first.
        poses: poses of odometry, second odometry and truth; each in a frame of its own.
        velocities: velocities commanded, of the odometry and of the wheels.
    """

    def __init__(self) -> None:
        self.settings: Settings | None = None
        self.poses: dict[TrackSource, list[PoseAt]] = {
            source: [] for source in (TrackSource.ODOMETRY, TrackSource.SECOND, TrackSource.TRUTH)
        }
        self.velocities: dict[TrackSource, list[VelocityAt]] = {
            source: []
            for source in (TrackSource.COMMANDED, TrackSource.WHEELS, TrackSource.ODOMETRY)
        }
        self._utc_s = self._apart_s = 0.0

    def put(self, item: Item) -> None:
        """Process the next item."""
        if isinstance(item, Entry):
            self._utc_s, self._apart_s = item.utc_s, item.utc_s - item.now_s
        match item:
            case ProcessStart(settings=settings):
                self.settings = settings
            case FactObserved(fact=Odometry(pose=pose, velocity=velocity)):
                self._add_pose(TrackSource.ODOMETRY, pose)
                self._add_velocity(TrackSource.ODOMETRY, velocity)
            case FactObserved(fact=SecondOdometry(pose=pose)):
                self._add_pose(TrackSource.SECOND, pose)
            case FactObserved(fact=Joints() as joints):
                self._add_wheel_velocity(joints)
            case Truth(time_s=time_s, pose=pose):
                self.poses[TrackSource.TRUTH].append(PoseAt(time_s + self._apart_s, pose))
            case VelocityCommanded(velocity=velocity):
                self._add_velocity(TrackSource.COMMANDED, velocity)
            case HaltCommanded():
                self._add_velocity(TrackSource.COMMANDED, Velocity())
            case _:
                pass

    def _add_pose(self, source: TrackSource, pose: Pose) -> None:
        self.poses[source].append(PoseAt(self._utc_s, pose))

    def _add_velocity(self, source: TrackSource, velocity: Velocity) -> None:
        self.velocities[source].append(VelocityAt(self._utc_s, velocity))

    def _add_wheel_velocity(self, joints: Joints) -> None:
        wheels = None if self.settings is None else self.settings.sensors.joints
        if wheels is None or not joints.left_radps or not joints.right_radps:
            return
        left_mps = wheels.wheel_radius_m * mean(joints.left_radps)
        right_mps = wheels.wheel_radius_m * mean(joints.right_radps)
        rotate_radps = (right_mps - left_mps) / wheels.track_m
        self._add_velocity(TrackSource.WHEELS, Velocity((left_mps + right_mps) / 2, rotate_radps))
