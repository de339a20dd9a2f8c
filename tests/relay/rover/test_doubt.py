"""What a kill leaves in doubt: a command that may have been published comes to the rover once."""

import asyncio
import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from adapters.bundle.codec.errors import StoreFull
from adapters.bundle.node.database import Database
from adapters.mops.codec import Message
from adapters.mops.reports import reply_of
from adapters.relay.rover.bridge import BundleBridge
from adapters.relay.rover.doubt import (
    FULL_S,
    LONGEST_S,
    SAID_S,
    SILENT_S,
    Doubt,
)
from executive.commands.catalogue import Stop
from executive.reports import Identity, Kind, Report, Severity, Stage
from tests.relay.rover.test_link import (
    ROVER,
    Ends,
    Rover,
    command,
    octets,
    until,
)
from tests.relay.rover.test_tray import DICTIONARY, event

WINDOW = 50


@pytest.fixture
def ends(tmp_path: Path) -> Ends:
    return Ends(tmp_path)


def reply(sequence: int, number: int) -> Message:
    report = Report(
        sequence,
        1.0,
        Kind.COMMAND,
        Severity.INFORMATIONAL,
        "",
        Identity("MOE", number),
        Stage.EXECUTED,
        "relay",
    )
    return reply_of(report, DICTIONARY.entry_of(command(number).code), "JACKAL")


def undelivered(folder: Path) -> int:
    """Return how many bundles are on the disk that do not count as delivered."""
    with closing(sqlite3.connect(f"file:{folder / 'relay.db'}?mode=ro", uri=True)) as db:
        ((count,),) = db.execute("SELECT count(*) FROM inbox").fetchall()
    return int(count)


def arrive(ends: Ends, *commands: Message) -> None:
    """Have commands in the relay's store, of which nobody knows whether they were published."""
    ends.rover.there.clear()
    link = ends.link()
    link.start()

    async def send() -> None:
        async with ends.orbiter() as orbiter:
            for each in commands:
                await orbiter.send(ROVER, octets(each))
            await until(lambda: undelivered(ends.folder) == len(commands))

    asyncio.run(send())
    link.close()


@contextmanager
def begun_again(ends: Ends) -> Iterator[BundleBridge]:
    """Run the relay with a rover that listens."""
    ends.rover.there.set()
    link = ends.link()
    link.start()
    try:
        yield link
    finally:
        link.close()


class TellingRover(Rover):
    """Tells something when it hears that a report is kept, and looks what is delivered then."""

    def __init__(self, folder: Path, tell: Callable[[int], None]) -> None:
        super().__init__()
        self._folder, self._tell = folder, tell
        self.undelivered: dict[int, int] = {}
        self.undelivered_at: list[int] = []

    def command(self, text: str, answered: Callable[[], bool]) -> bool:
        self.undelivered_at.append(undelivered(self._folder))
        return super().command(text, answered)

    def kept(self, sequence: int) -> None:
        super().kept(sequence)
        self.undelivered[sequence] = undelivered(self._folder)
        self._tell(sequence)


def test_the_rover_is_heard_to_its_end_though_a_full_disk_keeps_it_from_saying_more(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrive(ends, command(1))

    def tell(sequence: int) -> None:
        if sequence == WINDOW:
            link.notify(str(reply(WINDOW + 1, 1)))

    ends.rover = TellingRover(ends.folder, tell)
    with monkeypatch.context() as disk:
        disk.setattr(os, "statvfs", lambda _: os.statvfs_result((4096, 4096) + (0,) * 8))
        with begun_again(ends) as link:
            link.notify("".join(str(event(number)) for number in range(1, WINDOW + 1)))
            asyncio.run(until(lambda: link.refused > 1.5 * WINDOW))
            disk.undo()
            asyncio.run(until(lambda: len(ends.rover.numbers) == WINDOW + 1))
    assert ends.rover.commands == []
    assert undelivered(ends.folder) == 0


def test_no_answer_counts_as_kept_before_its_command_counts_as_delivered(ends: Ends) -> None:
    arrive(ends, command(1), command(2))
    rover = ends.rover = TellingRover(ends.folder, lambda _: None)
    with begun_again(ends) as link:
        for report in (event(6), reply(7, 1), event(8)):
            link.notify(str(report))
        asyncio.run(until(lambda: len(rover.numbers) == 3 and len(rover.commands) == 1))
    assert rover.numbers == [6, 7, 8]
    assert rover.undelivered[6] == 2
    assert rover.undelivered[7] < 2
    assert rover.commands == [str(command(2))]


def test_a_stop_waits_for_nothing_that_the_rover_may_have_to_say(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = DICTIONARY.command(Stop(), Identity("MOE", 1), "JACKAL")
    arrive(ends, stop)
    monkeypatch.setattr(Doubt, "lasts", lambda *_, **__: True)
    with begun_again(ends):
        asyncio.run(until(lambda: undelivered(ends.folder) == 0))
    assert ends.rover.commands == [str(stop)]


def test_only_one_command_is_in_doubt_whatever_the_disk_refuses(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrive(ends, command(1), command(2), command(3))
    rover = ends.rover = TellingRover(ends.folder, lambda _: None)
    commit, refused = Database.commit, list[Database]()

    def refuse(database: Database) -> None:
        if rover.commands and len(refused) < 5:
            refused.append(database)
            raise StoreFull("database or disk is full")
        commit(database)

    monkeypatch.setattr(Database, "commit", refuse)
    with begun_again(ends) as link:
        link.notify(str(event(1)))
        asyncio.run(until(lambda: undelivered(ends.folder) == 0))
    assert len(refused) == 5
    assert rover.commands == [str(command(number)) for number in (1, 2, 3)]
    assert rover.undelivered_at == [3, 2, 1]


def test_a_rover_that_says_nothing_has_nothing_to_say() -> None:
    doubt = Doubt(100.0)
    assert doubt.lasts(100.0 + 0.9 * SILENT_S, storing=False)
    assert not doubt.lasts(100.0 + SILENT_S, storing=False)


def test_a_rover_has_said_all_when_all_is_kept_and_it_says_no_more() -> None:
    doubt = Doubt(100.0)
    doubt.said(101.0)
    assert doubt.lasts(101.0 + 0.9 * SAID_S, storing=False)
    kept_s = 100.0 + 0.9 * FULL_S
    assert doubt.lasts(kept_s, storing=True)
    assert doubt.lasts(kept_s + 0.9 * SAID_S, storing=False)
    doubt.said(kept_s + 1.0)
    assert doubt.lasts(kept_s + 1.0 + 0.9 * SAID_S, storing=False)
    assert not doubt.lasts(kept_s + 1.0 + SAID_S, storing=False)


def test_a_disk_that_stays_full_does_not_hold_back_a_command_for_ever() -> None:
    doubt = Doubt(100.0)
    assert doubt.lasts(100.0 + 0.9 * FULL_S, storing=True)
    assert not doubt.lasts(100.0 + FULL_S, storing=True)


def test_a_rover_that_never_pauses_is_not_heard_for_ever() -> None:
    doubt, now_s = Doubt(100.0), 100.0
    while doubt.lasts(now_s, storing=False):
        now_s += SAID_S / 4
        doubt.said(now_s)
    assert now_s == pytest.approx(100.0 + LONGEST_S)
