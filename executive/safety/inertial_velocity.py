"""`InertialVelocity` over ground, by the IMU: detects sliding with stationary wheels.

Accelerations along the ground, without gravity, are integrated. While the wheels agree, the
integral is drawn to their velocity against drift; otherwise it runs freely. Without it 43 of 120
stops and ends of motion on friction 0.05 to 0.2 ended EXECUTED at up to 1.2 m/s: odometry, joints
and gyro show standstill while locked wheels slide.
"""

from collections import deque
from math import cos, hypot, inf, isfinite, sin
from typing import Final

from executive.safety.channel import Channel
from executive.safety.sensor_history import BIAS_AVERAGING_S, FRESH_S, extend_channel
from executive.settings import SlipSettings
from executive.state import SourceMotion, is_slow
from executive.values.facts import Imu
from executive.values.geometry import GRAVITY_MPS2, Velocity
from executive.values.reasons import Figure

DRAWN_OVER_S: Final = 0.3
"""Time constant of the correction to the wheels: slip of less than 0.2 m/s2 is not detected."""
AGREE_MPS: Final = 0.06
"""Maximum difference of velocities that agree: three times the noise of a stop from 1 m/s."""
STATIONARY_MPS: Final = 0.03
"""Maximum speed at standstill, and maximum difference after a slide longer than `LONG_S`."""
LONG_S: Final = 0.5
"""Duration above that of wheel disagreement in a stop; enough to learn the bias, or to rest."""
SLIDES_IN_TURN_M: Final = 0.12
"""Slide of a turn on a slope that odometry does not see, per rad/s."""
SPARSE_S: Final = 0.03
"""Step between measurements above which the acceleration between them is uncertain: IMUs of 20 Hz,
and lost messages."""
DRIFT_MPS2: Final = 0.02
"""Drift of the free integral, which widens the bound; at rest after `DRIFTS_AFTER_S`."""
DRIFTS_AFTER_S: Final = 5.0
FELT_OVER_S: Final = 0.2
"""Window of the mean acceleration that shows whether friction still brakes the rover."""
AGREED_S: Final = 1.0
"""Agreement after which half of that window suffices: all speed lost by the wheels was measured."""
STILL_MPS2: Final = 0.06
"""Maximum mean acceleration at rest. Friction of 0.05 brakes by 0.49 m/s2 on level ground."""
UNLEARNT_MPS2: Final = 0.3
"""The same, and the maximum bias: four standard deviations of a bias not learnt yet."""
RELEARN_S: Final = 10.0
"""Rest after which a bias that changed by more than that is learnt again."""
MAX_WAITING: Final = 50
"""Number of wheel velocities that wait for inertial measurements: one second of 50 Hz."""
TRUST_S: Final = 1.0
"""Minimum time between two gaps after which moving wheels are trusted: gaps that repeat, or stamps
in bursts, would hide all slip."""
LEVEL_RAD: Final = 0.03
"""Maximum slope where friction of 0.05 brakes a sliding rover by three times `STILL_MPS2`."""


