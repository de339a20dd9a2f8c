"""What must hold of all stores together, at each kill and in the end."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from executive.commands import MoveForward, RotateBy, Stop
from executive.values.reports import TERMINAL, Identity, Stage
from executive.values.reports import TERMINAL as OUTCOMES
from tests.simulated.disk import rows
from tests.simulated.ground import SOURCE, Journal
from tests.simulated.world import World

_MESSAGE: Final = re.compile(rb"[0-9A-F]{3}\|([^|#]*)\|[^#]*#")
_TERMINAL: Final = frozenset(stage.value for stage in TERMINAL)
_STOP: Final = Stop.__name__
_MOVING: Final = frozenset({MoveForward.__name__, RotateBy.__name__})


@dataclass(frozen=True, slots=True)
class Finding:
    """A promise that is broken.

    Attributes:
        at_s: when it was found.
        what: the promise, the same text for each finding of its kind.
        detail: which command, and where it was.
    """

    at_s: float
    what: str
    detail: str

    def __str__(self) -> str:
        return f"{self.at_s:.3f} s: {self.what}: {self.detail}"


class Stores:
    """The committed content of all stores of one rover and its relay, as a judge reads it.

    Args:
        world: with processes orbiter, relay, executive.
        asset: the rover.
    """

    def __init__(self, world: World, asset: str) -> None:
        orbiter, relay, executive = (
            world.processes[name].stored for name in ("orbiter", "relay", "executive")
        )
        self.up = identities(orbiter / "bundles.sqlite", "outbox", "octets")
        self.landed = identities(relay / "relay.sqlite", "inbox", "payload")
        self.down = identities(relay / "relay.sqlite", "outbox", "octets")
        self.returned = identities(orbiter / "bundles.sqlite", "inbox", "payload")
        self.aboard = ledger_content(executive / "ledger.sqlite")
        self.stored = _stored(executive / "ledger.sqlite")
        self.above = ledger_content(orbiter / f"{asset}.sqlite")


@dataclass(frozen=True, slots=True)
class LedgerContent:
    """Commands of a ledger and its reports.

    Attributes:
        commands: that it knows, with what they are.
        reports: number, identity and stage of each report on a command.
        numbers: of all reports.
    """

    commands: Mapping[Identity, str]
    reports: tuple[tuple[int, Identity, int], ...]
    numbers: tuple[int, ...]

    @property
    def ended(self) -> frozenset[Identity]:
        """Return the commands with a terminal report."""
        return frozenset(identity for _, identity, stage in self.reports if stage in _TERMINAL)


def identities(path: Path, table: str, column: str) -> frozenset[Identity]:
    if not has_table(path, table):
        return frozenset()
    found = set()
    for (octets,) in rows(path, f"SELECT {column} FROM {table}"):
        for message in _MESSAGE.finditer(octets):
            fields = message[0].split(b"|")
            for source in (fields[1], fields[2]):  # of a command, and of a reply
                if source == SOURCE.encode() and fields[8].isdigit():
                    found.add(Identity(SOURCE, int(fields[8])))
    return frozenset(found)


def has_table(path: Path, table: str) -> bool:
    """Return whether a file of SQLite is there and has a table."""
    query = "SELECT 1 FROM sqlite_schema WHERE name = ?"
    return path.exists() and bool(rows(path, query, (table,)))


def ledger_content(path: Path) -> LedgerContent:
    if not has_table(path, "reports"):
        return LedgerContent({}, (), ())
    commands = rows(path, "SELECT source, command_id, name FROM commands")
    reports = rows(path, "SELECT sequence, source, command_id, stage FROM reports")
    return LedgerContent(
        {Identity(source, number): name for source, number, name in commands},
        tuple((n, Identity(s, i), g) for n, s, i, g in reports if s is not None and g is not None),
        tuple(sorted(row[0] for row in reports)),
    )


def _stored(path: Path) -> int:
    if not has_table(path, "relay_notification_ack"):
        return 0
    found = rows(path, "SELECT sequence FROM relay_notification_ack")
    return int(found[0][0]) if found else 0


def check_stores(world: World, asset: str, journals: Mapping[str, Journal]) -> Iterator[Finding]:
    """Check the stores at any moment.

    Args:
        world: with the stores.
        asset: the rover.
        journals: of the ground's processes.
    """
    stores, now_s, relay = Stores(world, asset), world.now_s, journals["moe"]
    somewhere = (
        stores.up | stores.landed | stores.down | stores.returned
        | stores.aboard.commands.keys() | stores.above.ended
    )  # fmt: skip
    for identity in relay.acknowledged:
        if identity not in somewhere:
            what = "a command that the orbiter acknowledged is in no store"
            yield Finding(now_s, what, f"{identity}")
        if identity not in stores.up and identity not in stores.above.commands:
            what = "a command that the orbiter acknowledged is not in its record"
            yield Finding(now_s, what, f"{identity}")
    # What comes again is answered with its end, and is kept at the rover's end until then.
    reported = stores.down | stores.returned | stores.above.ended | stores.up | stores.landed
    for number, identity, stage in stores.aboard.reports:
        confirmed = number <= stores.stored and identity in relay.acknowledged
        if stage in _TERMINAL and confirmed and identity not in reported:
            yield Finding(now_s, "an end that the relay confirmed is in no store", f"{identity}")
    yield from _check_ledger(now_s, stores.aboard)
    if _stops_are_ordered(world):
        yield from _check_stops(now_s, stores.aboard, relay, journals["direct"])


def _check_ledger(now_s: float, ledger: LedgerContent) -> Iterator[Finding]:
    numbers = ledger.numbers
    if numbers and numbers[-1] - numbers[0] + 1 != len(numbers):
        yield Finding(now_s, "numbers of reports have gaps", f"{numbers[0]} to {numbers[-1]}")
    counts: dict[tuple[Identity, str], int] = {}
    for _, identity, stage in ledger.reports:
        what = "end" if stage in _TERMINAL else Stage(stage).name
        counts[identity, what] = counts.get((identity, what), 0) + 1
    for (identity, what), count in counts.items():
        if count > 1 and what != Stage.PROGRESS.name:
            yield Finding(now_s, "a command has two reports of one stage", f"{identity} {what}")


def _stops_are_ordered(world: World) -> bool:
    """Return whether the relay can tell what was made before a stop: by one clock, on its disk."""
    orbiter, relay = world.processes["orbiter"], world.processes["relay"]
    return not (orbiter.stepped or relay.stepped or relay.disk.unwritten)


def _check_stops(
    now_s: float, ledger: LedgerContent, relay: Journal, direct: Journal
) -> Iterator[Finding]:
    """Check that nothing moves the rover after a stop that was asked for later, by the relay.

    What went by the direct link as well is left out: it overtakes what went by the relay.
    """
    stops: list[Identity] = []
    for _, identity, stage in sorted(ledger.reports):
        if identity in direct.sent or identity not in relay.sent:
            continue
        name = ledger.commands.get(identity)
        if name == _STOP and stage == Stage.RECEIVED.value:
            stops.append(identity)
        elif name in _MOVING and stage == Stage.STARTED.value:
            taken_s = relay.acknowledged.get(identity, now_s)
            for stop in stops:
                if taken_s < relay.sent[stop]:
                    what = "a command started after a stop that was asked for later"
                    yield Finding(now_s, what, f"{identity}, {stop}")


def check_end(world: World, asset: str, journals: Mapping[str, Journal]) -> Iterator[Finding]:
    """Check what the ground knows after all faults are over.

    Args:
        world: after a quiet time.
        asset: the rover.
        journals: of the ground's processes.
    """
    yield from check_stores(world, asset, journals)
    yield from check_known(world, journals)


def check_known(world: World, journals: Mapping[str, Journal]) -> Iterator[Finding]:
    """Check that each command has one end for the ground, and that nothing raised."""
    now_s = world.now_s
    ends: dict[Identity, set[str]] = {}
    for name, journal in journals.items():
        yield from _check_numbers(now_s, name, journal)
        for report in journal.received:
            if report.stage in OUTCOMES and report.identity is not None:
                ends.setdefault(report.identity, set()).add(report.stage.name)
        for identity in journal.sent:
            if identity not in journal.refused and identity not in journal.ends:
                what = "a command has no end for the ground"
                yield Finding(now_s, what, f"{identity} by {name}")
        for identity, stages in journal.ends.items():
            ends.setdefault(identity, set()).update(stages)
    for identity, known in ends.items():
        if len(known) > 1:
            yield Finding(now_s, "a command has two ends", f"{identity}: {sorted(known)}")
    for error in world.errors:
        text = f"{error.process}: {error.text}: {error.fault!r}"
        yield Finding(error.at_s, "a process let an exception go", text)


def _check_numbers(now_s: float, name: str, journal: Journal) -> Iterator[Finding]:
    """Check that no report that was published has the number of another."""
    known: dict[int, tuple[object, ...]] = {}
    for each in journal.received:
        message = (each.kind, each.identity, each.stage)
        if each.sequence and known.setdefault(each.sequence, message) != message:
            what = "two reports were published under one number"
            yield Finding(now_s, what, f"{each.sequence} by {name}")
