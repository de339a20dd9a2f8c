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


def recover_state(store: PlanStore, plan_id: str, utc_s: float) -> None:
    """Store the state of a plan that was executing: its commands that ended, its timers.

    Args:
        store: the stored plans.
        plan_id: id of the plan.
        utc_s: present time, seconds since 1970-01-01 UTC.
    """
    stored = store.state(plan_id)
    if stored is None:
        return
    try:
        state = decode(stored.text)
    except StateError:
        return  # the plan fails when it continues
    found = (each if each.stage else _ended(store, plan_id, each) for each in state.commands)
    commands = tuple(each for each in found if each is not None)
    ended = (*state.ended, *(each.node for each in commands))
    state = state._replace(commands=commands, ended=ended)
    if not stored.suspended:
        state = shifted(state, min(0.0, stored.utc_s - utc_s))
    store.save_state(plan_id, StoredState(stored.digest, utc_s, True, encode(state)))


def continued_state(
    store: PlanStore, plan_id: str, position: tuple[float, float] | None
) -> tuple[StoredState, PlanState] | None:
    """Return the state of a plan that continues by itself, with one restart more; None if not.

    Args:
        store: the stored plans.
        plan_id: id of the plan.
        position: present position x, y of the rover in m; None if it is not known.
    """
    stored = store.state(plan_id)
    try:
        state = PlanState() if stored is None else decode(stored.text)
    except StateError:
        return None
    if stored is None or position is None or state.position is None:
        return None
    far = dist(position, state.position) > MAX_RESTART_DISTANCE_M
    if far or state.restarts >= MAX_RESTARTS:
        return None
    state = state._replace(restarts=state.restarts + 1)
    return replace(stored, text=encode(state)), state


def _ended(store: PlanStore, plan_id: str, command: StateCommand) -> StateCommand | None:
    """Return a command with its terminal stage; None if it has not reached one."""
    report = store.last_report(plan_id, command.command_id)
    if report is None or report.stage is None or not report.stage.terminal:
        return None
    reason = 0 if report.reason is None else report.reason.value
    return command._replace(stage=report.stage.value, reason=reason)
