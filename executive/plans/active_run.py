"""`ActiveRun`: the executing plan with its tree, and the state that is stored of it."""

from dataclasses import dataclass
from math import dist, inf
from typing import Final

from executive.plans.execution import LeafError, PlanExecution, PlanTree
from executive.plans.recovery import STORED_POSITION_M
from executive.plans.state import MAX_STATE_LENGTH, PlanState, StateError, encode, shifted
from executive.record import StoredState
from executive.state import MotionStatistics
from executive.values.clock import Clock
from executive.values.reasons import Figure

MAX_WAITS_LENGTH: Final = 1000
"""Maximum length in characters of the text of waits and questions; the rest is cut."""


@dataclass(slots=True)
class ActiveRun:
    """The executing plan.

    Attributes:
        digest: digest of its text, arguments and nodes.
        resumes: whether it continues by itself after a restart, near its stored position.
        statistics: its motion statistics; None after a suspension.
        saved: its state as last stored.
    """

    execution: PlanExecution
    tree: PlanTree
    digest: str
    resumes: bool
    statistics: MotionStatistics | None
    saved: PlanState

    @property
    def result_figures(self) -> tuple[Figure, ...]:
        """Its measured and predicted figures."""
        return () if self.statistics is None else self.statistics.figures()

    @property
    def waits(self) -> str:
        """Its present waits and questions as text."""
        return self.tree.waits()[:MAX_WAITS_LENGTH]

    def state(self) -> PlanState:
        """Return its state, with the present records of its nodes."""
        return self._with_records(self.execution.state(self.tree.state()))

    def final_state(self, clock: Clock) -> StoredState:
        """Return the state to store after its end."""
        return StoredState(self.digest, clock.utc_s(), True, encode(self.state().at_end()))

    def changed_state(self, clock: Clock, suspended: bool) -> StoredState | None:
        """Return its state to store, if it changed since this was called last, or is suspended.

        Raises:
            LeafError: it is too large.
        """
        state, before = self.execution.state(self.tree.state()), self.saved
        moved_m = 0.0
        if self.resumes and state.position is not None:
            moved_m = inf if before.position is None else dist(state.position, before.position)
        if (
            state._replace(position=before.position) == before
            and moved_m < STORED_POSITION_M
            and not suspended
        ):
            return None
        self.saved, left = state, shifted(state, -clock.now_s())
        if len(text := encode(self._with_records(left))) > MAX_STATE_LENGTH:
            text = encode(left)  # the records are for the operators only
        if len(text) > MAX_STATE_LENGTH and not suspended:
            path = f"plan:{self.execution.plan.plan_id}"
            raise LeafError(path) from StateError("too large a state")
        return StoredState(self.digest, clock.utc_s(), suspended, text)

    def _with_records(self, state: PlanState) -> PlanState:
        return state._replace(records=self.execution.records.encoded(self.tree.details()))
