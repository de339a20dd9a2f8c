"""`CommandTracker`: life cycle of all consoles' commands, merged from the reports of all links.

A command ends only by a notification. Without one in time its state is UNKNOWN, until the next
notification.
"""

import asyncio
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, Final

from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive import (
    POLL_S,
    Archive,
    changed_commands,
    find_command,
    last_commands,
    last_revision,
    read_command,
)
from adapters.console.command_states import (
    ACKNOWLEDGED,
    ACTIVE,
    CONSOLE,
    LIFECYCLE_STATES,
    ORBITER,
    PREDICTED,
    RECEIVED,
    REJECTED,
    SENT,
    UNKNOWN,
    apply_stage,
    merge,
)
from adapters.console.messages import (
    CommandState,
    CommandStatus,
    LinkKind,
    NotificationMessage,
    StageEntry,
)
from executive.commands import Command
from executive.values.reports import Identity

REPORT_TIMEOUT_S: Final = 10.0
"""Timeout for the first report on a sent command, beyond the declared round-trip time of the link,
and for a lost link, s; chosen, not measured."""
CHECK_S: Final = 1.0
MAX_COMMANDS: Final = 5000
"""Maximum number of tracked commands; beyond it the earliest ended ones are dropped."""


def sent_status(
    name: str,
    asset: str,
    by: str,
    link: LinkKind,
    command: Command,
    args: dict[str, Any],
    round_trip_s: float = 0.0,
) -> CommandStatus:
    """Return the status of a command that is about to be sent.

    Args:
        name: its id.
        asset: its asset.
        by: its operator.
        link: link over which it is sent.
        command: the command, with its creation time.
        args: its posted arguments.
        round_trip_s: declared round-trip time of the link.
    """
    now_s = command.created_utc_s
    assert now_s is not None, "a command of the console has its creation time"
    return CommandStatus(
        id=name,
        asset=asset,
        name=command.name,
        args=args,
        by=by,
        source=command.identity.source,
        number=command.identity.command_id,
        link=link,
        state=CommandState.SENDING,
        ended=False,
        created=now_s,
        deadline=now_s + REPORT_TIMEOUT_S + round_trip_s,
        history=(StageEntry(SENT, CONSOLE, now_s, now_s, f"by {by}"),),
    )


