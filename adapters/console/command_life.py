"""Life cycle of a command: state transitions by stages, and the merge of several consoles."""

from dataclasses import replace
from typing import Final

from adapters.console.messages import ENDED, CommandState, CommandStatus, StageEntry

CONSOLE: Final = "console"
ORBITER: Final = "orbiter"
SENT: Final = "SENT"
TAKEN: Final = "TAKEN"
RECEIVED: Final = "RECEIVED"
REJECTED: Final = "REJECTED"
FORWARDED: Final = "FORWARDED"
GIVEN_UP: Final = "GIVEN_UP"
UNKNOWN: Final = "UNKNOWN"
PREDICTED: Final = "PREDICTED"
_STATES: Final = {
    RECEIVED: CommandState.RECEIVED,
    "ACCEPTED": CommandState.ACCEPTED,
    "STARTED": CommandState.STARTED,
    "PROGRESS": CommandState.STARTED,
    "EXECUTED": CommandState.EXECUTED,
    REJECTED: CommandState.REJECTED,
    "FAILED": CommandState.FAILED,
    "CANCELLED": CommandState.CANCELLED,
    "EXPIRED": CommandState.EXPIRED,
    TAKEN: CommandState.TAKEN,
    FORWARDED: CommandState.TAKEN,
    GIVEN_UP: CommandState.GIVEN_UP,
    UNKNOWN: CommandState.UNKNOWN,
}
_ORDER: Final = list(CommandState)
LIFE: Final = (
    frozenset({CommandState.RECEIVED, CommandState.ACCEPTED, CommandState.STARTED}) | ENDED
)


def reach(command: CommandStatus, reached: StageEntry) -> CommandStatus:
    """Return a command after a stage was received; the same command if nothing changes."""
    history = command.history
    alike = [
        each
        for each in history
        if (each.stage, each.step) == (reached.stage, reached.step) and each.stage != UNKNOWN
    ]
    if alike and (alike[0].sequence is not None or reached.sequence is None):
        return command  # received over another link, or for a repeated command
    history = tuple(each for each in history if each not in alike)
    before = CommandState.RECEIVED if _disproves_refusal(command, reached) else command.state
    state = _later(before, _STATES.get(reached.stage, before))
    waits = state in {CommandState.SENDING, CommandState.TAKEN}
    is_pending = waits and not (state is CommandState.TAKEN and reached.node == ORBITER)
    return replace(
        command,
        state=state,
        ended=state in ENDED,
        deadline=command.deadline if is_pending else None,
        history=(*history, reached),
    )


def merge(kept: CommandStatus, heard: CommandStatus) -> CommandStatus:
    """Return the merge of two views of a command: of archive and console, or of two consoles.

    Args:
        kept: state of the archive; its operator and arguments have priority, if known.
        heard: state of the console.
    """
    added = [each for each in heard.history if each not in kept.history]
    history = sorted([*kept.history, *added], key=_heard_at)
    posted = heard if kept.args is None and heard.args is not None else kept
    merged = replace(
        kept,
        name=posted.name or heard.name,
        args=posted.args,
        by=posted.by,
        link=posted.link,
        made=min(kept.made, heard.made),
        state=CommandState.SENDING,
        ended=False,
        deadline=kept.deadline if heard.deadline is None else heard.deadline,
        history=(),
    )
    for reached in history:
        merged = reach(merged, reached)
    return merged


def _disproves_refusal(command: CommandStatus, reached: StageEntry) -> bool:
    """Whether a command that was answered with an error is executed nevertheless.

    This occurs if the command was refused because the ledger could not be written.
    """
    return (
        command.state is CommandState.REJECTED
        and all(each.stage != REJECTED or each.sequence is None for each in command.history)
        and reached.sequence is not None
        and _STATES.get(reached.stage) in LIFE - {CommandState.RECEIVED}
    )


def _heard_at(reached: StageEntry) -> tuple[float, int, float]:
    return reached.rx, reached.sequence or 0, reached.utc


def _later(now: CommandState, reached: CommandState) -> CommandState:
    """Return the state after a stage, which may be late: the life cycle never goes back."""
    if now in ENDED:
        return now
    if reached in LIFE or now not in LIFE:
        if now in LIFE and _ORDER.index(reached) < _ORDER.index(now):
            return now
        return reached
    return reached if reached in {CommandState.UNKNOWN, CommandState.GIVEN_UP} else now
