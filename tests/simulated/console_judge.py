"""What must hold of a console: of its archive, of what it sent, and of what its page shows."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from adapters.console.command_states import ACKNOWLEDGED
from adapters.console.messages import TERMINAL_STATES, CommandState
from executive.commands import Stop
from executive.values.reports import TERMINAL, Identity, Stage
from tests.simulated.console import OPERATOR, PageJournal
from tests.simulated.disk import rows
from tests.simulated.judge import Finding, has_table, ledger_content
from tests.simulated.world import World

_STOP: Final = Stop.__name__
_ENDS: Final = {state.value for state in TERMINAL_STATES}
_OVER: Final = _ENDS | {CommandState.UNKNOWN.value, CommandState.LOST.value}
_WRITTEN_WITHIN_S: Final = 2.0
"""What a console publishes is in its archive within this, if it lives so long."""
_ACTIVE_S: Final = 0.1
"""How long an answer takes to the page at most."""
_ABOARD: Final = "SELECT sequence, utc_s, text FROM reports ORDER BY sequence"
_ABOVE: Final = (
    "SELECT cursor, utc_s, text FROM recorded JOIN reports ON number = sequence ORDER BY cursor"
)
Notified = tuple[int, int, str]
"""Cursor, time in ms, as MAL has it, and text of a notification."""


@dataclass(frozen=True, slots=True)
class Stored:
    """A command as the archive has it.

    Attributes:
        id: by which it was posted.
        state: how it stands.
        stages: that it reached, as they were received.
        ends: those in which it ended by notifications; an answer is none.
    """

    id: str
    state: str
    stages: tuple[str, ...]
    ends: frozenset[str]


class ConsoleJudge:
    """Checks a console at each kill and in the end.

    Args:
        world: with processes console, orbiter, executive.
        asset: the rover.
        journal: of the page.
    """

    def __init__(self, world: World, asset: str, journal: PageJournal) -> None:
        self._world, self._asset, self._journal = world, asset, journal
        self._ended: dict[str, str] = {}
        self._killed_s: list[float] = []

    def killed(self) -> None:
        """Know that the console is killed now."""
        self._killed_s.append(self._world.now_s)

    def check(self) -> Iterator[Finding]:
        """Check at any moment what is committed to the archive."""
        now_s, stored = self._world.now_s, self._commands()
        for name, identity in self._journal.acknowledged.items():
            if identity not in stored or stored[identity].id != name:
                what = "a command that the console acknowledged is not in its archive"
                yield Finding(now_s, what, f"{name}: {identity}")
        for identity, name in ledger_content(self._executive).commands.items():
            if identity.source != OPERATOR or name == _STOP:
                continue
            if identity not in stored:
                what = "the console sent a command that is not in its archive"
                yield Finding(now_s, what, f"{identity}")
            elif stored[identity].id not in self._journal.posted:
                what = "the console sent a command that nobody posted"
                yield Finding(now_s, what, f"{identity}: {stored[identity]}")
        for command in stored.values():
            before = self._ended.setdefault(command.id, command.state) if command.ends else None
            if len(command.ends) > 1 or before not in {None, command.state}:
                what = "a command has two ends in the archive"
                yield Finding(now_s, what, f"{command}, before {before}")
        for link, known in self._notifications().items():
            yield from self._check_order(link, known)

    def check_end(self) -> Iterator[Finding]:
        """Check that after all faults are over the archive has all, and the page shows it."""
        yield from self.check()
        now_s, stored = self._world.now_s, self._commands()
        for link, known in self._notifications().items():
            if (missing := len(self._recorded(link)) - len(known)) > 0:
                what = "notifications are not in the archive"
                yield Finding(now_s, what, f"{missing} by the {link} link")
        aboard = ledger_content(self._executive)
        ends = {
            each: Stage(stage).name for _, each, stage in aboard.reports if Stage(stage) in TERMINAL
        }
        for identity in (*ends, *self._journal.acknowledged.values()):
            yield from self._check_command(identity, stored.get(identity), ends.get(identity))
        for identity, at_s in self._journal.stops.items():
            if identity not in stored and not self._was_killed(at_s):
                what = "a stop that the console acknowledged is not in its archive"
                yield Finding(now_s, what, f"{identity}")
        for identity, state in self._page_differs(stored):
            what = "the page shows another state of a command than the archive has"
            yield Finding(now_s, what, f"{identity}: {state}, {stored.get(identity)}")

    @property
    def settled(self) -> bool:
        """Return whether nothing more is to be expected."""
        stored = self._commands()
        return (
            all(each.state in _OVER for each in stored.values())
            and not any(self._page_differs(stored))
            and all(len(self._recorded(k)) <= len(v) for k, v in self._notifications().items())
        )

    def _check_command(
        self, identity: Identity, stored: Stored | None, end: str | None
    ) -> Iterator[Finding]:
        state = None if stored is None else stored.state
        if end is not None and state != end.lower():
            what = "the archive has another end of a command than the ledger"
            yield Finding(self._world.now_s, what, f"{identity}: {end}, {stored}")
        elif stored is None or state not in _OVER:
            what = "a command has no end in the archive"
            yield Finding(self._world.now_s, what, f"{identity}: {stored}")
        elif state == CommandState.UNKNOWN.value and ACKNOWLEDGED in stored.stages:
            what = "the console does not know the end of a command that the other end had taken"
            yield Finding(self._world.now_s, what, f"{identity}: {stored}")

    def _page_differs(
        self, stored: Mapping[Identity, Stored]
    ) -> Iterator[tuple[Identity, str | None]]:
        """Yield those of the operator's commands that the page shows otherwise than they are."""
        for identity in self._journal.acknowledged.values():
            shown = self._journal.states.get(identity)
            if identity in stored and shown != stored[identity].state:
                yield identity, shown

    def _check_order(self, link: str, known: list[Notified]) -> Iterator[Finding]:
        cursors = [cursor for cursor, _, _ in known]
        if cursors != list(range(1, len(cursors) + 1)):
            at = next(n for n, each in enumerate(cursors, start=1) if n != each)
            what = "notifications in the archive have gaps, or are not in the order of the cursor"
            text = f"{link}: after {at - 1} come {cursors[at - 1 : at + 5]} of {len(cursors)}"
            yield Finding(self._world.now_s, what, text)
        recorded = {each[0]: each for each in self._recorded(link)}
        for each in known:
            cursor, at_ms, text = recorded.get(each[0], (0, 0, ""))
            if cursor != each[0] or text != each[2] or abs(at_ms - each[1]) > 1:  # rounded
                what = "a notification in the archive is not one of its sender"
                text = f"{link}: {each}, {recorded.get(each[0])}"
                yield Finding(self._world.now_s, what, text)

    def _was_killed(self, at_s: float) -> bool:
        """Whether the console was killed before it had to have written what came at a time."""
        return any(
            -_ACTIVE_S <= killed_s - at_s <= _WRITTEN_WITHIN_S for killed_s in self._killed_s
        )

    @property
    def _executive(self) -> Path:
        return self._world.processes["executive"].stored / "ledger.sqlite"

    @property
    def _archive(self) -> Path:
        return self._world.processes["console"].stored / "archive.sqlite"

    def _recorded(self, link: str) -> list[Notified]:
        """Return what the other end of a link recorded."""
        if link == "direct":
            path, query = self._executive, _ABOARD
        else:
            path = self._world.processes["orbiter"].stored / f"{self._asset}.sqlite"
            query = _ABOVE
        if not has_table(path, "reports"):
            return []
        return [(cursor, round(utc_s * 1e3), text) for cursor, utc_s, text in rows(path, query)]

    def _notifications(self) -> dict[str, list[Notified]]:
        """Return what the archive has by each link, in the order in which it was written."""
        found: dict[str, list[Notified]] = {"direct": [], "relay": []}
        if has_table(self._archive, "notification"):
            query = "SELECT link, cursor, utc_us, body FROM notification WHERE cursor ORDER BY id"
            for link, cursor, utc_us, body in rows(self._archive, query):
                found[link].append((cursor, utc_us // 1000, json.loads(body)["text"]))
        return found

    def _commands(self) -> dict[Identity, Stored]:
        if not has_table(self._archive, "command"):
            return {}
        query = "SELECT source, number, id, body FROM command ORDER BY id"
        return {
            Identity(source, number): _stored(name, json.loads(body))
            for source, number, name, body in rows(self._archive, query)
        }


def _stored(name: str, body: dict[str, Any]) -> Stored:
    history = body["history"]
    notified = (each["stage"] for each in history if each["sequence"] is not None)
    ends = frozenset(stage for stage in notified if stage.lower() in _ENDS)
    return Stored(name, body["state"], tuple(each["stage"] for each in history), ends)