def foreign_status(
    name: str, asset: str, identity: Identity, link: LinkKind, created: float
) -> CommandStatus:
    """Return the first status of a command of another client, without its name and arguments.

    Args:
        name: its id.
        asset: its asset.
        identity: its source and number.
        link: link over which it was reported.
        created: time of the first report, s since 1970 UTC.
    """
    return CommandStatus(
        id=name,
        asset=asset,
        name="",
        args=None,
        by=identity.source,
        source=identity.source,
        number=identity.command_id,
        link=link,
        state=CommandState.SENDING,
        ended=False,
        created=created,
        deadline=None,
        history=(),
    )


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
        self._lost_since: dict[str, float] = {}

    def restore(self, commands: Iterable[CommandStatus]) -> None:
        """Add commands of a former run, oldest first."""
        for command in commands:
            self._set(command)

    def get(self, name: str) -> CommandStatus | None:
        """Return the status of a command by its id; None if unknown."""
        return self._commands.get(name)

    def register(self, command: CommandStatus) -> None:
        """Add a command that is about to be sent."""
        self._set(command)

    def knows(self, asset: str, identity: Identity) -> bool:
        """Whether a command is known by its source and number."""
        return (asset, identity) in self._ids

    def merge(self, stored: CommandStatus) -> None:
        """Merge the archived state of a command, which another console may have written."""
        name = self._ids.get((stored.asset, Identity(stored.source, stored.number)))
        before = None if name is None else self._commands[name]
        after = stored if before is None else merge(stored, before)
        if after != before:
            self._set(after)

    def add_arguments(self, asset: str, identity: Identity, args: dict[str, Any]) -> None:
        """Add the arguments of a command that another client sent."""
        command = self._commands.get(self._ids.get((asset, identity), ""))
        if command is not None and command.args is None:
            self._set(replace(command, args=args))

    def on_acknowledged(self, name: str, node: str) -> None:
        """Mark the command ACKNOWLEDGED, unless a later stage was reported before."""
        if self._commands[name].state not in LIFECYCLE_STATES:
            self._reach(name, self._own_stage(ACKNOWLEDGED, node))

    def on_rejected(self, name: str, node: str, why: str) -> None:
        """Mark the command REJECTED after an error answer of the other end of the link."""
        if not self._has(name, REJECTED):
            self._reach(name, self._own_stage(REJECTED, node, why))

    def mark_unknown(self, name: str, why: str) -> None:
        """Mark a command UNKNOWN, unless it has ended."""
        command = self._commands[name]
        if not command.ended and command.state is not CommandState.UNKNOWN:
            self._reach(name, self._own_stage(UNKNOWN, CONSOLE, why))

    def mark_all_unknown(self, asset: str, why: str) -> None:
        """Mark all open commands of an asset UNKNOWN."""
        for command in tuple(self._commands.values()):
            if command.asset == asset:
                self.mark_unknown(command.id, why)

    def on_links(self, asset: str, *, are_lost: bool) -> None:
        """Receive whether all links of an asset are lost."""
        if are_lost:
            self._lost_since.setdefault(asset, self._utc())
        else:
            self._lost_since.pop(asset, None)

    def on_active(self, asset: str, number: int) -> None:
        """Mark an UNKNOWN command STARTED that an asset reports as active after a lost link."""
        for command in tuple(self._commands.values()):
            found = (command.asset, command.number, command.state)
            if found == (asset, number, CommandState.UNKNOWN):
                self._reach(command.id, self._own_stage(ACTIVE, asset))

    def on_notification(self, notified: NotificationMessage, identity: Identity) -> str:
        """Apply a notification to its command; return the command's id."""
        name = self._name_of(notified, identity)
        command = self._commands[name]
        if not command.name and notified.stage == RECEIVED:
            self._store(replace(command, name=notified.text))
        stage = PREDICTED if notified.stage is None else notified.stage
        self._reach(
            name,
            StageEntry(
                stage=stage,
                node=notified.asset,
                utc=notified.utc,
                rx=notified.rx,
                detail=notified.text,
                code=notified.code,
                step=notified.step,
                steps=notified.steps,
                sequence=notified.sequence,
                figures=notified.figures,
            ),
        )
        return name

    def on_orbiter_notification(
        self, notified: NotificationMessage, identity: Identity, stage: str
    ) -> str:
        """Apply an orbiter's notification to its command; return the command's id."""
        name = self._name_of(notified, identity)
        if not self._has(name, stage):
            self._reach(name, StageEntry(stage, ORBITER, notified.utc, notified.rx, notified.text))
        return name

    async def run(self) -> None:
        """Check the deadlines of commands periodically."""
        while True:
            await asyncio.sleep(CHECK_S)
            self.mark_overdue()

    def mark_overdue(self) -> None:
        """Mark commands UNKNOWN without a report in time, and those of assets without a link."""
        now_s = self._utc()
        for asset, since_s in self._lost_since.items():
            if now_s > since_s + REPORT_TIMEOUT_S:
                self.mark_all_unknown(asset, f"no link for {REPORT_TIMEOUT_S:g} s")
        for command in tuple(self._commands.values()):
            if command.deadline is not None and now_s > command.deadline:
                waited_s = command.deadline - command.created
                self.mark_unknown(command.id, f"no report for {waited_s:g} s")

    def _own_stage(self, stage: str, node: str, detail: str = "") -> StageEntry:
        now_s = self._utc()
        return StageEntry(stage, node, now_s, now_s, detail)

    def _has(self, name: str, stage: str) -> bool:
        return any(each.stage == stage for each in self._commands[name].history)

    def _reach(self, name: str, reached: StageEntry) -> None:
        before = self._commands[name]
        after = apply_stage(before, reached)
        if after is not before:
            self._set(after)

    def _name_of(self, notified: NotificationMessage, identity: Identity) -> str:
        """Return the id of a notification's command; a command of another client gets a new id."""
        name = self._ids.get((notified.asset, identity))
        if name is None:
            name = f"{notified.asset}:{identity}"
            self._store(foreign_status(name, notified.asset, identity, notified.link, notified.utc))
        return name

    def _set(self, command: CommandStatus) -> None:
        self._store(command)
        self._publish(command)

    def _store(self, command: CommandStatus) -> None:
        identity = Identity(command.source, command.number)
        former = self._ids.get((command.asset, identity), command.id)
        if former != command.id:  # received before its sender was known
            del self._commands[former]
        self._commands[command.id] = command
        self._ids[command.asset, identity] = command.id
        if len(self._commands) > MAX_COMMANDS:
            dropped = next((each for each in self._commands.values() if each.ended), command)
            del self._commands[dropped.id]
            del self._ids[dropped.asset, Identity(dropped.source, dropped.number)]


class SharedCommands:
    """Claims commands before they are sent, and merges those of other consoles.

    Args:
        archive: stores the commands.
        tracker: tracks their states.
    """

    def __init__(self, archive: Archive, tracker: CommandTracker) -> None:
        self._archive, self._tracker = archive, tracker
        self._last_revision = 0

    async def restore(self, count: int) -> None:
        """Restore the last commands, and all that have not ended."""
        self._last_revision = await self._archive.read(last_revision)
        self._tracker.restore(await self._archive.read(partial(last_commands, count=count)))

    async def claim(self, command: CommandStatus) -> bool:
        """Store a command; return whether it is new, which permits sending it.

        Raises:
            ArchiveError: the archive cannot be written.
        """
        return await self._archive.claim_command(command)

    async def find(self, name: str) -> CommandStatus | None:
        """Return the status of a command of any console by its id; None if unknown."""
        known = self._tracker.get(name)
        if known is not None:
            return known
        return await self._archive.read(partial(read_command, name=name))

    async def load_foreign(self, asset: str, identity: Identity) -> None:
        """Load a command that another console sent."""
        if self._tracker.knows(asset, identity):
            return
        find = partial(
            find_command, asset=asset, source=identity.source, number=identity.command_id
        )
        with suppress(SQLAlchemyError):  # shown under its source until the archive can be read
            found = await self._archive.read(find)
            if found is not None:
                self._tracker.merge(found)

    async def run(self) -> None:
        """Merge changes of other consoles periodically."""
        while True:
            await asyncio.sleep(POLL_S)
            with suppress(SQLAlchemyError):  # the archive logs that it cannot be written
                await self._refresh()

    async def _refresh(self) -> None:
        changed = partial(changed_commands, since=self._last_revision)
        found, self._last_revision = await self._archive.read(changed)
        for command in found:
            self._tracker.merge(command)
