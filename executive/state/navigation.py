"""`NavigationTrack`: the active goal of the navigation, and the reports of it."""

from math import inf
from typing import Final

from executive.values.clock import Clock
from executive.values.facts import (
    NavigationFeedback,
    NavigationState,
    NavigationStatus,
    NavigationVelocity,
)
from executive.values.geometry import STANDING, Velocity
from executive.values.ports import NavigationGoal
from executive.values.quantities import quantity_text

MIN_MPS, MIN_RADPS = 1e-3, 1e-3
"""Minimum velocity that counts as motion: rounding of a smoother is none."""
QUIET_S: Final = 0.3
"""Age of a velocity after which the navigation counts as silent: controllers publish at 20 Hz."""
START_GRACE_S: Final = 3.0
"""Time from the start: a goal of the previous process may still be cancelled."""
_OPEN: Final = {NavigationState.ACCEPTED, NavigationState.UNAVAILABLE}


class NavigationTrack:
    """State of the active goal. Facts of other goals are late or repeated, and are ignored.

    Attributes:
        goal: the goal, from its request until the driver ends it; None without one.
        sent_s: when it was requested.
        answer: its newest state; the first terminal one remains. None before the first.
        answer_s: when that arrived.
        contact_s: when its server last reported of it.
        feedback: its newest feedback.
        preempted_s: when a goal of another client was last reported.
        is_open: whether the gate is open.
        idle_s: since when no goal is active; infinite while one is.
        velocity: the newest velocity of the navigation, of any goal, and `velocity_s`, its time.
        moving_since_s: since when it commands motion, if it does.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.goal: NavigationGoal | None = None
        self.sent_s = self.answer_s = self.contact_s = self.preempted_s = -inf
        self.answer: NavigationStatus | None = None
        self.feedback: NavigationFeedback | None = None
        self.is_open = False
        self.idle_s = clock.now_s() + START_GRACE_S
        self.velocity, self.velocity_s = STANDING, -inf
        self._moved_s = self.moving_since_s = -inf

    def begin(self, goal: NavigationGoal) -> None:
        """Follow a goal that is requested now."""
        self.goal, self.answer, self.feedback = goal, None, None
        self.sent_s = self._clock.now_s()
        self.idle_s = inf

    def end(self) -> None:
        """End the active goal, if there is one."""
        if self.goal is not None:
            self.goal, self.idle_s = None, self._clock.now_s()

    def observe(self, fact: NavigationStatus | NavigationFeedback | NavigationVelocity) -> None:
        """Add a fact."""
        now_s = self._clock.now_s()
        if isinstance(fact, NavigationVelocity):
            if not self.moves:
                self.moving_since_s = now_s
            self.velocity, self.velocity_s = fact.velocity, now_s
            if is_motion(fact.velocity):
                self._moved_s = now_s
            return
        if isinstance(fact, NavigationStatus) and fact.state is NavigationState.PREEMPTED:
            self.preempted_s = now_s
        if self.goal is None or fact.number != self.goal.number:
            return
        if isinstance(fact, NavigationFeedback):
            self.feedback, self.contact_s = fact, now_s
        elif self.answer is None or (
            self.answer.state in _OPEN and fact.state is not self.answer.state
        ):
            self.answer, self.answer_s, self.contact_s = fact, now_s, now_s

    @property
    def accepted(self) -> bool:
        """Whether the server executes the goal, as far as it is known."""
        state = None if self.answer is None else self.answer.state
        return self.goal is not None and state is NavigationState.ACCEPTED

    @property
    def answered(self) -> bool:
        """Whether the server has answered the goal, by any state."""
        answer = self.answer
        return answer is not None and answer.state is not NavigationState.UNAVAILABLE

    @property
    def moves(self) -> bool:
        """Whether the navigation commands a velocity other than zero."""
        age_s = self._clock.now_s() - self.velocity_s
        return age_s <= QUIET_S and is_motion(self.velocity)

    @property
    def uncommanded_s(self) -> float:
        """Time from the end of the last goal to the newest velocity other than zero."""
        return self._moved_s - self.idle_s if self.moves else -inf

    @property
    def text(self) -> str:
        """The goal and the reports of it, for display; empty without one."""
        goal, answer, feedback = self.goal, self.answer, self.feedback
        if goal is None:
            return ""
        parts = ["requested" if answer is None else answer.state.value]
        if feedback is not None and feedback.remaining_m is not None:
            parts.append(f"{quantity_text(feedback.remaining_m, 'm', '.2f')} of its path left")
        if feedback is not None and (feedback.poses_remaining or 0) > 1:
            parts.append(f"{feedback.poses_remaining} poses left")
        if feedback is not None and feedback.recoveries:
            parts.append(f"recoveries: {feedback.recoveries}")
        return f"navigation goal {goal.number} {', '.join(parts)}"


def is_motion(velocity: Velocity) -> bool:
    """Return whether a velocity moves the rover; also if it is not finite."""
    return not (abs(velocity.travel_mps) < MIN_MPS and abs(velocity.rotate_radps) < MIN_RADPS)
