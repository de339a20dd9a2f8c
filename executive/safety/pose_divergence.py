"""By how much the pose of the odometry goes elsewhere than other sources, summed up."""

from collections import deque
from collections.abc import Callable, Sequence
from math import hypot, inf
from typing import Final, NamedTuple

from executive.safety.channel import Channel
from executive.safety.history import MotionHistory, OdometryWindow
from executive.safety.odometry_monitors import REACTION_S

LOOKBACK_S: Final = 5.0
"""Before a fault, in which its cause may have acted: a little over the longest window (4 s)."""
SAMPLE_S: Final = 0.25


class Divergence(NamedTuple):
    """The sums at one time.

    Attributes:
        ahead_m, left_m, heading_rad: than the odometry's own velocity.
        wheels_m, gyro_rad: than the wheels ahead, and the gyro.
        commanded_m, commanded_rad: than what was commanded.
        path_m: length of the path of the pose itself.
    """

    ahead_m: float = 0.0
    left_m: float = 0.0
    heading_rad: float = 0.0
    wheels_m: float = 0.0
    gyro_rad: float = 0.0
    commanded_m: float = 0.0
    commanded_rad: float = 0.0
    path_m: float = 0.0

    def since(self, before: "Divergence", by_command: bool) -> tuple[float, float]:
        """Return the errors of position and heading that the sources show since, at most.

        Args:
            before: the sums then.
            by_command: whether what was commanded is such a source.
        """
        grown = Divergence(*(abs(new - old) for new, old in zip(self, before, strict=True)))
        heading_rad = max(grown.heading_rad, grown.gyro_rad)
        position_m = max(hypot(grown.ahead_m, grown.left_m), grown.wheels_m)
        if by_command:
            heading_rad = max(heading_rad, grown.commanded_rad)
            position_m = max(position_m, grown.commanded_m)
        return position_m + heading_rad * grown.path_m, heading_rad


class _Comparison:
    """What the pose shows beyond another channel, over the times that both cover.

    Attributes:
        total: summed up since the start, but for gaps of the other channel.
    """

    def __init__(
        self, pose: str, other: Callable[[Sequence[float]], float], later_s: float = 0.0
    ) -> None:
        self.total = 0.0
        self._pose, self._other = OdometryWindow._fields.index(pose), other
        self._later_s, self._to_s = later_s, -inf
        self._channel: Channel | None = None
        self._beyond = 0.0

    def advance(self, moved: Channel, other: Channel, bias_per_s: float = 0.0) -> None:
        """Add what is new."""
        from_s, to_s = self._to_s, min(moved.time_s, other.time_s + self._later_s)
        if to_s <= from_s or not (moved.covers(to_s) and other.covers(to_s - self._later_s)):
            return
        beyond = moved.at(to_s)[self._pose] - self._other(other.at(to_s - self._later_s))
        if other is self._channel:  # one that begins anew does so after a gap
            self.total += beyond - self._beyond + bias_per_s * (to_s - from_s)
        self._beyond, self._channel, self._to_s = beyond, other, to_s


class PoseDivergence:
    """Sums it up, and keeps the sums of the last seconds.

    Args:
        history: what was commanded and sensed.

    Attributes:
        now: the sums at the last update.
    """

    def __init__(self, history: MotionHistory) -> None:
        self._history = history
        self._wheels = _Comparison("pose_ahead_m", lambda sums: (sums[0] + sums[1]) / 2)
        self._gyro = _Comparison("pose_rad", lambda sums: sums[0])
        self._way = _Comparison("pose_ahead_m", lambda sums: sums[0], REACTION_S)
        self._turn = _Comparison("pose_rad", lambda sums: sums[1], REACTION_S)
        self._samples: deque[tuple[float, Divergence]] = deque()
        self.now = Divergence()

    @property
    def before(self) -> Divergence:
        """The sums from before what acts now began to act."""
        return self._samples[0][1] if self._samples else self.now

    def update(self, path_m: float) -> None:
        """Sum up what is new.

        Args:
            path_m: length of the path of the pose since the start.
        """
        history, moved = self._history, self._history.moved
        if history.wheels is not None:
            self._wheels.advance(moved, history.wheels.sums)
        if history.inertia is not None:
            self._gyro.advance(moved, history.inertia.sums, history.inertia.bias_radps)
        self._way.advance(moved, history.commands)
        self._turn.advance(moved, history.commands)
        sums = OdometryWindow(*moved.sums)
        self.now = Divergence(
            sums.ahead_m,
            sums.left_m,
            sums.heading_rad,
            self._wheels.total,
            self._gyro.total,
            self._way.total,
            self._turn.total,
            path_m,
        )

    def sample(self, now_s: float) -> None:
        """Keep the sums as those from before what comes."""
        if self._samples and now_s < self._samples[-1][0] + SAMPLE_S:
            return
        self._samples.append((now_s, self.now))
        while len(self._samples) > 1 and self._samples[1][0] <= now_s - LOOKBACK_S:
            self._samples.popleft()

    def forget(self) -> None:
        """Let nothing from before count any more."""
        self._samples.clear()
