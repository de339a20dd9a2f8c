"""`PoseFusion`: the pose from wheel odometry and, if configured, a second odometry.

Each frame of the second odometry is paired with the pose at its stamp; pairs verify the end of a
motion. If fused, its steps correct the position. The heading is not corrected: a gyro is better.

The gain is that of a one-dimensional Kalman filter. The standard deviation of the wheels is
`WHEELS_PER_M` on level ground and grows with the slope, above all in turns; that of the second
odometry is `FRAME_M` and `FRAME_PER_M`. So differences within these are hardly corrected on level
ground, and almost fully on slopes. The rest is carried over: a slow slide adds up.

The downhill slide of turns is learnt: metres per radian turned and sine of the slope. The figures
below are chosen, not measured.
"""

from collections import deque
from dataclasses import dataclass, replace
from math import cos, hypot, sin
from typing import Final

from executive.values.facts import Odometry, SecondOdometry
from executive.values.geometry import Point, Pose, wrap_rad

FRAME_BUFFER_S: Final = 3.0
MAX_BUFFERED_POSES: Final = 1024
"""Bounds of the pose buffer; older frames are left out."""
MAX_FRAME_LEAD_S: Final = 0.1
"""Maximum lead of a frame over the odometry; frames with more are left out."""
FRAME_M: Final = 0.01
FRAME_PER_M: Final = 0.015
WHEELS_PER_M: Final = 0.002
WHEELS_PER_RAD: Final = 0.002
SLIDE_M_PER_RAD: Final = 0.5
"""Standard deviation of the wheels by a slide per sine of the slope, in turns; likewise below."""
SLIDE_PER_M: Final = 0.3
SLIDE_MPS: Final = 0.05
GATE_SD: Final = 2.5
"""Gate in standard deviations of the second odometry, beyond which the wheels must be wrong."""
STEP_M: Final = 0.02
"""Maximum correction per odometry message."""
PRIOR_WEIGHT: Final = 0.05
"""Weight of the prior of no slide, in radians times sine of the slope."""
FORGETTING_FACTOR: Final = 0.9
"""Forgetting factor of the learnt slide, per frame with a turn on a slope."""
MIN_TURN_RAD: Final = 0.15
MIN_SLOPE: Final = 0.05


@dataclass(frozen=True, slots=True)
class FramePair:
    """A frame of the second odometry and the pose at its stamp.

    Attributes:
        travelled_m: distance driven since the start.
        pose, second: in the frames of both odometries.
        position_sd_m, heading_sd_rad: of the second; 0 if it reports none.
    """

    stamp_s: float
    travelled_m: float
    pose: Pose
    second: Pose
    position_sd_m: float
    heading_sd_rad: float


@dataclass(frozen=True, slots=True)
class PoseDisagreement:
    """Difference of two odometries over a distance."""

    off_m: float
    off_rad: float
    distance_m: float


def disagreement(first: FramePair, last: FramePair) -> PoseDisagreement:
    """Return the difference of two odometries over the motion between two pairs."""
    own, other = _seen_from(first.pose, last.pose), _seen_from(first.second, last.second)
    turned_rad = wrap_rad(last.pose.heading_rad - first.pose.heading_rad)
    other_rad = wrap_rad(last.second.heading_rad - first.second.heading_rad)
    return PoseDisagreement(
        own.distance_m(other),
        abs(wrap_rad(turned_rad - other_rad)),
        last.travelled_m - first.travelled_m,
    )


@dataclass(frozen=True, slots=True)
class _OdometrySample:
    """Dead-reckoned pose at one stamp, with distance, turn and slide accumulated up to it."""

    stamp_s: float
    pose: Pose
    distance_m: float
    turn_rad: float
    slide: float
    downhill_x: float
    downhill_y: float


