"""`Timeline` of a scenario: which entries are due, and the commands that they send."""

from collections.abc import Collection
from dataclasses import replace
from math import inf

from executive.commands import Command, Precondition, PreemptionPolicy
from executive.values.reports import Identity
from sim.scenario.model import Entry, Fix, Repeat, Scenario, Send
from sim.scenario.record import ALMOST_S, Record


class Timeline:
    """Timeline of a run; returns each entry once, when it is due."""

    def __init__(self, scenario: Scenario, record: Record) -> None:
        self._record = record
        self._waiting = list(scenario.timeline)
        self._times_s: list[float] = []
        self._known: tuple[int, ...] = ()

    def leave_out(self, indexes: Collection[int]) -> None:
        """Leave out entries by their index in the timeline: they were carried out before."""
        self._waiting = [each for at, each in enumerate(self._waiting) if at not in indexes]

    def due(self, now_s: float) -> list[Entry]:
        """Return the entries that are due, in the order of the file."""
        found = [
            entry
            for entry, time_s in zip(self._waiting, self._times(), strict=True)
            if time_s <= now_s + ALMOST_S
        ]
        if found:
            self._waiting = [entry for entry in self._waiting if entry not in found]
            self._known = ()
        return found

    @property
    def has_position_triggers(self) -> bool:
        """Whether an entry depends on the rover's position."""
        return any(entry.near is not None for entry in self._waiting)

    def next_s(self) -> float:
        """Return the earliest known due time of an entry; infinite if none is known."""
        return min(self._times(), default=inf)

    def _times(self) -> list[float]:
        record = self._record
        known = (
            len(record.reports),
            len(record.sendings),
            len(record.poses) * self.has_position_triggers,
        )
        if known != self._known:
            self._times_s = [self._time_of(entry) for entry in self._waiting]
            self._known = known
        return self._times_s

    def _time_of(self, entry: Entry) -> float:
        if isinstance(entry, Repeat) and self._record.identity(entry.repeat) is None:
            return inf
        time_s = self._record.resolve_time(entry)
        return inf if time_s is None else time_s


class CommandFactory:
    """Creates the commands of a scenario, and stores them for repeats.

    Commands without a number in the file are numbered in the order of the file.

    Args:
        link: link of the commands that name none.
        speed: seconds of the scenario per second of UTC, the unit of lifetimes.
    """

    def __init__(self, scenario: Scenario, link: str, speed: float = 1.0) -> None:
        self._link, self._speed = link, speed
        sends = [entry for entry in scenario.timeline if isinstance(entry, Send | Fix)]
        self._numbers = {
            send.name: position if isinstance(send, Fix) or send.id is None else send.id
            for position, send in enumerate(sends, 1)
        }
        self._sent: dict[str, Command] = {}

    def command(self, entry: Send | Repeat, utc_s: float) -> tuple[str, Command]:
        """Return label and command of an entry; for a repeat, of the command that was sent."""
        if isinstance(entry, Repeat):
            sent = self._sent[entry.repeat]
            return entry.repeat, replace(sent, link=entry.link or sent.link)
        command = Command(
            identity=Identity(entry.source, self._numbers[entry.name]),
            request=entry.command,
            link=entry.link or self._link,
            created_utc_s=utc_s,
            lifetime_s=None if entry.lifetime_s is None else entry.lifetime_s / self._speed,
            preemption=PreemptionPolicy.REPLACE if entry.replace else PreemptionPolicy.APPEND,
            precondition=Precondition(
                entry.only_at,
                None if entry.only_after is None else self._number(entry.only_after),
                entry.only_mode,
            )
            or None,
        )
        self._sent[entry.name] = command
        return entry.name, command

    def _number(self, label: str) -> int:
        """Return the number of a command; in forks also of one that was not sent, as `MOE:9`."""
        identity = Identity.parse(label)
        if label in self._numbers or identity is None:
            return self._numbers[label]
        return identity.command_id
