"""The last seconds of wheels, IMU and second odometry, as running sums on the core's time.

Data that are not finite or not newer are ignored. After a gap the sums restart: the motion during
it is unknown. The gyro's bias is learnt while the wheels are stationary, but not from a gyro that
then disagrees with them.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, hypot, inf, isfinite, sin
from typing import Final, NamedTuple

from executive.safety.channel import Channel
from executive.safety.stamp_period import BURST_S, MAX_GAP_S, MIN_GAP_S, Gaps, StampPeriod
from executive.settings import JointsSettings, SecondOdometrySettings, SlipSettings
from executive.state import FRAME_DISTANCE_M
from executive.values.facts import Imu, Joints, SecondOdometry
from executive.values.geometry import GRAVITY_MPS2, Pose, wrap_rad

GAP_S: Final = 0.3
"""Minimum interval between two messages that counts as a gap."""
FRESH_S: Final = 0.3
"""Maximum age of a message that describes the present."""
REST_RADPS: Final = 0.05
"""Maximum mean rate of stationary wheels over `REST_S`; single rates have noise of 0.03 rad/s."""
REST_S: Final = 0.3
"""Minimum standstill of the wheels before the gyro's bias is learnt."""
UNLEARNT_BIAS_RADPS: Final = 0.01
"""Maximum bias of the gyro before it is learnt."""
BIAS_AVERAGING_S: Final = 5.0
"""Averaging time of the gyro's bias."""
MAX_BIAS_RADPS: Final = 0.02
"""Maximum bias of a gyro that works."""
BIAS_TOLERANCE_RADPS: Final = 0.006
"""Deviation of the mean rate of a rest from the known bias, above which the gyro is wrong.

Six times the noise of that mean (sd 0.004 rad/s, 15 samples); over four seconds still below the
bound of `odometry_off_gyro.slow`.
"""
RELEARN_AFTER_S: Final = 30.0
"""Rest after which a changed bias is learnt; chosen, not measured."""
MAX_DELAYS: Final = 100
"""Number of late messages that are stored: more than in a window."""
HISTORY_S: Final = 10.0
"""History of second-odometry samples."""
MAX_WINDOW_FACTOR: Final = 2.5
"""Maximum ratio of a window to its nominal length, if frames are missing."""
WINDOW_TOLERANCE_S: Final = 0.1
"""Tolerance of a window's length: frames do not arrive to the millisecond."""


class WheelSums(NamedTuple):
    """Distances of the wheels of each side, and their torques over time.

    Attributes:
        left_m, right_m: mean distance of the wheels of a side.
        left_nms, right_nms: sum of the torques of a side.
    """

    left_m: float
    right_m: float
    left_nms: float = 0.0
    right_nms: float = 0.0

    @property
    def distance_m(self) -> float:
        """The distance of the rover's centre."""
        return (self.left_m + self.right_m) / 2


class WheelHistory:
    """The motion of the wheels, by their encoders.

    Attributes:
        sums: the channel of `WheelSums`.
        torques: whether torques are measured.
        count: number of wheels.
        travel_mps: the newest speed of the rover's centre.
    """

    def __init__(self, settings: JointsSettings) -> None:
        self.settings = settings
        self.sums = Channel(len(WheelSums._fields))
        self.torques = False
        self.count = 0
        self.travel_mps = 0.0
        self._rates = WheelSums(0.0, 0.0)
        self._period, self.gaps = StampPeriod(), Gaps()
        self._delays: deque[tuple[float, float]] = deque(maxlen=MAX_DELAYS)

    def fresh(self, now_s: float) -> bool:
        """Whether the newest message is recent."""
        return now_s - self.sums.time_s <= FRESH_S

    def delay_s(self, from_s: float) -> float:
        """Return how late the latest message since a time was; 0 without a late one.

        A base that measures late, or not for a while, has no processor, and obeys as late.
        """
        late = (late_s for time_s, late_s in self._delays if time_s >= from_s - BURST_S)
        return max(late, default=0.0)

    def observe(self, fact: Joints, time_s: float, late_s: float) -> None:
        """Add a message measured at a time, and how late it is."""
        speeds = (*fact.left_radps, *fact.right_radps)
        if not (fact.left_radps and fact.right_radps) or not _finite(
            *speeds, *fact.left_nm, *fact.right_nm
        ):
            return
        radius_m = self.settings.wheel_radius_m
        rates = WheelSums(
            radius_m * sum(fact.left_radps) / len(fact.left_radps),
            radius_m * sum(fact.right_radps) / len(fact.right_radps),
            sum(fact.left_nm),
            sum(fact.right_nm),
        )
        step_s = time_s - self.sums.time_s
        self._period.observe(step_s)
        fastest_mps = max(map(abs, (*self._rates[:2], *rates[:2])))
        gap_s = self._period.gap_s(step_s)
        self.gaps.observe(time_s, gap_s, fastest_mps, 0.0)
        late_s = min(max(late_s, gap_s), MAX_GAP_S)
        if late_s > MIN_GAP_S:
            self._delays.append((time_s, late_s))
        self.sums = extend_channel(self.sums, time_s, self._rates, rates)
        self._rates, self.count = rates, len(speeds)
        self.torques = bool(fact.left_nm and fact.right_nm)
        self.travel_mps = rates.distance_m


