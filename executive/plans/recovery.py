"""`recover_state` brings the stored state of a plan up to date after the process has ended."""

from executive.plans.state import StateCommand, StateError, decode, encode, shifted
from executive.record import PlanStore, StoredState


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


def _ended(store: PlanStore, plan_id: str, command: StateCommand) -> StateCommand | None:
    """Return a command with its terminal stage; None if it has not reached one."""
    report = store.last_report(plan_id, command.command_id)
    if report is None or report.stage is None or not report.stage.terminal:
        return None
    reason = 0 if report.reason is None else report.reason.value
    return command._replace(stage=report.stage.value, reason=reason)