class InertialVelocity:
    """Integrates accelerations, and compares the result with the wheels.

    Args:
        slip: the side slip that the odometry contains.

    Attributes:
        apart_s: how long the wheels have disagreed; 0 while they agree.
        from_mps: the speed when they last agreed.
        slid_m: distance slid since the start, beyond that of the wheels.
    """

    def __init__(self, slip: SlipSettings) -> None:
        self._slip = slip
        self._sums = Channel(3)
        self._rates = (0.0, 0.0, 0.0)
        self._offset = self._bias = (0.0, 0.0)
        self._learnt_s = self._turning_mps = self._sparse_mps = 0.0
        self._level = self._rests = self._unfelt = False
        self._waiting: deque[tuple[float, Velocity]] = deque(maxlen=MAX_WAITING)
        self._compared_s = self._rolled_s = self._apart_at_s = self._gap_s = -inf
        self.apart_s = self.from_mps = self.slid_m = 0.0

    def feel(self, fact: Imu, time_s: float, resting: bool, *, lost: bool = False) -> None:
        """Add a message measured at a time.

        Args:
            fact: the message.
            time_s: that time.
            resting: whether zero velocity has been commanded for `REST_S`.
            lost: whether messages before it are missing.
        """
        pitch_rad, roll_rad = fact.pitch_rad, fact.roll_rad
        ahead_mps2 = fact.acceleration_x_mps2 + GRAVITY_MPS2 * sin(pitch_rad)
        left_mps2 = fact.acceleration_y_mps2 - GRAVITY_MPS2 * cos(pitch_rad) * sin(roll_rad)
        if not isfinite(ahead_mps2 + left_mps2 + fact.gyro_z_radps):
            return
        self._level = max(abs(pitch_rad), abs(roll_rad)) <= LEVEL_RAD
        step_s = min(time_s - self._sums.time_s, FRESH_S)
        if resting and self._rests and step_s > 0.0:
            self._learn(ahead_mps2, left_mps2, step_s)
        ahead_mps2, left_mps2 = ahead_mps2 - self._bias[0], left_mps2 - self._bias[1]
        before, heading_rad, velocity = self._sums, self._sums.sums[0], self._velocity
        rates = (fact.gyro_z_radps, *_turned(ahead_mps2, left_mps2, heading_rad))
        self._sums = extend_channel(before, time_s, self._rates, rates)
        if step_s > SPARSE_S:  # its maximum error, if the acceleration is monotone in between
            change_mps2 = hypot(rates[1] - self._rates[1], rates[2] - self._rates[2])
            self._sparse_mps += step_s / 2 * change_mps2
        self._rates = rates
        if self._sums is not before:  # a gap: the velocity is assumed to be unchanged
            self._offset = _turned(*velocity, -heading_rad)
        if lost or self._sums is not before:  # velocities in the gap have no counterpart
            trusts = self._sums is not before or time_s - self._gap_s > TRUST_S
            self._unfelt = not self.apart_s and (trusts or self._unfelt)
            self._gap_s = time_s if trusts else self._gap_s
            self._waiting.clear()
        self._compare_waiting()

    def roll(self, velocity: Velocity, time_s: float) -> None:
        """Compare with the velocity of the wheels at a time, once it has been measured.

        The two arrive independently of each other: a wheel velocity that is compared with an
        inertial measurement of 0.1 s before differs by the acceleration of that time.
        """
        self._waiting.append((time_s, velocity))
        self._compare_waiting()

    def _compare_waiting(self) -> None:
        while self._waiting and self._waiting[0][0] <= self._sums.time_s:
            time_s, velocity = self._waiting.popleft()
            self._compare(velocity, time_s)

    def _compare(self, velocity: Velocity, time_s: float) -> None:
        if time_s <= self._compared_s or not self._sums.covers(time_s):
            return
        # After a gap moving wheels are trusted; stationary ones may have locked during it.
        first = self._compared_s == -inf or (self._unfelt and not is_slow(velocity))
        step_s, self._compared_s = min(time_s - self._compared_s, FRESH_S), time_s
        heading_rad, x_mps, y_mps = self._sums.sums_at(time_s)
        ahead_mps, rotate_radps = velocity.travel_mps, velocity.rotate_radps
        left_mps = -self._slip.side_slip_m(ahead_mps, rotate_radps) * rotate_radps
        x, y = _turned(ahead_mps, left_mps, heading_rad)
        off_x, off_y = x - x_mps - self._offset[0], y - y_mps - self._offset[1]
        if first or not is_slow(velocity):
            self._rolled_s = time_s
        drawn = 1.0 if first else min(1.0, step_s / DRAWN_OVER_S)
        turning_mps = SLIDES_IN_TURN_M * abs(rotate_radps)
        self._turning_mps = max(turning_mps, (1.0 - drawn) * self._turning_mps)
        self._sparse_mps *= 1.0 - drawn
        rolls, long = self._rolled_s == time_s, time_s - self._rolled_s > RELEARN_S
        still_mps2 = UNLEARNT_MPS2 if long else self._still_mps2
        self._rests = not rolls and self._acceleration_mps2(FELT_OVER_S / 2) <= still_mps2
        if first or hypot(off_x, off_y) <= self._bound_mps:
            self.apart_s, self._unfelt = 0.0, False
            if first or rolls or self._rests:
                self._offset = self._offset[0] + drawn * off_x, self._offset[1] + drawn * off_y
            self.from_mps = hypot(*self._velocity)
            return
        brakes = self._acceleration_mps2(FELT_OVER_S / 2) > self._still_mps2
        if not self._unfelt or (brakes and time_s - self._gap_s >= FELT_OVER_S / 2):
            self.slid_m += step_s * hypot(off_x, off_y)
        self._rests = False
        self.apart_s, self._apart_at_s = self.apart_s + step_s, time_s
        if self._level and time_s - self._rolled_s >= LONG_S:
            self.reset_at_rest(time_s)

    def reset_at_rest(self, time_s: float) -> None:
        """Accept standstill by another source at a time, if friction no longer brakes the rover."""
        if self._sums.covers(time_s) and self._acceleration_mps2(LONG_S) <= self._still_mps2:
            _, x_mps, y_mps = self._sums.sums_at(time_s)
            self._offset, self.apart_s = (-x_mps, -y_mps), 0.0

    def motion(self, now_s: float) -> SourceMotion | None:
        """Return the motion of the rover; None without recent measurements."""
        if now_s - self._sums.time_s > FRESH_S:
            return None
        speed_mps = hypot(*self._velocity)
        if self._compared_s - self._apart_at_s > AGREED_S:
            still = self._acceleration_mps2(FELT_OVER_S / 2) <= UNLEARNT_MPS2
        else:
            still = self._acceleration_mps2(FELT_OVER_S) <= self._still_mps2
        is_standing = still and not self.apart_s and speed_mps < STATIONARY_MPS
        return SourceMotion(
            "accelerometer", is_standing, (Figure("accelerometer", speed_mps, "m/s"),)
        )

    @property
    def lost_speeds(self) -> tuple[Figure, Figure]:
        """The speeds that the wheels and the rover lost since they last agreed."""
        felt_mps = self.from_mps - hypot(*self._velocity)
        return (
            Figure("lost by the wheels", self.from_mps, "m/s"),
            Figure("felt by the accelerometer", felt_mps, "m/s"),
        )

    @property
    def _velocity(self) -> tuple[float, float]:
        _, x_mps, y_mps = self._sums.sums
        return self._offset[0] + x_mps, self._offset[1] + y_mps

    @property
    def _still_mps2(self) -> float:
        return STILL_MPS2 if self._learnt_s >= LONG_S else UNLEARNT_MPS2

    def _acceleration_mps2(self, over_s: float) -> float:
        gained = self._sums.increase_between(self._sums.time_s - over_s, self._sums.time_s)
        return inf if gained is None else hypot(gained[1], gained[2]) / over_s

    @property
    def _bound_mps(self) -> float:
        rolls = self._rolled_s == self._compared_s
        drifts_s = self.apart_s if rolls else max(0.0, self.apart_s - DRIFTS_AFTER_S)
        agree_mps = AGREE_MPS if rolls or self.apart_s <= LONG_S else STATIONARY_MPS
        return agree_mps + self._turning_mps + self._sparse_mps + DRIFT_MPS2 * drifts_s

    def _learn(self, ahead_mps2: float, left_mps2: float, step_s: float) -> None:
        self._learnt_s = min(self._learnt_s + step_s, BIAS_AVERAGING_S)
        part, (ahead, left) = step_s / self._learnt_s, self._bias
        self._bias = ahead + part * (ahead_mps2 - ahead), left + part * (left_mps2 - left)


def _turned(x: float, y: float, by_rad: float) -> tuple[float, float]:
    cosine, sine = cos(by_rad), sin(by_rad)
    return x * cosine - y * sine, x * sine + y * cosine
