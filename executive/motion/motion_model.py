"""`MotionModel` of a rover that accepts velocities, for numbers or for symbolic expressions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, exp, sin, sqrt, tanh
from types import SimpleNamespace
from typing import Any, Final

from executive.settings import SlipSettings, YawResponse
from executive.values.geometry import Point, Pose, Velocity

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
