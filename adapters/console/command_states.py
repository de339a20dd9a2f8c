"""`apply_stage`: a command's state after a received stage; `merge` of what two consoles know."""

from dataclasses import replace
from typing import Final

from adapters.console.messages import TERMINAL_STATES, CommandState, CommandStatus, StageEntry
from executive.values.reports import Stage

CONSOLE: Final = "console"
ORBITER: Final = "orbiter"
SENT: Final = "SENT"
ACKNOWLEDGED: Final = "ACKNOWLEDGED"
RECEIVED: Final = Stage.RECEIVED.name
REJECTED: Final = Stage.REJECTED.name
FORWARDED: Final = "FORWARDED"
LOST: Final = "LOST"
UNKNOWN: Final = "UNKNOWN"
ACTIVE: Final = "ACTIVE"
"""Stage of a command that the asset reports as active after a lost link."""
PREDICTED: Final = "PREDICTED"
_STATES: Final = {each.name: each for each in CommandState} | {
    Stage.PROGRESS.name: CommandState.STARTED,
    FORWARDED: CommandState.ACKNOWLEDGED,
    ACTIVE: CommandState.STARTED,
}
_ORDER: Final = list(CommandState)
LIFECYCLE_STATES: Final = frozenset(_STATES[stage.name] for stage in Stage)
"""States that the rover itself reports."""


def apply_stage(command: CommandStatus, reached: StageEntry) -> CommandStatus:
    """Return a command after a stage was received; the same command if nothing changes."""
    history = command.history
    alike = [
        each
        for each in history
        if (each.stage, each.step) == (reached.stage, reached.step)
        and each.stage not in {UNKNOWN, ACTIVE}
    ]
    if alike and (alike[0].sequence is not None or reached.sequence is None):
        return command  # received over another link, or for a repeated command
    history = tuple(each for each in history if each not in alike)
    before = CommandState.RECEIVED if _disproves_refusal(command, reached) else command.state
    state = _next_state(before, _STATES.get(reached.stage, before))
    waits = state in {CommandState.SENDING, CommandState.ACKNOWLEDGED}
    is_pending = waits and not (state is CommandState.ACKNOWLEDGED and reached.node == ORBITER)
    return replace(
        command,
        state=state,
        ended=state in TERMINAL_STATES,
        deadline=command.deadline if is_pending else None,
        history=(*history, reached),
    )


def merge(stored: CommandStatus, received: CommandStatus) -> CommandStatus:
    """Return the merge of two views of a command: of archive and console, or of two consoles.

    Args:
        stored: state of the archive; its operator and arguments have priority, if known.
        received: state of the console.
    """
    added = [each for each in received.history if each not in stored.history]
    history = sorted([*stored.history, *added], key=_received_utc)
    posted = received if stored.args is None and received.args is not None else stored
    merged = replace(
        stored,
        name=posted.name or received.name,
        args=posted.args,
        by=posted.by,
        link=posted.link,
        created=min(stored.created, received.created),
        state=CommandState.SENDING,
        ended=False,
        deadline=stored.deadline if received.deadline is None else received.deadline,
        history=(),
    )
    for reached in history:
        merged = apply_stage(merged, reached)
    return merged


def _disproves_refusal(command: CommandStatus, reached: StageEntry) -> bool:
    """Whether a command that was answered with an error is executed nevertheless.

    This occurs if the command was refused because the ledger could not be written.
    """
    return (
        command.state is CommandState.REJECTED
        and all(each.stage != REJECTED or each.sequence is None for each in command.history)
        and reached.sequence is not None
        and _STATES.get(reached.stage) in LIFECYCLE_STATES - {CommandState.RECEIVED}
    )


def _received_utc(reached: StageEntry) -> tuple[float, int, float]:
    return reached.rx, reached.sequence or 0, reached.utc


def _next_state(now: CommandState, reached: CommandState) -> CommandState:
    """Return the state after a stage, which may be late: the life cycle never goes back."""
    if now in TERMINAL_STATES:
        return now
    if reached in LIFECYCLE_STATES or now not in LIFECYCLE_STATES:
        if now in LIFECYCLE_STATES and _ORDER.index(reached) < _ORDER.index(now):
            return now
        return reached
    return reached if reached in {CommandState.UNKNOWN, CommandState.LOST} else now