class PoseFusion:
    """Fuses both odometries into the pose.

    Attributes:
        fused: whether the second odometry corrects the pose.
        latest: the newest frame with a pose at its stamp.
        unconfirmed_since: the frame before a motion that the second odometry did not confirm;
            until that has increased the uncertainty of the pose.
    """

    def __init__(self, fused: bool) -> None:
        self.fused = fused
        self._samples: deque[_OdometrySample] = deque(maxlen=MAX_BUFFERED_POSES)
        self._raw: Odometry | None = None
        self.latest: FramePair | None = None
        self.unconfirmed_since: FramePair | None = None
        self._before: _OdometrySample | None = None
        self._left = Point(0.0, 0.0)
        self._left_sd_m = 0.0
        self._wheels_m2 = 0.0
        self._target = self._applied = Point(0.0, 0.0)
        self._turns2 = self._slid = 0.0

    @property
    def pose(self) -> Pose:
        """The pose; at the origin before the first odometry."""
        return self._corrected(self._samples[-1].pose) if self._samples else Pose()

    @property
    def correction_applied(self) -> bool:
        """Whether the correction is fully applied."""
        return self._applied == self._target

    @property
    def correction(self) -> Point:
        """The correction of the position by the frames."""
        return self._target

    def restore(self, correction: Point) -> None:
        """Restore the correction of the previous process."""
        self._target = self._applied = correction

    @property
    def slide_m_per_rad(self) -> float:
        """Downhill slide of a turn, per radian and sine of the slope."""
        return self._slid / (self._turns2 + PRIOR_WEIGHT**2)

    def turn_slide(self, turn_rad: float) -> Point:
        """Return the expected slide of a turn on the spot here, in the plane."""
        if not self._samples:
            return Point(0.0, 0.0)
        x, y = _downhill(self._samples[-1].pose)
        slid = self.slide_m_per_rad * abs(turn_rad)
        return Point(slid * x, slid * y)

    def add_odometry(self, fact: Odometry) -> None:
        """Add a sample of the wheel odometry."""
        before, self._raw = self._raw, fact
        if self._samples and fact.stamp_s < self._samples[-1].stamp_s:
            self._samples.clear()
            self._before = None
        if before is None or not self._samples:
            self._samples.append(_OdometrySample(fact.stamp_s, fact.pose, 0.0, 0.0, 0.0, 0.0, 0.0))
            return
        last = self._samples[-1]
        step = Point(fact.pose.x_m - before.pose.x_m, fact.pose.y_m - before.pose.y_m)
        turn_rad = abs(wrap_rad(fact.pose.heading_rad - before.pose.heading_rad))
        x, y = _downhill(fact.pose)
        slid = self.slide_m_per_rad * turn_rad
        pose = fact.pose
        if self.fused:
            x_m, y_m = last.pose.x_m + step.x_m, last.pose.y_m + step.y_m
            pose = replace(pose, x_m=x_m + slid * x, y_m=y_m + slid * y)
        slope, distance_m = hypot(x, y), hypot(step.x_m, step.y_m)
        since_s = max(0.0, fact.stamp_s - last.stamp_s)
        self._samples.append(
            _OdometrySample(
                fact.stamp_s,
                pose,
                last.distance_m + distance_m,
                last.turn_rad + turn_rad,
                last.slide
                + slope
                * (SLIDE_M_PER_RAD * turn_rad + SLIDE_PER_M * distance_m + SLIDE_MPS * since_s),
                last.downhill_x + turn_rad * x,
                last.downhill_y + turn_rad * y,
            )
        )
        while self._samples[0].stamp_s < fact.stamp_s - FRAME_BUFFER_S:
            self._samples.popleft()
        self._approach()

    def add_second_odometry(self, fact: SecondOdometry) -> None:
        """Add a frame, stamped by the odometry's clock; frames that are too old are ignored."""
        newest = self.latest
        if not fact.pose.finite:
            return
        if newest is not None and fact.stamp_s <= newest.stamp_s:
            return
        here = self._at(fact.stamp_s)
        if here is None:
            return
        if self.fused and newest is not None and self._before is not None:
            self._correct(self._before, here, newest.second, fact.pose)
        self._before = here
        point = Point(here.pose.x_m + self._target.x_m, here.pose.y_m + self._target.y_m)
        self.latest = FramePair(
            fact.stamp_s,
            here.distance_m,
            replace(here.pose, x_m=point.x_m, y_m=point.y_m),
            fact.pose,
            fact.position_sd_m,
            fact.heading_sd_rad,
        )

    def _correct(
        self, before: _OdometrySample, here: _OdometrySample, second: Pose, second_now: Pose
    ) -> None:
        step = _seen_from(second, second_now)
        heading_rad = before.pose.heading_rad
        cosine, sine = cos(heading_rad), sin(heading_rad)
        apart_x = step.x_m * cosine - step.y_m * sine - (here.pose.x_m - before.pose.x_m)
        apart_y = step.x_m * sine + step.y_m * cosine - (here.pose.y_m - before.pose.y_m)
        self._learn(before, here, apart_x, apart_y)
        distance_m, turn_rad = here.distance_m - before.distance_m, here.turn_rad - before.turn_rad
        left_x, left_y = self._left.x_m + apart_x, self._left.y_m + apart_y
        self._left_sd_m += FRAME_PER_M * distance_m
        self._wheels_m2 += (
            WHEELS_PER_M * distance_m + WHEELS_PER_RAD * turn_rad + here.slide - before.slide
        ) ** 2
        sd_m = FRAME_M + self._left_sd_m
        beyond_m = max(0.0, hypot(left_x, left_y) - GATE_SD * sd_m)
        wheels_m2 = self._wheels_m2 + beyond_m**2
        gain = wheels_m2 / (wheels_m2 + sd_m**2)
        self._target = Point(self._target.x_m + gain * left_x, self._target.y_m + gain * left_y)
        self._left = Point((1 - gain) * left_x, (1 - gain) * left_y)
        self._left_sd_m *= 1 - gain
        self._wheels_m2 *= 1 - gain

    def _learn(
        self, before: _OdometrySample, here: _OdometrySample, apart_x: float, apart_y: float
    ) -> None:
        """Learn the slide of turns from one step with a turn on a slope."""
        turn_rad = here.turn_rad - before.turn_rad
        x, y = here.downhill_x - before.downhill_x, here.downhill_y - before.downhill_y
        turned = hypot(x, y)
        if turn_rad < MIN_TURN_RAD or turned < MIN_SLOPE * turn_rad:
            return
        downhill_m = (apart_x * x + apart_y * y) / turned + self.slide_m_per_rad * turned
        self._turns2 = FORGETTING_FACTOR * self._turns2 + turned**2
        self._slid = FORGETTING_FACTOR * self._slid + turned * downhill_m

    def _at(self, stamp_s: float) -> _OdometrySample | None:
        """Return the dead-reckoned sample at a stamp; None if it is outside of the buffer."""
        samples = self._samples
        if (
            not samples
            or not samples[0].stamp_s <= stamp_s <= samples[-1].stamp_s + MAX_FRAME_LEAD_S
        ):
            return None
        after = samples[-1]
        for sample in reversed(samples):
            if sample.stamp_s <= stamp_s:
                return _between(sample, after, stamp_s)
            after = sample
        return None

    def _approach(self) -> None:
        x, y = self._target.x_m - self._applied.x_m, self._target.y_m - self._applied.y_m
        left_m = hypot(x, y)
        if left_m <= STEP_M:
            self._applied = self._target
        else:
            part = STEP_M / left_m
            self._applied = Point(self._applied.x_m + part * x, self._applied.y_m + part * y)

    def _corrected(self, pose: Pose) -> Pose:
        return replace(pose, x_m=pose.x_m + self._applied.x_m, y_m=pose.y_m + self._applied.y_m)


