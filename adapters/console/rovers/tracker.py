"""The life of each command, gathered from what is heard of it by all links.

A command ends as a notification says, never by the console's own belief: one of which nothing is
heard is UNKNOWN, until something is.
"""

import asyncio
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Final

from adapters.console.messages import (
    ENDED,
    CommandState,
    CommandStatus,
    Notified,
    StageReached,
)
from executive.reports import Identity

HEARD_WITHIN_S: Final = 10.0
"""Of a command that was sent something is to be heard within this."""
CHECK_S: Final = 1.0
MOST: Final = 5000
"""Commands that are kept in mind; those that ended longest ago are let go first."""
CONSOLE: Final = "console"
ORBITER: Final = "orbiter"
SENT: Final = "SENT"
TAKEN: Final = "TAKEN"
REJECTED: Final = "REJECTED"
GIVEN_UP: Final = "GIVEN_UP"
UNKNOWN: Final = "UNKNOWN"
PREDICTED: Final = "PREDICTED"
_STATES: Final = {
    "RECEIVED": CommandState.RECEIVED,
    "ACCEPTED": CommandState.ACCEPTED,
    "STARTED": CommandState.STARTED,
    "PROGRESS": CommandState.STARTED,
    "EXECUTED": CommandState.EXECUTED,
    REJECTED: CommandState.REJECTED,
    "FAILED": CommandState.FAILED,
    "CANCELLED": CommandState.CANCELLED,
    "EXPIRED": CommandState.EXPIRED,
    TAKEN: CommandState.TAKEN,
    GIVEN_UP: CommandState.GIVEN_UP,
    UNKNOWN: CommandState.UNKNOWN,
}
_ORDER: Final = list(CommandState)
_LIFE: Final = (
    frozenset({CommandState.RECEIVED, CommandState.ACCEPTED, CommandState.STARTED}) | ENDED
)


class CommandTracker:
    """Knows commands by their ids, and by source and number.

    Args:
        publish: called with a command at each change.
        utc: the time.
    """

    def __init__(
        self, publish: Callable[[CommandStatus], None], utc: Callable[[], float] = time.time
    ) -> None:
        self._publish = publish
        self._utc = utc
        self._commands: dict[str, CommandStatus] = {}
        self._ids: dict[tuple[str, Identity], str] = {}

    def restore(self, commands: Iterable[CommandStatus]) -> None:
        """Take in commands of a former run, oldest first."""
        for command in commands:
            self._keep(command)
            self._publish(command)
            if command.state is CommandState.SENDING:
                self.doubt(command.id, "the console was restarted before it was answered")

    def get(self, name: str) -> CommandStatus | None:
        """Return how the command of an id stands."""
        return self._commands.get(name)

    def begin(self, command: CommandStatus) -> None:
        """Take in a command that is about to be sent."""
        self._set(command)

    def taken(self, name: str, node: str) -> None:
        """The other end of the link has it; that is no news once it was heard of."""
        if self._commands[name].state not in _LIFE:
            self._reach(name, self._own(TAKEN, node))

    def refused(self, name: str, node: str, why: str) -> None:
        """The other end of the link answered by an error."""
        if not self._has(name, REJECTED):
            self._reach(name, self._own(REJECTED, node, why))

    def doubt(self, name: str, why: str) -> None:
        """Nothing more is known of a command that has not ended."""
        command = self._commands[name]
        if not command.ended and command.state is not CommandState.UNKNOWN:
            self._reach(name, self._own(UNKNOWN, CONSOLE, why))

    def doubt_all(self, asset: str, why: str) -> None:
        """The same for all commands of an asset."""
        for command in tuple(self._commands.values()):
            if command.asset == asset:
                self.doubt(command.id, why)

    def hear(self, said: Notified, identity: Identity) -> str:
        """Take in a notification on a command; return the command's id."""
        name = self._ids.get((said.asset, identity))
        if name is None:
            name = str(identity)
            self._set(self._foreign(name, said, identity))
        stage = PREDICTED if said.stage is None else said.stage
        self._reach(
            name,
            StageReached(
                stage=stage,
                node=said.asset,
                utc=said.utc,
                rx=said.rx,
                detail=said.text,
                code=said.code,
                step=said.step,
                steps=said.steps,
                sequence=said.sequence,
                figures=said.figures,
            ),
        )
        return name

    def hear_given_up(self, said: Notified, identity: Identity) -> str | None:
        """Take in that the relay gave a command up; return its id, if it is known."""
        name = self._ids.get((said.asset, identity))
        if name is not None and not self._has(name, GIVEN_UP):
            reached = StageReached(GIVEN_UP, ORBITER, said.utc, said.rx, said.text)
            self._reach(name, reached)
        return name

    async def run(self) -> None:
        """Look again and again for commands of which nothing was heard in time."""
        while True:
            await asyncio.sleep(CHECK_S)
            self.check()

    def check(self) -> None:
        """Doubt the commands of which nothing was heard in time."""
        now_s = self._utc()
        for command in tuple(self._commands.values()):
            if command.deadline is not None and now_s > command.deadline:
                self.doubt(command.id, f"nothing was heard of it for {HEARD_WITHIN_S:g} s")

    def _own(self, stage: str, node: str, detail: str = "") -> StageReached:
        now_s = self._utc()
        return StageReached(stage, node, now_s, now_s, detail)

    def _has(self, name: str, stage: str) -> bool:
        return any(each.stage == stage for each in self._commands[name].history)

    def _reach(self, name: str, reached: StageReached) -> None:
        command = self._commands[name]
        history = command.history
        alike = [
            each
            for each in history
            if (each.stage, each.step) == (reached.stage, reached.step) and each.stage != UNKNOWN
        ]
        if alike and (alike[0].sequence is not None or reached.sequence is None):
            return  # by another link, or because the command came again
        history = tuple(each for each in history if each not in alike)
        state = _later(command.state, _STATES.get(reached.stage, command.state))
        waits = state in {CommandState.SENDING, CommandState.TAKEN}
        kept = waits and not (state is CommandState.TAKEN and reached.node == ORBITER)
        self._set(
            replace(
                command,
                state=state,
                ended=state in ENDED,
                deadline=command.deadline if kept else None,
                history=(*history, reached),
            )
        )

    def _foreign(self, name: str, said: Notified, identity: Identity) -> CommandStatus:
        return CommandStatus(
            id=name,
            asset=said.asset,
            name=said.text if said.stage == "RECEIVED" else "",
            args=None,
            by=identity.source,
            source=identity.source,
            number=identity.command_id,
            link=said.link,
            state=CommandState.SENDING,
            ended=False,
            made=said.utc,
            deadline=None,
            history=(),
        )

    def _set(self, command: CommandStatus) -> None:
        self._keep(command)
        self._publish(command)

    def _keep(self, command: CommandStatus) -> None:
        self._commands[command.id] = command
        identity = Identity(command.source, command.number)
        self._ids[command.asset, identity] = command.id
        if len(self._commands) > MOST:
            gone = next((each for each in self._commands.values() if each.ended), command)
            del self._commands[gone.id]
            del self._ids[gone.asset, Identity(gone.source, gone.number)]


def _later(now: CommandState, reached: CommandState) -> CommandState:
    """Return the state after a stage was heard, maybe late: a life goes on and does not go back."""
    if now in ENDED:
        return now
    if reached in _LIFE or now not in _LIFE:
        if now in _LIFE and _ORDER.index(reached) < _ORDER.index(now):
            return now
        return reached
    return reached if reached in {CommandState.UNKNOWN, CommandState.GIVEN_UP} else now