class InertialSums(NamedTuple):
    """Integrals of the inertial measurements.

    Attributes:
        turn_rad: change of the heading, the gyro's bias included.
        gained_mps: change of the speed ahead.
        force_mps: integral of the specific force ahead.
    """

    turn_rad: float
    gained_mps: float
    force_mps: float


class ImuHistory:
    """The inertial measurements.

    Args:
        slip: the side slip that the odometry contains.

    Attributes:
        sums: the channel of `InertialSums`.
        leans: whether it measures tilt; otherwise the rover is assumed level.
        feels: whether it measures accelerations.
        bias_radps: of the yaw rate, learnt while the wheels are stationary.
        bias_error_radps: its maximum error.
        lost: whether messages before the newest are missing.
    """

    def __init__(self, slip: SlipSettings) -> None:
        self._slip = slip
        self.lost = False
        self.sums = Channel(len(InertialSums._fields))
        self.newest: Imu | None = None
        self.leans = self.feels = True
        self.bias_radps = 0.0
        self.bias_error_radps = UNLEARNT_BIAS_RADPS
        self._learnt_s = self._odd_s = 0.0
        self._rates = InertialSums(0.0, 0.0, 0.0)
        self._period, self.gaps = StampPeriod(), Gaps()

    def fresh(self, now_s: float) -> bool:
        """Whether the newest message is recent."""
        return now_s - self.sums.time_s <= FRESH_S

    @property
    def rate_radps(self) -> float:
        """The newest yaw rate, the gyro's bias included."""
        return self._rates.turn_rad

    def observe(self, fact: Imu, time_s: float, travel_mps: float, resting: bool) -> None:
        """Add a message.

        Args:
            fact: the message.
            time_s: when it was measured.
            travel_mps: speed ahead by the wheels.
            resting: whether they are stationary.
        """
        if not _finite(fact.gyro_y_radps, fact.gyro_z_radps):
            return
        self.leans = _finite(fact.roll_rad, fact.pitch_rad)
        self.feels = isfinite(fact.acceleration_x_mps2)
        roll_rad, pitch_rad = (fact.roll_rad, fact.pitch_rad) if self.leans else (0.0, 0.0)
        rate_radps = (fact.gyro_y_radps * sin(roll_rad) + fact.gyro_z_radps * cos(roll_rad)) / max(
            cos(pitch_rad), 0.1
        )
        turning_radps = rate_radps - self.bias_radps
        ahead_mps2 = fact.acceleration_x_mps2 if self.feels else 0.0
        gain_mps2 = ahead_mps2 + GRAVITY_MPS2 * sin(pitch_rad)
        left_mps = -self._slip.side_slip_m(travel_mps, turning_radps) * turning_radps
        gain_mps2 += left_mps * turning_radps
        rates = InertialSums(rate_radps, gain_mps2, ahead_mps2)
        step_s = time_s - self.sums.time_s
        self._period.observe(step_s)
        fastest_radps = max(abs(self._rates.turn_rad), abs(rate_radps))
        gap_s = self._period.gap_s(step_s)
        self.lost = gap_s > 0.0
        self.gaps.observe(time_s, gap_s, 0.0, fastest_radps)
        self.sums = extend_channel(self.sums, time_s, self._rates, rates)
        self._rates, self.newest = rates, fact
        rest = self.sums.increase_between(time_s - REST_S, time_s) if resting else None
        if rest is not None:
            self._learn(rest[0] / REST_S, step_s)

    def _learn(self, rate_radps: float, step_s: float) -> None:
        """Learn from the mean rate of a rest, unless it disagrees with stationary wheels."""
        odd = self._learnt_s > 0.0 and abs(rate_radps - self.bias_radps) > BIAS_TOLERANCE_RADPS
        self._odd_s = self._odd_s + step_s if odd else 0.0
        if self._odd_s > RELEARN_AFTER_S:
            self._learnt_s, odd = 0.0, False
        if odd or abs(rate_radps) > MAX_BIAS_RADPS or step_s <= 0.0:
            return
        self._learnt_s = min(self._learnt_s + step_s, BIAS_AVERAGING_S)
        self.bias_radps += (rate_radps - self.bias_radps) * step_s / self._learnt_s
        self.bias_error_radps = 0.0


