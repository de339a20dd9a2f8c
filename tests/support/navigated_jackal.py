"""A simulated Jackal that a stand-in navigation drives, through its mux or by the relay."""

from dataclasses import dataclass, field
from typing import Final

from executive.settings import NavigationGate
from executive.values.facts import (
    NavigationFeedback,
    NavigationState,
    NavigationStatus,
    NavigationVelocity,
    PlannedPath,
)
from executive.values.ports import NavigateTo, NavigationGoal, PathRequest
from sim.rover.jackal import SimulatedJackal
from sim.rover.lockstep import STEP_S
from sim.scenario.model import Scenario
from tests.support.navigation import GoalEnd, GoalFeedback, GoalResult, Navigation

PERIOD_S: Final = 0.05
_ENDS: Final = {
    GoalEnd.SUCCEEDED: NavigationState.SUCCEEDED,
    GoalEnd.ABORTED: NavigationState.ABORTED,
    GoalEnd.CANCELLED: NavigationState.CANCELLED,
}


@dataclass(frozen=True, slots=True)
class _Key:
    """Stands for the UUID of a goal; each has its own."""

    number: int
    uuid: object = field(default_factory=object)


class NavigatedJackal(SimulatedJackal):
    """A Jackal with a navigation, which measures in the frame of the rover's odometry.

    Attributes:
        goals: those that the executive sent.
    """

    def __init__(self, scenario: Scenario, navigation: Navigation) -> None:
        settings = scenario.settings
        super().__init__(
            scenario.world,
            scenario.seed,
            scenario.odometry,
            sensors=settings.sensors,
            mux=settings.mux,
        )
        assert settings.navigation is not None
        self._gate = settings.navigation
        self._navigation = navigation
        self._key: _Key | None = None
        self._step_at_s = 0.0
        self.goals: list[NavigationGoal] = []

    def navigate(self, goal: NavigationGoal) -> None:
        """Submit the goal, whose answer is a fact."""
        assert isinstance(goal.task, NavigateTo)
        self.goals.append(goal)
        key = self._key = _Key(goal.number)
        accepted = self._navigation.submit(key, goal.task.poses, self.time_s)
        if accepted is not None:
            state = NavigationState.ACCEPTED if accepted else NavigationState.REJECTED
            self._due.append(NavigationStatus(goal.number, state))

    def cancel_navigation(self) -> None:
        """Cancel all goals."""
        self._navigation.cancel()

    def open_gate(self, is_open: bool) -> None:
        """Publish on the lock of the navigation; the relay needs none."""
        if self._gate.lock is not None:
            self.mux_lock(self._gate.lock, not is_open)

    def emergency_stop(self) -> None:
        """Shut the gate, too."""
        self.open_gate(False)
        super().emergency_stop()

    def plan_path(self, request: PathRequest) -> None:
        """Plan a straight line."""
        points = request.start.point, request.goal.point
        self._due.append(PlannedPath(request.number, points))

    def advance(self, duration_s: float) -> None:
        """Advance base and navigation."""
        super().advance(duration_s)
        if self.time_s < self._step_at_s - STEP_S / 2:
            return
        self._step_at_s = self.time_s + PERIOD_S
        velocity = self._navigation.step(self.time_s, self.odometry.pose)
        if velocity is not None:
            if self._gate.gate is NavigationGate.LOCK:
                self.mux_command(self._gate.input, velocity)
            self._due.append(NavigationVelocity(velocity))
        events, self._navigation.events = self._navigation.events, []
        for event in events:
            if event.key is not self._key or self._key is None:
                continue
            number = self._key.number
            match event:
                case GoalFeedback(_, remaining_m, recoveries, left):
                    self._due.append(NavigationFeedback(number, remaining_m, recoveries, left))
                case GoalResult(_, end, code, text):
                    self._due.append(NavigationStatus(number, _ENDS[end], code, text=text))
                case _:
                    self._due.append(NavigationStatus(number, NavigationState.LOST))
