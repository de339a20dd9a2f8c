"""`check_battery`: refuses a motion or plan if the battery lacks energy for it and the return.

The energy of a motion is estimated from its turns and lines, each from rest to rest, which takes
negligible time; a preview would delay the command too long. Without battery figures in the
settings, or without a charge in the battery state, nothing is refused.
"""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final, assert_never

from executive.checks.path_check import detoured_segments
from executive.commands import (
    Arc,
    Curve,
    Line,
    Motion,
    MoveForward,
    MoveTo,
    Rest,
    SetRotateSpeed,
    SetTravelSpeed,
    Turn,
    Waypoint,
)
from executive.commands.intake import localized
from executive.motion import Bounds, duration_s
from executive.obstacles.detour import Scene
from executive.obstacles.zones import Zones
from executive.plans import PlanNode, PlanStep, nominal_steps
from executive.settings import MotionExtent, Settings, curved_m
from executive.state import Status
from executive.values.geometry import Pose
from executive.values.reasons import Figure, Reason, Refusal

RETURN_PATH_FACTOR: Final = 1.5
"""Ratio of the permitted energy of a return motion to the direct path home; chosen."""


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """The maximum speeds that are set."""

    travel_mps: float
    rotate_radps: float


class _EnergyEstimator:
    """Sums the energy of motions from a start pose, by the settings' figures."""

    def __init__(self, pose: Pose, speeds: SpeedLimits, settings: Settings, scene: Scene) -> None:
        self.pose = pose
        self.speeds = speeds
        self.energy_j = 0.0
        self._settings = settings
        self._scene = scene

    def add(self, request: Motion) -> None:
        """Add a motion."""
        limits, speeds = self._settings.drive, self.speeds
        travel = Bounds(speeds.travel_mps, limits.travel_acceleration_mps2)
        rotate = Bounds(speeds.rotate_radps, limits.rotate_acceleration_radps2)
        for segment in detoured_segments(request, self.pose, self._settings, *self._scene):
            match segment:
                case Turn(by_rad=by_rad):
                    took_s = duration_s(by_rad, rotate)
                case Line(by_m=by_m) | Curve(by_m=by_m):
                    took_s = duration_s(by_m, travel)
                case Arc(duration_s=took_s) | Rest(duration_s=took_s):
                    pass
                case _:
                    assert_never(segment)
            length_m, turned_rad = abs(segment.by_m), abs(segment.by_rad)
            extent = MotionExtent(took_s, length_m, turned_rad, curved_m(length_m, turned_rad))
            self.energy_j += self._settings.prediction.energy_j(extent) or 0.0
            self.pose = segment.end


def estimate_energy_j(
    request: Motion, pose: Pose, speeds: SpeedLimits, settings: Settings, scene: Scene
) -> float:
    """Return the energy of a motion from a pose in joules; 0 without figures in the settings."""
    estimator = _EnergyEstimator(pose, speeds, settings, scene)
    estimator.add(request)
    return estimator.energy_j


def check_battery(
    what: Motion | PlanNode,
    pose: Pose,
    status: Status,
    settings: Settings,
    scene: Scene,
    longer_m: float = 0.0,
    done: Collection[int] = (),
) -> Refusal | None:
    """Return a refusal if the battery lacks energy for a motion or plan and the return, or None.

    A motion that ends no farther from home than it begins is a return. It is not refused if, with
    the rest of the return, it needs at most 1.5 times the energy of the direct path home. A plan
    is estimated without detours.

    Args:
        what: the motion or plan.
        pose: start pose.
        status: provides the charge and the speed limits.
        settings: provide the energy figures and the battery's reserve.
        scene: the obstacles, and the detours around them.
        longer_m: by how much the planner's path of a navigated motion exceeds the straight lines.
        done: numbers of the steps of a plan that have ended.
    """
    battery, last_battery = settings.battery, status.battery
    if battery is None or last_battery is None or last_battery.charge_ratio is None:
        return None
    left_j = battery.available_j(last_battery.charge_ratio)
    speeds = SpeedLimits(status.travel_limit_mps, status.rotate_limit_radps)
    if isinstance(what, Motion):
        requests: Iterable[object] = (what,)
    else:
        course, scene = nominal_steps(what), (Zones(), None)
        left = (each for each in course if isinstance(each, PlanStep))
        requests = (each.request for each in left if each.location.number not in done)
    estimator = _EnergyEstimator(pose, speeds, settings, scene)
    for each in _motions(requests, estimator):
        request = localized(each, status, settings)
        if isinstance(request, Refusal):
            return request
        estimator.add(request)
        if estimator.energy_j > battery.capacity_j:
            break
    estimator.energy_j += _drive_j(longer_m, speeds, settings)
    home, end = battery.home, estimator.pose.point
    to_home = MoveTo(Waypoint(home.x_m, home.y_m))
    back_j = estimate_energy_j(to_home, estimator.pose, speeds, settings, scene)
    if status.uncertainty:  # home may be farther away by that much
        farther_m = status.uncertainty.position_at_m(end.distance_m(home))
        back_j += _drive_j(farther_m, speeds, settings)
    needed_j = estimator.energy_j + back_j
    if estimator.energy_j == 0.0 or needed_j <= left_j:
        return None
    nearer = end.distance_m(home) <= pose.point.distance_m(home)
    if nearer:
        direct_j = estimate_energy_j(to_home, pose, speeds, settings, scene)
        if needed_j <= RETURN_PATH_FACTOR * direct_j:
            return None
    reserve_j = battery.reserve_ratio * battery.capacity_j
    return Refusal(
        Reason.BATTERY_INSUFFICIENT,
        f"battery too low: motion {estimator.energy_j:.0f} J + return {back_j:.0f} J, available"
        f" {left_j:.0f} J above the {battery.reserve_ratio:.0%} reserve",
        (
            Figure("needed", needed_j, "J"),
            Figure("way back", back_j, "J"),
            Figure("left", left_j, "J"),
            Figure("reserve", reserve_j, "J"),
        ),
    )


def _drive_j(distance_m: float, speeds: SpeedLimits, settings: Settings) -> float:
    """Return the energy of a straight drive in joules."""
    scene = Zones(), None
    return estimate_energy_j(MoveForward(distance_m), Pose(), speeds, settings, scene)


def _motions(requests: Iterable[object], estimator: _EnergyEstimator) -> Iterator[Motion]:
    """Yield the motions among requests, and apply the speeds that requests between them set."""
    for request in requests:
        match request:
            case SetTravelSpeed(speed_mps):
                estimator.speeds = replace(estimator.speeds, travel_mps=speed_mps)
            case SetRotateSpeed(speed_radps):
                estimator.speeds = replace(estimator.speeds, rotate_radps=speed_radps)
            case _ if isinstance(request, Motion):
                yield request
            case _:
                pass
