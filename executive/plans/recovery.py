"""The stored state of a plan after the process has ended.

`recover_state` brings it up to date; `continued_state` is that of a plan that continues by itself.
"""

from dataclasses import replace
from math import dist
from typing import Final

from executive.plans.state import PlanState, StateCommand, StateError, decode, encode, shifted
from executive.record import PlanStore, StoredState

MAX_RESTARTS: Final = 3
"""Maximum number of restarts after which a plan continues by itself."""
MAX_RESTART_DISTANCE_M: Final = 1.5
"""Maximum distance from the stored position for a plan that continues by itself; chosen."""
STORED_POSITION_M: Final = 0.5
"""Distance after which the position of the rover is stored again."""


def recover_state(store: PlanStore, plan_id: str, utc_s: float, resumes: bool) -> bool:
    """Store the state of a plan of the previous process: its commands that ended, its timers.

    Timers that are not stopped, while the plan is suspended, show that it is to continue by itself,
    also to the next process.

    Args:
        store: the stored plans.
        plan_id: id of the plan.
        utc_s: present time, seconds since 1970-01-01 UTC.
        resumes: whether the plan may continue by itself.

    Returns:
        Whether it continues by itself: this counts as one of its restarts.
    """
    read = _read(store, plan_id)
    if read is None:
        return False  # the plan fails when it continues, if there is one
    stored, state = read
    found = (each if each.stage else _ended(store, plan_id, each) for each in state.commands)
    commands = tuple(each for each in found if each is not None)
    continues = resumes and state.restarts < MAX_RESTARTS
    state = state._replace(
        commands=commands,
        ended=(*state.ended, *(each.node for each in commands)),
        restarts=state.restarts + continues,
    )
    if not stored.suspended:
        state = shifted(state, min(0.0, stored.utc_s - utc_s))
    store.save_state(plan_id, StoredState(stored.digest, utc_s, not continues, encode(state)))
    return continues


def continued_state(
    store: PlanStore, plan_id: str, position: tuple[float, float], utc_s: float
) -> tuple[StoredState, PlanState] | None:
    """Return the state of a plan that continues by itself; None if it must not.

    Args:
        store: the stored plans.
        plan_id: id of the plan.
        position: present position x, y of the rover in m.
        utc_s: present time, seconds since 1970-01-01 UTC.
    """
    read = _read(store, plan_id)
    if read is None:
        return None
    stored, state = read
    if state.position is None or dist(position, state.position) > MAX_RESTART_DISTANCE_M:
        return None
    state = shifted(state, min(0.0, stored.utc_s - utc_s))
    return replace(stored, utc_s=utc_s, text=encode(state)), state


def ended_state(store: PlanStore, plan_id: str) -> StoredState | None:
    """Return the state to store of a plan that ends while it is suspended; None to leave it."""
    read = _read(store, plan_id)
    return None if read is None else replace(read[0], text=encode(read[1].at_end()))


def has_questions(store: PlanStore, plan_id: str) -> bool:
    """Return whether a plan has open questions, without reading its text."""
    read = _read(store, plan_id)
    return read is not None and bool(read[1].questions)


def _read(store: PlanStore, plan_id: str) -> tuple[StoredState, PlanState] | None:
    stored = store.state(plan_id)
    try:
        return None if stored is None else (stored, decode(stored.text))
    except StateError:
        return None


def _ended(store: PlanStore, plan_id: str, command: StateCommand) -> StateCommand | None:
    report = store.last_report(plan_id, command.command_id)
    if report is None or report.stage is None or not report.stage.terminal:
        return None
    reason = 0 if report.reason is None else report.reason.value
    return command._replace(stage=report.stage.value, reason=reason)