@dataclass(frozen=True, slots=True)
class SecondOdometrySample:
    """A pose by second odometry, and the odometry at the same time.

    Attributes:
        time_s: when it was measured.
        second_pose, odometry_pose: pose by second odometry and by odometry, each in its own frame.
        driven_m, turned_rad: distance and turn by odometry, without signs, since the start.
    """

    time_s: float
    second_pose: Pose
    odometry_pose: Pose
    driven_m: float
    turned_rad: float


@dataclass(frozen=True, slots=True)
class OdometryDisagreement:
    """The motion by two odometries between two samples.

    Attributes:
        from_s, to_s: times of the samples.
        seen_m, believed_m: straight distance between them by each.
        off_m, off_rad: difference of the two displacements, as vectors, and of the turns.
        seen_rad, believed_rad: turn by each.
        driven_m, turned_rad: distance and turn by odometry, without signs.
    """

    from_s: float
    to_s: float
    seen_m: float
    believed_m: float
    off_m: float
    seen_rad: float
    believed_rad: float
    off_rad: float
    driven_m: float
    turned_rad: float

    @property
    def span_s(self) -> float:
        """Time between the samples."""
        return self.to_s - self.from_s

    @property
    def is_standing(self) -> bool:
        """Whether both show standstill, within the noise of two frames."""
        return max(self.seen_m, self.driven_m) < FRAME_DISTANCE_M


class SecondOdometryTrack:
    """Poses by second odometry, with the odometry at the same times.

    Attributes:
        samples: the samples of the last seconds, in order.
        at_s: arrival of the newest message.
    """

    def __init__(self, settings: SecondOdometrySettings) -> None:
        self.settings = settings
        self.samples: deque[SecondOdometrySample] = deque()
        self.at_s = -inf

    def observe(
        self, fact: SecondOdometry, sighting: SecondOdometrySample | None, now_s: float
    ) -> None:
        """Add a message that arrived now; `sighting` is None if its time is unknown."""
        if not fact.pose.finite:
            return
        self.at_s = now_s
        if sighting is None or (self.samples and sighting.time_s <= self.samples[-1].time_s):
            return
        self.samples.append(sighting)
        while self.samples[0].time_s < sighting.time_s - HISTORY_S:
            self.samples.popleft()

    def disagreement(self, window_s: float, since_s: float) -> OdometryDisagreement | None:
        """Compare the last sample with the newest one that is a window older.

        Args:
            window_s: length of the window.
            since_s: earlier samples are ignored.

        Returns:
            None without such a sample, or if it is much older.
        """
        if not self.samples:
            return None
        last = self.samples[-1]
        for first in reversed(self.samples):
            span_s = last.time_s - first.time_s
            if first.time_s < since_s or span_s > MAX_WINDOW_FACTOR * window_s:
                return None
            if span_s > window_s - WINDOW_TOLERANCE_S:
                return motion_between(first, last)
        return None


def motion_between(first: SecondOdometrySample, last: SecondOdometrySample) -> OdometryDisagreement:
    """Return the motion by two odometries between two samples."""
    seen_x_m, seen_y_m = _step(first.second_pose, last.second_pose)
    x_m, y_m = _step(first.odometry_pose, last.odometry_pose)
    seen_rad = wrap_rad(last.second_pose.heading_rad - first.second_pose.heading_rad)
    believed_rad = wrap_rad(last.odometry_pose.heading_rad - first.odometry_pose.heading_rad)
    return OdometryDisagreement(
        first.time_s,
        last.time_s,
        hypot(seen_x_m, seen_y_m),
        hypot(x_m, y_m),
        hypot(seen_x_m - x_m, seen_y_m - y_m),
        seen_rad,
        believed_rad,
        abs(wrap_rad(seen_rad - believed_rad)),
        last.driven_m - first.driven_m,
        last.turned_rad - first.turned_rad,
    )


def _step(first: Pose, last: Pose) -> tuple[float, float]:
    """Return a displacement in the axes of base_link before it."""
    dx_m, dy_m = last.x_m - first.x_m, last.y_m - first.y_m
    cosine, sine = cos(first.heading_rad), sin(first.heading_rad)
    return dx_m * cosine + dy_m * sine, dy_m * cosine - dx_m * sine


def extend_channel(
    channel: Channel, time_s: float, before: Sequence[float], now: Sequence[float]
) -> Channel:
    """Return the channel with rates integrated up to a time; a new one after a gap."""
    step_s = time_s - channel.time_s
    if step_s > GAP_S:
        channel = Channel(len(now))
        channel.add(time_s, (0.0,) * len(now))
    elif step_s > 0.0:
        channel.add(
            time_s,
            [
                total + step_s * (old + new) / 2
                for total, old, new in zip(channel.sums, before, now, strict=True)
            ],
        )
    return channel


def _finite(*figures: float) -> bool:
    return all(map(isfinite, figures))
