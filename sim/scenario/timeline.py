"""What of a timeline is due, and the commands of its entries."""

from dataclasses import replace
from math import inf

from executive.commands import Command, PreemptionPolicy
from executive.values.reports import Identity
from sim.scenario.model import Entry, Fix, Repeat, Scenario, Send
from sim.scenario.record import ALMOST_S, Record


class Timeline:
    """Gives out each entry once, as soon as its time has come."""

    def __init__(self, scenario: Scenario, record: Record) -> None:
        self._record = record
        self._waiting = list(scenario.timeline)
        self._times_s: list[float] = []
        self._known: tuple[int, ...] = ()

    def due(self, now_s: float) -> list[Entry]:
        """Return what is to be done now, in the order of the file."""
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
    def looks(self) -> bool:
        """Whether anything waits for the rover to come somewhere."""
        return any(entry.near is not None for entry in self._waiting)

    def next_s(self) -> float:
        """Return the earliest time that is known of an entry; infinite if none is."""
        return min(self._times(), default=inf)

    def _times(self) -> list[float]:
        record = self._record
        known = (len(record.reports), len(record.sendings), len(record.poses) * self.looks)
        if known != self._known:
            self._times_s = [self._time_of(entry) for entry in self._waiting]
            self._known = known
        return self._times_s

    def _time_of(self, entry: Entry) -> float:
        if isinstance(entry, Repeat) and self._record.identity(entry.repeat) is None:
            return inf
        time_s = self._record.moment(entry)
        return inf if time_s is None else time_s


class CommandFactory:
    """Makes the commands of a scenario, and remembers them for repeats.

    They are numbered in the order of the file, where it gives no number.

    Args:
        link: by which commands come that name none.
        speed: seconds of the scenario to one of UTC, in which lifetimes are told.
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
        """Return label and command of an entry; a repeat's is the one that was sent, as it was."""
        if isinstance(entry, Repeat):
            sent = self._sent[entry.repeat]
            return entry.repeat, replace(sent, link=entry.link or sent.link)
        command = Command(
            identity=Identity(entry.source, self._numbers[entry.name]),
            request=entry.command,
            link=entry.link or self._link,
            created_utc_s=utc_s,
            lifetime_s=None if entry.lifetime_s is None else entry.lifetime_s / self._speed,
            arrival=PreemptionPolicy.REPLACE if entry.replace else PreemptionPolicy.APPEND,
        )
        self._sent[entry.name] = command
        return entry.name, command
