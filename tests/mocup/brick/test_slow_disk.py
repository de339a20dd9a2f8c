"""While the brick's record is synced, replies and acknowledgements wait; a stop does not."""

import errno
from pathlib import Path

import pytest

from adapters.mocup.brick.record import BrickCommand, BrickLink, BrickRecord
from adapters.mocup.brick.service import MAX_INBOX, BrickService, DurableOutput
from adapters.mops import Message, fingerprint
from tests.mocup.brick.routing import (
    STOP,
    Bench,
    forward,
    received,
    stop,
)
from tests.support.unsynced import UNSYNCED, HeldDisk, Unsynced


class FailingDisk(Unsynced):
    """Syncs fail while it is faulty."""

    faulty = False

    def sync(self, database: Path) -> None:
        if self.faulty:
            raise OSError(errno.EIO, "Input/output error")


class Output:
    """Output of a record. The test ends its syncs."""

    def __init__(self, record: BrickRecord) -> None:
        self.record = record
        self.published: list[Message | int] = []
        self.syncs = 0
        self.log: list[str] = []
        self.gate = DurableOutput(
            record,
            STOP.code,
            lambda _, each: self.published.append(each),
            self._sync,
            self.log.append,
        )
        self.gate.sync()
        self.synced()

    def _sync(self) -> None:
        self.syncs += 1

    def synced(self) -> None:
        try:
            self.record.sync()
        except OSError as error:
            self.gate.on_synced(error)
        else:
            self.gate.on_synced(None)


@pytest.fixture
def output() -> Output:
    return Output(BrickRecord(system=UNSYNCED))


def save(record: BrickRecord, number: int) -> Message:
    record.save(BrickCommand(forward(number), (BrickLink.RELAY,)))
    return received(forward(number))


def test_output_waits_for_the_commits_before_it_only(output: Output) -> None:
    output.gate.put(BrickLink.RELAY, 7)
    first = save(output.record, 1)
    output.gate.put(BrickLink.RELAY, first)
    assert (output.published, output.syncs) == ([7], 2)
    output.record.sync()
    second = save(output.record, 2)
    output.gate.put(BrickLink.RELAY, second)
    output.gate.on_synced(None)
    assert (output.published, output.syncs) == ([7, first], 3)
    output.synced()
    assert output.published == [7, first, second]
    assert output.syncs == 3


def test_the_executive_is_notified_of_a_stop_at_once(output: Output) -> None:
    save(output.record, 1)
    for link in BrickLink:
        output.gate.put(link, received(stop(2)))
    assert output.published == [received(stop(2))]
    output.synced()
    assert output.published == 2 * [received(stop(2))]


def test_what_waits_is_bounded_and_not_repeated(output: Output) -> None:
    save(output.record, 1)
    for number in range(MAX_INBOX + 1):
        for _ in range(2):
            output.gate.put(BrickLink.RELAY, number)
    assert output.published == []
    output.synced()
    assert output.published == list(range(MAX_INBOX))


def test_output_waits_until_a_sync_succeeds(tmp_path: Path) -> None:
    disk = FailingDisk()
    output = Output(BrickRecord(tmp_path / "nxt.sqlite", disk))
    disk.faulty = True
    output.gate.put(BrickLink.RELAY, save(output.record, 1))
    output.synced()
    assert (output.published, output.syncs) == ([], 2)
    assert output.log == [f"{tmp_path / 'nxt.sqlite'}: [Errno 5] Input/output error"]
    disk.faulty = False
    output.gate.sync()
    output.synced()
    assert (len(output.published), output.syncs, len(output.log)) == (1, 3, 1)


def test_commits_of_an_earlier_process_are_not_durable_yet(
    tmp_path: Path,
) -> None:
    record = BrickRecord(tmp_path / "nxt.sqlite", HeldDisk())
    assert record.durable < record.sealed


def test_a_string_is_acknowledged_once_its_command_is_synced(output: Output, bench: Bench) -> None:
    bench.start(output.record)
    service = BrickService(bench.router, output.gate.put, confirmed=True)
    text = str(forward(1))
    service.inbox.put(BrickLink.RELAY, text)
    assert service.serve() is BrickLink.RELAY
    assert output.record.find(forward(1)) is not None
    assert output.published == []
    output.synced()
    assert output.published == [fingerprint(text)]
