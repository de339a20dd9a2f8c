"""How the rover moves, while commands come into effect late and odometry arrives late."""

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
"""Of a difference in the rate of turn, what each tick makes of it."""
KEPT: Final = 8
"""Commands that are kept: longer than odometry is old."""
LATE_TICKS: Final = 1.5
"""From one tick to the next, beyond which the rover was not led meanwhile."""
HELD_S: Final = 1e-3
"""By how much odometry has to come later than at best, to count as late."""
FINEST_S: Final = 1e-9


@dataclass(frozen=True, slots=True)
class _Knot:
    """A command, and from when on it is in effect, between which it goes in ramps."""

    time_s: float
    velocity: Velocity


class MotionObserver:
    """Knows how the control point moves, by odometry, the commands in effect and the model.

    Attributes:
        ahead_m: of the control point, from base_link.
        late_s: when a tick last came so late that the rover was not led meanwhile.
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
        self._apart_s = inf  # least so far, from the stamp of odometry to its arrival
        self._knots: list[_Knot] = []
        self._seen: Odometry | None = None
        self._lag_radps = 0.0

    def observe(self, now_s: float) -> MotionState:
        """Return the state in which the last command is in effect, and learn from odometry."""
        delay_s, tick_s = self._settings.mpc.command_delay_s, self._settings.tick_s
        sent_s = self._sent_s if self._knots else now_s - tick_s
        self._add(_Knot(sent_s + delay_s, self._mover.velocity))
        if now_s - sent_s > LATE_TICKS * tick_s:  # the command was held, until a tick ago
            self._add(_Knot(now_s - tick_s + delay_s, self._mover.velocity))
            self.late_s = now_s
        self._sent_s = now_s
        pose, status = self._status.pose, self._status
        measured_s = self._arrived_s(now_s) - self._settings.mpc.odometry_age_s
        self._learn(measured_s, status.odometry)
        place = pose.ahead(self.ahead_m)
        begun = self._commanded(measured_s)
        state = MotionState(
            place.x_m,
            place.y_m,
            pose.heading_rad,
            begun.travel_mps,
            begun.rotate_radps,
            self._lag_radps,
        )
        return self._roll(state, measured_s, self._knots[-1].time_s)

    @property
    def effect_s(self) -> float:
        """When the last command is in effect."""
        return self._knots[-1].time_s

    def _arrived_s(self, now_s: float) -> float:
        """Return when odometry would have arrived that takes no longer than the fastest so far."""
        arrived_s = now_s - self._status.odometry_age_s
        if self._status.odometry is None:
            return arrived_s
        apart_s = arrived_s - self._status.odometry.stamp_s
        self._apart_s = min(self._apart_s, apart_s)
        held_s = apart_s - self._apart_s
        return arrived_s - held_s if held_s > HELD_S else arrived_s

    def _add(self, knot: _Knot) -> None:
        if self._knots and knot.time_s <= self._knots[-1].time_s + FINEST_S:
            self._knots.pop()
        self._knots = [*self._knots[1 - KEPT :], knot]

    def _commanded(self, time_s: float) -> Velocity:
        """Return the command that is in effect at a time."""
        if time_s <= self._knots[0].time_s:
            return self._knots[0].velocity
        for before, after in pairwise(self._knots):
            if time_s <= after.time_s:
                part = (time_s - before.time_s) / (after.time_s - before.time_s)
                return before.velocity.toward(after.velocity, part)
        return self._knots[-1].velocity

    def _roll(self, state: MotionState, from_s: float, to_s: float) -> MotionState:
        """Return a state as it is later, by the commands in effect."""
        times_s = [knot.time_s for knot in self._knots if from_s < knot.time_s < to_s]
        for before_s, after_s in pairwise([from_s, *times_s, to_s]):
            if after_s - before_s > FINEST_S:
                state = self._model.moved(state, self._commanded(after_s), after_s - before_s)
        return state

    def _learn(self, measured_s: float, odometry: Odometry | None) -> None:
        """Take the lag on to the last odometry, corrected by how far the rover turned since."""
        seen, self._seen = self._seen, odometry
        if seen is None or odometry is None or odometry is seen:
            return
        passed_s = odometry.stamp_s - seen.stamp_s
        if not FINEST_S < passed_s < KEPT * self._settings.tick_s:
            return
        begun = self._commanded(measured_s - passed_s)
        state = MotionState(0.0, 0.0, 0.0, begun.travel_mps, begun.rotate_radps, self._lag_radps)
        after = self._roll(state, measured_s - passed_s, measured_s)
        turned_rad = wrap_rad(odometry.pose.heading_rad - seen.pose.heading_rad)
        self._lag_radps = after.lag_radps + LEARN * (turned_rad - after.heading_rad) / passed_s
