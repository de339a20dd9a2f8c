"""Life cycle of each command, merged from the reports of all links.

A command ends only by a notification. Without one in time its state is UNKNOWN, until the next
notification.
"""

import asyncio
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Final

from adapters.console.command_life import (
    CONSOLE,
    LIFE,
    ORBITER,
    PREDICTED,
    RECEIVED,
    REJECTED,
    TAKEN,
    UNKNOWN,
    merge,
    reach,
)
from adapters.console.messages import CommandState, CommandStatus, Notified, StageEntry
from executive.values.reports import Identity

HEARD_WITHIN_S: Final = 10.0
"""Timeout for the first report on a sent command, s; chosen, not measured."""
CHECK_S: Final = 1.0
MOST: Final = 5000
"""Maximum number of tracked commands; beyond it the earliest ended ones are dropped."""


class CommandTracker:
    """Tracks commands by id, and by source and number.

    Args:
        publish: called with a command at each change.
        utc: clock, s since 1970 UTC.
    """

    def __init__(self, publish: Callable[[CommandStatus], None], utc: Callable[[], float]) -> None:
        self._publish = publish
        self._utc = utc
        self._commands: dict[str, CommandStatus] = {}
        self._ids: dict[tuple[str, Identity], str] = {}

    def restore(self, commands: Iterable[CommandStatus]) -> None:
        """Add commands of a former run, oldest first."""
        for command in commands:
            self._set(command)

    def get(self, name: str) -> CommandStatus | None:
        """Return the status of a command by its id; None if unknown."""
        return self._commands.get(name)

    def begin(self, command: CommandStatus) -> None:
        """Add a command that is about to be sent."""
        self._set(command)

    def knows(self, asset: str, identity: Identity) -> bool:
        """Whether a command is known by its source and number."""
        return (asset, identity) in self._ids

    def take_in(self, kept: CommandStatus) -> None:
        """Merge the archived state of a command, which another console may have written."""
        name = self._ids.get((kept.asset, Identity(kept.source, kept.number)))
        before = None if name is None else self._commands[name]
        after = kept if before is None else merge(kept, before)
        if after != before:
            self._set(after)

    def taken(self, name: str, node: str) -> None:
        """Mark the command TAKEN, unless a later stage was reported before."""
        if self._commands[name].state not in LIFE:
            self._reach(name, self._own(TAKEN, node))

    def refused(self, name: str, node: str, why: str) -> None:
        """Mark the command REJECTED after an error answer of the other end of the link."""
        if not self._has(name, REJECTED):
            self._reach(name, self._own(REJECTED, node, why))

    def doubt(self, name: str, why: str) -> None:
        """Mark a command UNKNOWN, unless it has ended."""
        command = self._commands[name]
        if not command.ended and command.state is not CommandState.UNKNOWN:
            self._reach(name, self._own(UNKNOWN, CONSOLE, why))

    def doubt_all(self, asset: str, why: str) -> None:
        """Mark all open commands of an asset UNKNOWN."""
        for command in tuple(self._commands.values()):
            if command.asset == asset:
                self.doubt(command.id, why)

    def hear(self, said: Notified, identity: Identity) -> str:
        """Apply a notification to its command; return the command's id."""
        name = self._name_of(said, identity)
        command = self._commands[name]
        if not command.name and said.stage == RECEIVED:
            self._keep(replace(command, name=said.text))
        stage = PREDICTED if said.stage is None else said.stage
        self._reach(
            name,
            StageEntry(
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

    def hear_orbiter(self, said: Notified, identity: Identity, stage: str) -> str:
        """Apply an orbiter's notification to its command; return the command's id."""
        name = self._name_of(said, identity)
        if not self._has(name, stage):
            self._reach(name, StageEntry(stage, ORBITER, said.utc, said.rx, said.text))
        return name

    async def run(self) -> None:
        """Check the deadlines of commands periodically."""
        while True:
            await asyncio.sleep(CHECK_S)
            self.check()

    def check(self) -> None:
        """Mark commands without a report in time UNKNOWN."""
        now_s = self._utc()
        for command in tuple(self._commands.values()):
            if command.deadline is not None and now_s > command.deadline:
                self.doubt(command.id, f"no report for {HEARD_WITHIN_S:g} s")

    def _own(self, stage: str, node: str, detail: str = "") -> StageEntry:
        now_s = self._utc()
        return StageEntry(stage, node, now_s, now_s, detail)

    def _has(self, name: str, stage: str) -> bool:
        return any(each.stage == stage for each in self._commands[name].history)

    def _reach(self, name: str, reached: StageEntry) -> None:
        before = self._commands[name]
        after = reach(before, reached)
        if after is not before:
            self._set(after)

    def _name_of(self, said: Notified, identity: Identity) -> str:
        """Return the id of a notification's command; a command of another client gets a new id."""
        name = self._ids.get((said.asset, identity))
        if name is None:
            name = f"{said.asset}:{identity}"
            self._keep(self._foreign(name, said, identity))
        return name

    def _foreign(self, name: str, said: Notified, identity: Identity) -> CommandStatus:
        return CommandStatus(
            id=name,
            asset=said.asset,
            name="",
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
        identity = Identity(command.source, command.number)
        former = self._ids.get((command.asset, identity), command.id)
        if former != command.id:  # received before its sender was known
            del self._commands[former]
        self._commands[command.id] = command
        self._ids[command.asset, identity] = command.id
        if len(self._commands) > MOST:
            dropped = next((each for each in self._commands.values() if each.ended), command)
            del self._commands[dropped.id]
            del self._ids[dropped.asset, Identity(dropped.source, dropped.number)]
