"""`MotionObserver` estimates the present state of motion, with delays of commands and odometry."""

from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Final

from executive.motion.motion_model import MotionModel, MotionState
from executive.motion.velocity_control import VelocityDriver
from executive.settings import Settings
from executive.state import Status
from executive.values.facts import Odometry
from executive.values.geometry import Velocity, wrap_rad

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
