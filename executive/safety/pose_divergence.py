"""`PoseDivergence`: how far the odometry's pose has diverged from other measures of the motion.

Those are its own twist, the wheels, the gyro and the commands. A sample from before a fault is the
reference for the uncertainty of the pose after it.
"""

from collections import deque
from collections.abc import Callable
from math import hypot, inf
from typing import Final, NamedTuple

from executive.safety.channel import Channel
from executive.safety.motion_history import MotionHistory, OdometryWindow
from executive.safety.odometry_monitors import COMMAND_LATENCY_S

LOOKBACK_S: Final = 5.0
"""Maximum time from a cause to its fault: above the maximum window (4 s)."""
SAMPLE_S: Final = 0.25


class Divergence(NamedTuple):
    """The accumulated divergence at one time.

    Attributes:
        ahead_m, left_m, heading_rad: from the odometry's own velocity.
        wheels_m, gyro_rad: from the wheels ahead, and from the gyro.
        commanded_m, commanded_rad: from the commands.
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
        """Return the maximum errors of position and heading since then, by the sources.

        Args:
            before: the divergence then.
            by_command: whether the commands are such a source.
        """
        grown = Divergence(*(abs(new - old) for new, old in zip(self, before, strict=True)))
        heading_rad = max(grown.heading_rad, grown.gyro_rad)
        position_m = max(hypot(grown.ahead_m, grown.left_m), grown.wheels_m)
        if by_command:
            heading_rad = max(heading_rad, grown.commanded_rad)
            position_m = max(position_m, grown.commanded_m)
        return position_m + heading_rad * grown.path_m, heading_rad


class _Comparison:
    """Divergence of the pose from another channel, over the times that both cover.

    Attributes:
        total: accumulated since the start, without gaps of the other channel.
    """

    def __init__(
        self, pose: str, other: Callable[[Channel, float], float], later_s: float = 0.0
    ) -> None:
        self.total = 0.0
        self._pose, self._other = OdometryWindow._fields.index(pose), other
        self._later_s, self._to_s = later_s, -inf
        self._channel: Channel | None = None
        self._beyond = 0.0

    def advance(self, moved: Channel, other: Channel, bias_per_s: float = 0.0) -> None:
        """Add the increase since the last call."""
        from_s, to_s = self._to_s, min(moved.time_s, other.time_s + self._later_s)
        if to_s <= from_s or not (moved.covers(to_s) and other.covers(to_s - self._later_s)):
            return
        beyond = moved.sum_at(to_s, self._pose) - self._other(other, to_s - self._later_s)
        if other is self._channel:  # a channel that begins again does so after a gap
            self.total += beyond - self._beyond + bias_per_s * (to_s - from_s)
        self._beyond, self._channel, self._to_s = beyond, other, to_s


class PoseDivergence:
    """Accumulates the divergence, and stores samples of the last seconds.

    Args:
        history: the commands and sensor data.

    Attributes:
        now: the divergence at the last update.
    """

    def __init__(self, history: MotionHistory) -> None:
        self._history = history
        self._wheels = _Comparison(
            "pose_ahead_m", lambda each, at_s: (each.sum_at(at_s, 0) + each.sum_at(at_s, 1)) / 2
        )
        self._gyro = _Comparison("pose_rad", lambda each, at_s: each.sum_at(at_s, 0))
        self._ahead = _Comparison(
            "pose_ahead_m", lambda each, at_s: each.sum_at(at_s, 0), COMMAND_LATENCY_S
        )
        self._turn = _Comparison(
            "pose_rad", lambda each, at_s: each.sum_at(at_s, 1), COMMAND_LATENCY_S
        )
        self._samples: deque[tuple[float, Divergence]] = deque()
        self.now = Divergence()

    @property
    def before(self) -> Divergence:
        """The divergence before the present cause may have begun to act."""
        return self._samples[0][1] if self._samples else self.now

    def update(self, path_m: float) -> None:
        """Add the increase since the last call.

        Args:
            path_m: length of the path of the pose since the start.
        """
        history, moved = self._history, self._history.moved
        if history.wheels is not None:
            self._wheels.advance(moved, history.wheels.sums)
        if history.inertia is not None:
            self._gyro.advance(moved, history.inertia.sums, history.inertia.bias_radps)
        self._ahead.advance(moved, history.commands)
        self._turn.advance(moved, history.commands)
        sums = OdometryWindow(*moved.sums)
        self.now = Divergence(
            sums.pose_minus_twist_ahead_m,
            sums.pose_minus_twist_left_m,
            sums.pose_minus_twist_heading_rad,
            self._wheels.total,
            self._gyro.total,
            self._ahead.total,
            self._turn.total,
            path_m,
        )

    def sample(self, now_s: float) -> None:
        """Store the divergence as a reference for later faults."""
        if self._samples and now_s < self._samples[-1][0] + SAMPLE_S:
            return
        self._samples.append((now_s, self.now))
        while len(self._samples) > 1 and self._samples[1][0] <= now_s - LOOKBACK_S:
            self._samples.popleft()

    def forget(self) -> None:
        """Discard all earlier samples."""
        self._samples.clear()
