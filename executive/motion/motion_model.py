"""`MotionModel` of a rover, numeric or symbolic; `MotionObserver` estimates its present state."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, exp, inf, sin, sqrt, tanh
from types import SimpleNamespace
from typing import Any, Final

from executive.motion.velocity_control import VelocityDriver
from executive.settings import Settings, SlipSettings, YawResponse
from executive.state import Status
from executive.values.facts import Odometry
from executive.values.geometry import Point, Pose, Velocity, wrap_rad

_GAUSS: Final = (0.5 - sqrt(3.0) / 6, 0.5 + sqrt(3.0) / 6)
"""Integration points of a step: two Gauss points give fourth order."""
_SMOOTH: Final = 1e-6
_SLIP_FROM: Final = 0.02
"""Squares of speeds, below which magnitudes and the root of the side slip are smoothed."""


@dataclass(frozen=True, slots=True)
class MotionState:
    """State of motion of the control point.

    Attributes:
        heading_rad: not wrapped: it continues beyond pi.
        travel_mps, rotate_radps: the commanded velocity that is in effect.
        lag_radps: the part of the true rotation that follows the command with a lag.
    """

    x_m: float
    y_m: float
    heading_rad: float
    travel_mps: float = 0.0
    rotate_radps: float = 0.0
    lag_radps: float = 0.0

    @property
    def figures(self) -> tuple[float, ...]:
        """All figures in the order of the fields."""
        speeds = (self.travel_mps, self.rotate_radps, self.lag_radps)
        return self.x_m, self.y_m, self.heading_rad, *speeds

    def point_behind(self, distance_m: float) -> Point:
        """Return the point at a distance behind the control point."""
        return Pose(self.x_m, self.y_m, heading_rad=self.heading_rad).ahead(-distance_m)


_PLAIN: Final = SimpleNamespace(sin=sin, cos=cos, sqrt=sqrt, tanh=tanh, exp=exp)


@dataclass(frozen=True, slots=True)
class MotionModel:
    """The response of a rover to commands, for numbers or for expressions of a module `ops`.

    Attributes:
        ahead_m: distance of the control point ahead of base_link.
    """

    yaw: YawResponse
    slip: SlipSettings
    ahead_m: float

    def true_rotation(self, rotate: Any, lag: Any, ops: Any = _PLAIN) -> Any:
        """Return the yaw rate in rad/s for a commanded rotation and a lag."""
        yaw = self.yaw
        return yaw.gain * rotate - yaw.drag_radps * ops.tanh(rotate / yaw.drag_at_radps) + lag

    def advance(
        self, state: Sequence[Any], controls: tuple[Any, Any], step: Any, ops: Any = _PLAIN
    ) -> list[Any]:
        """Return the state after a step, integrated with fourth order.

        Args:
            state: the figures of a `MotionState`, in its order.
            controls: the accelerations of the commanded travel and rotation.
            step: in seconds.
            ops: has `sin`, `cos`, `sqrt`, `tanh` and `exp` of these figures.
        """
        travel_mps2, rotate_radps2 = controls
        x, y, heading, travel, rotate, lag = state
        midway = travel + travel_mps2 * step / 2, rotate + rotate_radps2 * step / 2
        late, lag_s = self._lag_rate(*midway, travel_mps2, ops), self.yaw.lag_s
        decay = ops.exp(-step / lag_s)  # exact: a step may be many times longer than the lag
        mean = late + (lag - late) * (1 - decay) * lag_s / step
        speeds = [
            (travel + travel_mps2 * step * part, rotate + rotate_radps2 * step * part)
            for part in _GAUSS
        ]
        first, second = (self.true_rotation(each[1], mean, ops) for each in speeds)
        turning, gain = (first + second) / 2, (second - first) * sqrt(3.0)
        for part, pair, true in zip(_GAUSS, speeds, (first, second), strict=True):
            toward = heading + step * (part * turning - gain / 12)
            along, across = self._speeds(pair[0], true, travel_mps2, ops)
            cosine, sine = ops.cos(toward), ops.sin(toward)
            x = x + step / 2 * (along * cosine - across * sine)
            y = y + step / 2 * (along * sine + across * cosine)
        end = travel + travel_mps2 * step, rotate + rotate_radps2 * step
        return [x, y, heading + step * turning, *end, late + (lag - late) * decay]

    def state_after(self, state: MotionState, command: Velocity, step_s: float) -> MotionState:
        """Return the state after a step that ends with another command in effect."""
        controls = (
            (command.travel_mps - state.travel_mps) / step_s,
            (command.rotate_radps - state.rotate_radps) / step_s,
        )
        after = MotionState(*self.advance(state.figures, controls, step_s))
        return replace(after, travel_mps=command.travel_mps, rotate_radps=command.rotate_radps)

    def _lag_rate(self, travel: Any, rotate: Any, travel_mps2: Any, ops: Any) -> Any:
        """Return the steady-state value of the lag."""
        yaw = self.yaw
        of_turning = (
            yaw.travel * travel
            + yaw.travel_squared * travel**2
            + yaw.speed * ops.sqrt(travel**2 + _SMOOTH)
            - (yaw.acceleration + yaw.acceleration_travel * travel) * travel_mps2
        )
        late = rotate * ops.sqrt(rotate**2 + _SMOOTH) * of_turning
        return late - yaw.load * travel_mps2 * rotate

    def _speeds(self, travel: Any, true: Any, travel_mps2: Any, ops: Any) -> tuple[Any, Any]:
        """Return the velocity of the control point ahead and to its left, at steady-state slip."""
        magnitude = ops.sqrt(travel**2 + _SLIP_FROM)
        turning = ops.sqrt(true**2 + _SLIP_FROM)
        root, slip = ops.sqrt(turning / magnitude), self.slip
        about = slip.offset_m + slip.gain_m * travel * root - slip.acceleration_s2 * travel_mps2
        along = travel - slip.creep_s2 * travel_mps2 * turning
        return along, (self.ahead_m - about) * true


LEARN: Final = 0.3
"""Share of the yaw-rate error that each tick adds to the estimate."""
COMMAND_HISTORY: Final = 8
"""Number of commands in the history: it covers more than the age of odometry."""
STALL_TICKS: Final = 1.5
"""Period between two ticks, in ticks, beyond which control was interrupted."""
LATENESS_THRESHOLD_S: Final = 1e-3
"""Delay of odometry above the minimum so far, beyond which it counts as late."""
TIME_RESOLUTION_S: Final = 1e-9


@dataclass(frozen=True, slots=True)
class _Knot:
    """A command and its effective time; ramps connect the commands."""

    time_s: float
    velocity: Velocity


class MotionObserver:
    """Estimates the state of the control point from odometry, the commands in effect and the model.

    Attributes:
        ahead_m: distance of the control point ahead of base_link.
        late_s: time of the last tick that was too late, so that control was interrupted.
    """

    def __init__(
        self, settings: Settings, status: Status, model: MotionModel, mover: VelocityDriver
    ) -> None:
        self._settings = settings
        self._status = status
        self._model = model
        self._mover = mover
        self.ahead_m = model.ahead_m
        self.late_s = -inf
        self._sent_s = 0.0
        self._min_delay_s = inf  # minimum so far, from the stamp of odometry to its arrival
        self._knots: list[_Knot] = []
        self._last_odometry: Odometry | None = None
        self._lag_radps = 0.0

    def observe(self, now_s: float) -> MotionState:
        """Return the state at the effective time of the last command, and learn from odometry."""
        delay_s, tick_s = self._settings.mpc.command_delay_s, self._settings.tick_s
        sent_s = self._sent_s if self._knots else now_s - tick_s
        self._add(_Knot(sent_s + delay_s, self._mover.velocity))
        if now_s - sent_s > STALL_TICKS * tick_s:  # the command was held, until a tick ago
            self._add(_Knot(now_s - tick_s + delay_s, self._mover.velocity))
            self.late_s = now_s
        self._sent_s = now_s
        pose, status = self._status.pose, self._status
        measured_s = self._arrived_s(now_s) - self._settings.mpc.odometry_age_s
        self._learn(measured_s, status.odometry)
        point = pose.ahead(self.ahead_m)
        begun = self._commanded(measured_s)
        state = MotionState(
            point.x_m,
            point.y_m,
            pose.heading_rad,
            begun.travel_mps,
            begun.rotate_radps,
            self._lag_radps,
        )
        return self._roll(state, measured_s, self._knots[-1].time_s)

    @property
    def command_effective_s(self) -> float:
        """The effective time of the last command."""
        return self._knots[-1].time_s

    def _arrived_s(self, now_s: float) -> float:
        """Return the arrival time of the odometry, less its delay beyond the minimum."""
        arrived_s = now_s - self._status.odometry_age_s
        if self._status.odometry is None:
            return arrived_s
        apart_s = arrived_s - self._status.odometry.stamp_s
        self._min_delay_s = min(self._min_delay_s, apart_s)
        held_s = apart_s - self._min_delay_s
        return arrived_s - held_s if held_s > LATENESS_THRESHOLD_S else arrived_s

    def _add(self, knot: _Knot) -> None:
        if self._knots and knot.time_s <= self._knots[-1].time_s + TIME_RESOLUTION_S:
            self._knots.pop()
        self._knots = [*self._knots[1 - COMMAND_HISTORY :], knot]

    def _commanded(self, time_s: float) -> Velocity:
        """Return the command in effect at a time."""
        if time_s <= self._knots[0].time_s:
            return self._knots[0].velocity
        for before, after in pairwise(self._knots):
            if time_s <= after.time_s:
                part = (time_s - before.time_s) / (after.time_s - before.time_s)
                return before.velocity.interpolate(after.velocity, part)
        return self._knots[-1].velocity

    def _roll(self, state: MotionState, from_s: float, to_s: float) -> MotionState:
        """Propagate a state to a later time with the commands in effect."""
        times_s = [knot.time_s for knot in self._knots if from_s < knot.time_s < to_s]
        for before_s, after_s in pairwise([from_s, *times_s, to_s]):
            if after_s - before_s > TIME_RESOLUTION_S:
                state = self._model.state_after(state, self._commanded(after_s), after_s - before_s)
        return state

    def _learn(self, measured_s: float, odometry: Odometry | None) -> None:
        """Propagate the lag to the last odometry, and correct it by the measured turn since."""
        seen, self._last_odometry = self._last_odometry, odometry
        if seen is None or odometry is None or odometry is seen:
            return
        passed_s = odometry.stamp_s - seen.stamp_s
        if not TIME_RESOLUTION_S < passed_s < COMMAND_HISTORY * self._settings.tick_s:
            return
        begun = self._commanded(measured_s - passed_s)
        state = MotionState(0.0, 0.0, 0.0, begun.travel_mps, begun.rotate_radps, self._lag_radps)
        after = self._roll(state, measured_s - passed_s, measured_s)
        turned_rad = wrap_rad(odometry.pose.heading_rad - seen.pose.heading_rad)
        self._lag_radps = after.lag_radps + LEARN * (turned_rad - after.heading_rad) / passed_s
