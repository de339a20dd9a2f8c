"""`RestTrack`: the last poses of the odometry, and the motion at rest that exceeds their noise."""

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import islice
from math import hypot, inf, sqrt
from typing import Final, NamedTuple

from executive.values.geometry import Point

TRACK_S: Final = 10.0
"""Age of the first stored pose."""
FIRST_RATIO: Final = 1 / 3
"""First part of a window. The newest pose is compared with its mean pose: true motion is detected
as early as by the length of the path, which noise lengthens."""
NOISE_SD: Final = 4.0
"""Standard deviations of a pose that are no motion. Recorded robots: sd of 0.06 to 0.12 mm and 0.2
to 0.35 mrad at rest; 10 mm and 5 mrad by satellites."""


class TrackedPose(NamedTuple):
    """A pose at a time; the heading is not wrapped."""

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float


class RestTrack:
    """The poses of the last seconds, by their stamps."""

    def __init__(self) -> None:
        self._poses: deque[TrackedPose] = deque()

    def observe(self, time_s: float, point: Point, heading_rad: float) -> None:
        """Add a pose that is newer than the last one."""
        if self._poses and time_s <= self._poses[-1].time_s:
            return
        self._poses.append(TrackedPose(time_s, point.x_m, point.y_m, heading_rad))
        while self._poses[0].time_s < time_s - TRACK_S:
            self._poses.popleft()

    def speed_mps(self, window_s: float, bound_mps: float) -> float | None:
        """Return the speed in the newest window, less its noise.

        None if it is unknown, or not above the bound.
        """
        reference = self._reference(window_s)
        if reference is None:
            return None
        last, from_s = self._poses[-1], reference.time_s
        distance_m = hypot(last.x_m - reference.x_m, last.y_m - reference.y_m)
        if distance_m / (last.time_s - from_s) <= bound_mps:
            return None
        poses = self._between(window_s, 0.0)
        variance = (_variance(poses, "x_m") + _variance(poses, "y_m")) / 2
        speed_mps = (distance_m - NOISE_SD * sqrt(variance)) / (last.time_s - from_s)
        return speed_mps if speed_mps > bound_mps else None

    def rate_radps(self, window_s: float, bound_radps: float) -> float | None:
        """Return the yaw rate in the newest window, likewise."""
        reference = self._reference(window_s)
        if reference is None:
            return None
        last, from_s = self._poses[-1], reference.time_s
        turned_rad = abs(last.heading_rad - reference.heading_rad)
        if turned_rad / (last.time_s - from_s) <= bound_radps:
            return None
        noise_rad = NOISE_SD * sqrt(_variance(self._between(window_s, 0.0), "heading_rad"))
        rate_radps = (turned_rad - noise_rad) / (last.time_s - from_s)
        return rate_radps if rate_radps > bound_radps else None

    def _reference(self, window_s: float) -> TrackedPose | None:
        """Return the mean of the first part of a window."""
        first = self._between(window_s, (1.0 - FIRST_RATIO) * window_s)
        if not first:
            return None
        return TrackedPose(*(_mean(figures) for figures in zip(*first, strict=True)))

    def _between(self, from_s: float, to_s: float) -> list[TrackedPose]:
        """Return the poses between two ages, by the newest."""
        if not self._poses:
            return []
        now_s, count = self._poses[-1].time_s, len(self._poses)
        begin = bisect_left(self._poses, (now_s - from_s,))
        end = bisect_right(self._poses, (now_s - to_s, inf))
        return list(islice(reversed(self._poses), count - end, count - begin))[::-1]


def _mean(figures: Sequence[float]) -> float:
    return sum(figures) / len(figures)


def _variance(poses: Sequence[TrackedPose], name: str) -> float:
    """Return the variance of one figure, by its distance from the line between its neighbours.

    Steady motion has none.
    """
    at = TrackedPose._fields.index(name)
    squares, weights = 0.0, 0.0
    for before, now, after in _triples(poses):
        part = (now.time_s - before.time_s) / (after.time_s - before.time_s)
        off = now[at] - before[at] - part * (after[at] - before[at])
        squares += off * off
        weights += 1.0 + part * part + (1.0 - part) ** 2
    return squares / weights if weights else 0.0


def _triples(
    poses: Sequence[TrackedPose],
) -> Iterable[tuple[TrackedPose, TrackedPose, TrackedPose]]:
    return zip(poses, poses[1:], poses[2:], strict=False)