def _seen_from(pose: Pose, other: Pose) -> Point:
    x_m, y_m = other.x_m - pose.x_m, other.y_m - pose.y_m
    cosine, sine = cos(pose.heading_rad), sin(pose.heading_rad)
    return Point(x_m * cosine + y_m * sine, y_m * cosine - x_m * sine)


def _downhill(pose: Pose) -> tuple[float, float]:
    """Return the downhill direction in the plane; its length is the sine of the slope."""
    ahead, left = sin(pose.pitch_rad), -sin(pose.roll_rad)
    cosine, sine = cos(pose.heading_rad), sin(pose.heading_rad)
    return ahead * cosine - left * sine, ahead * sine + left * cosine


def _between(one: _OdometrySample, other: _OdometrySample, stamp_s: float) -> _OdometrySample:
    span_s = other.stamp_s - one.stamp_s
    part = (stamp_s - one.stamp_s) / span_s if span_s > 0.0 else 0.0
    part = min(part, 1.0)

    def mix(old: float, new: float) -> float:
        return old + part * (new - old)

    heading_rad = one.pose.heading_rad
    turned_rad = wrap_rad(other.pose.heading_rad - heading_rad)
    pose = replace(
        one.pose,
        x_m=mix(one.pose.x_m, other.pose.x_m),
        y_m=mix(one.pose.y_m, other.pose.y_m),
        heading_rad=wrap_rad(heading_rad + part * turned_rad),
    )
    return _OdometrySample(
        stamp_s,
        pose,
        mix(one.distance_m, other.distance_m),
        mix(one.turn_rad, other.turn_rad),
        mix(one.slide, other.slide),
        mix(one.downhill_x, other.downhill_x),
        mix(one.downhill_y, other.downhill_y),
    )
