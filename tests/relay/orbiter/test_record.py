"""tests.relay.orbiter.test_record"""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from adapters.bundle import BundleId, Ipn
from adapters.bundle.codec.bundle import Creation
from adapters.mocup.brick.record import BrickRecord
from adapters.relay.orbiter.record import LEDGER_STRIDE, RoverRecord
from executive.commands.catalogue import Command, MoveForward, Request, Resume, Stop
from executive.record import LedgerError
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage

IDENTITY = Identity("MOE", 7)
LIFETIME_S = 100.0
BUNDLE = BundleId(Ipn(1, 1), Creation(1000, 0))


def report(sequence: int, stage: Stage = Stage.STARTED, identity: Identity = IDENTITY) -> Report:
    return Report(
        sequence, 1.0, ReportKind.COMMAND, Severity.INFORMATIONAL, "", identity, stage, "relay"
    )


def recorded(record: RoverRecord) -> list[tuple[int, int]]:
    """Return cursor and number of each report, in the order of recording."""
    return [(each.cursor, each.report.sequence) for each in record.ledger.recorded(0, None, 999)]


def requested(
    record: RoverRecord,
    request: Request,
    identity: Identity,
    utc_s: float = 1.0,
    bundle: BundleId = BUNDLE,
) -> None:
    command = Command(identity, request, "relay")
    record.outstanding.add(command, b"asked", bundle, utc_s, utc_s + LIFETIME_S)


def test_a_report_is_published_once_for_any_number_of_receptions(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    assert record.add_report(report(3), "a 0")
    assert not record.add_report(report(3), "b 0")
    record.close()
    again = RoverRecord(tmp_path / "r")
    assert not again.add_report(report(3), "a 0")
    assert again.ledger.reports() == [report(3)]


@pytest.mark.parametrize("kind", [RoverRecord, BrickRecord])
def test_a_file_with_the_tables_of_another_version_is_refused(
    kind: Callable[[Path], RoverRecord | BrickRecord], tmp_path: Path
) -> None:
    path = tmp_path / "r"
    kind(path).close()
    kind(path).close()
    with closing(sqlite3.connect(path)) as older:
        older.execute("PRAGMA user_version = 0")
    with pytest.raises(LedgerError, match=r"r has the tables of another version \(0, not 1\)"):
        kind(path)


def test_reports_that_overtake_one_another_are_kept_in_order(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    requested(record, MoveForward(1.0), IDENTITY)
    assert (record.outstanding.active(), record.outstanding.queued()) == (None, 1)
    record.add_report(report(4, Stage.EXECUTED), "a 0")
    record.add_report(report(3, Stage.STARTED), "b 0")
    assert [known.sequence for known in record.ledger.reports()] == [3, 4]
    assert recorded(record) == [(1, 4), (2, 3)]
    assert record.ledger.last_report(IDENTITY) == report(4, Stage.EXECUTED)
    assert (record.outstanding.active(), record.outstanding.queued()) == (None, 0)


def test_a_rover_that_begins_to_name_its_ledger_continues(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    record.add_report(report(1), "a 0")
    assert not record.ledgers.new("named")
    numbers = [
        record.ledgers.number(name, sequence)
        for name, sequence in (("named", 2), ("", 3), ("other", 1), ("", 2), ("named", 4))
    ]
    assert numbers == [2, 3, LEDGER_STRIDE + 1, LEDGER_STRIDE + 2, 4]


def test_a_refusal_without_number_is_stored_apart(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    refusal, other = report(0, Stage.REJECTED), report(0, Stage.REJECTED, Identity("MOE", 8))
    assert record.add_report(refusal, "a 0")
    assert not record.add_report(refusal, "a 0")
    assert not record.add_report(refusal, "of another bundle 0")
    assert record.add_report(other, "b 0")
    assert record.add_report(report(1, identity=Identity("MOE", 9)), "c 0")
    assert [known.sequence for known in record.ledger.reports(since=0)] == [1]
    assert recorded(record) == [(1, 0), (2, 0), (3, 1)]
    assert [each.report for each in record.ledger.recorded_on(IDENTITY)] == [refusal]
    assert [each.cursor for each in record.ledger.recorded(2, 8, 9)] == [2]
    assert [each.cursor for each in record.ledger.recorded(1, None, 2)] == [1, 2]


def test_a_brick_is_numbered_here(tmp_path: Path) -> None:
    for path in (tmp_path / "r", tmp_path / "r"):
        record = RoverRecord(path, numbered=False)
        record.add_report(report(0, Stage.STARTED), "a 0")
        record.add_report(report(0, Stage.EXECUTED), "a 1")
        expected = [report(1), report(2, Stage.EXECUTED)]
        assert record.ledger.reports() == expected
        record.close()


def test_what_left_the_outbox_is_no_longer_old(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    later = BundleId(Ipn(1, 1), Creation(1000, 1))
    requested(record, Stop(), IDENTITY, 10.0)
    requested(record, Stop(), Identity("MOE", 8), 20.0, later)
    assert record.outstanding.earliest_utc_s() == 10.0
    assert record.outstanding.note_departure(BUNDLE, 30.0) == IDENTITY
    assert record.outstanding.note_departure(BUNDLE, 30.0) is None
    assert record.outstanding.earliest_utc_s() == 20.0
    record.outstanding.outbox_empty(30.0)
    assert record.outstanding.earliest_utc_s() is None


def test_a_stop_holds_until_a_resume(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    seen = []
    requests: tuple[Request, ...] = (Stop(), MoveForward(1.0), Resume())
    for number, request in enumerate(requests, 1):
        identity = Identity("MOE", number)
        requested(record, request, identity)
        record.add_report(report(number, Stage.ACCEPTED, identity), f"{number} 0")
        seen.append(record.ledger.last_stop() is not None)
    assert seen == [True, True, False]


def test_reports_delayed_by_a_full_disk_are_published_once(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    pages = record.ledger.rows("PRAGMA max_page_count")[0][0]
    record.ledger.rows(f"PRAGMA max_page_count = {record.ledger.rows('PRAGMA page_count')[0][0]}")
    for number in range(1, 1000):
        try:
            record.add_report(report(number, identity=Identity("MOE", number)), f"{number} 0")
        except LedgerError:
            break
    else:
        pytest.fail("it never filled")
    held = report(number, identity=Identity("MOE", number))
    with pytest.raises(LedgerError):
        record.add_report(held, f"{number} 0")
    record.ledger.rows(f"PRAGMA max_page_count = {pages}")
    assert not record.add_report(held, f"{number} 0"), "it was written with the next commit"
    assert [known.sequence for known in record.ledger.reports()] == list(range(1, number + 1))


def test_older_telemetry_does_not_replace_newer(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    assert record.last_telemetry() is None
    for utc_s, message in ((1.0, b"a"), (3.0, b"c"), (2.0, b"b")):
        record.add_telemetry(message, utc_s)
    assert record.last_telemetry() == (3.0, b"c")


MAXIMUM = 10
STAGES = (Stage.RECEIVED, Stage.ACCEPTED, Stage.EXECUTED)
TABLES = ("commands", "stages", "uplinked", "reports", "recorded", "received_units")


class Stored:
    """A record with a short memory, and the commands that came and ended."""

    def __init__(self, path: Path, numbered: bool = True) -> None:
        self.path, self.numbered = path, numbered
        self.record = RoverRecord(path, numbered, MAXIMUM)
        self.last = 0

    def restart(self) -> None:
        self.record.close()
        self.record = RoverRecord(self.path, self.numbered, MAXIMUM)

    def run(
        self,
        number: int,
        request: Request = MoveForward(1.0),  # noqa: B008 - frozen
        lifecycle: tuple[Stage, ...] = STAGES,
        utc_s: float = 0.0,
    ) -> None:
        identity = Identity("MOE", number)
        bundle = BundleId(Ipn(1, 1), Creation(1000, number))
        command = Command(identity, request, "relay")
        self.record.outstanding.add(command, b"asked", bundle, utc_s, utc_s + LIFETIME_S)
        self.record.outstanding.note_departure(bundle, utc_s)
        for stage in lifecycle:
            self.notify(stage, identity)

    def notify(self, stage: Stage, identity: Identity) -> bool:
        self.last += 1
        return self.record.add_report(self.report(self.last, stage, identity), f"unit {self.last}")

    def report(self, number: int, stage: Stage, identity: Identity) -> Report:
        sequence = number if self.numbered else 0
        informational = Severity.INFORMATIONAL
        return Report(
            sequence, 1.0, ReportKind.COMMAND, informational, "", identity, stage, "relay"
        )

    def known(self, number: int) -> bool:
        return self.record.ledger.digest_of(Identity("MOE", number)) is not None

    def sizes(self) -> dict[str, int]:
        rows = {name: self.record.ledger.rows(f"SELECT count(*) FROM {name}") for name in TABLES}
        return {name: count for name, ((count,),) in rows.items()}


def test_the_first_record_is_deleted_completely(tmp_path: Path) -> None:
    stored = Stored(tmp_path / "r")
    for number in range(1, 21):
        stored.run(number)
    stored.record.prune(LIFETIME_S + 1.0)
    assert [r.sequence for r in stored.record.ledger.reports()] == list(range(49, 61))
    assert list(stored.sizes().values()) == [4, 4, 4, 12, 12, 0]
    assert recorded(stored.record)[0] == (49, 49)
    assert not stored.known(16)
    assert stored.known(17)


def test_a_deleted_report_is_not_published_again(tmp_path: Path) -> None:
    stored = Stored(tmp_path / "r")
    for number in range(1, 21):
        stored.run(number)
    stored.record.prune(LIFETIME_S + 1.0)
    stored.restart()
    again = stored.report(3, Stage.EXECUTED, Identity("MOE", 1))
    assert not stored.record.add_report(again, "once more")
    stored.run(21)
    assert stored.record.ledger.reports()[-1].sequence == 63


def test_within_its_lifetime_every_command_is_known(tmp_path: Path) -> None:
    stored = Stored(tmp_path / "r")
    for number in range(1, 21):
        stored.run(number, utc_s=float(number))
    stored.record.prune(LIFETIME_S + 5.5)
    assert [stored.known(number) for number in range(1, 21)] == [False] * 5 + [True] * 15
    assert stored.sizes()["reports"] == 45


def test_active_commands_are_retained_and_so_is_a_latched_stop(tmp_path: Path) -> None:
    stored = Stored(tmp_path / "r")
    stored.run(1, lifecycle=(Stage.RECEIVED, Stage.STARTED))
    stored.run(2, Stop())
    for number in range(3, 31):
        stored.run(number)
    stored.record.prune(LIFETIME_S + 1.0)
    assert stored.known(1)
    assert stored.record.outstanding.active() == 1
    assert stored.record.ledger.last_stop() == Identity("MOE", 2)
    assert not stored.known(3)
    stored.notify(Stage.EXECUTED, Identity("MOE", 1))
    assert stored.record.outstanding.active() is None


def test_events_and_replies_of_a_brick_are_forgotten_too(tmp_path: Path) -> None:
    stored = Stored(tmp_path / "r", numbered=False)
    stored.run(1, Stop())  # which holds nothing
    for number in range(2, 41):
        stored.run(number)
    stored.record.prune(LIFETIME_S + 1.0)
    sizes = stored.sizes()
    assert sizes["reports"] == sizes["received_units"] == 12
    assert stored.record.ledger.reports()[-1].sequence == 120
    events = Stored(tmp_path / "e")
    for number in range(1, 41):
        event = Report(number, 1.0, ReportKind.EVENT, Severity.WARNING, "a stone")
        events.record.add_report(event, f"unit {number}")
    events.record.prune(0.0)
    assert events.sizes()["reports"] == MAXIMUM


def test_refusals_without_a_number_are_forgotten_too(tmp_path: Path) -> None:
    stored = Stored(tmp_path / "r")
    for number in range(1, 41):
        refusal = stored.report(0, Stage.REJECTED, Identity("MOE", number))
        assert stored.record.add_report(refusal, f"unit {number}")
    stored.record.prune(0.0)
    assert stored.sizes()["reports"] == stored.sizes()["received_units"] == MAXIMUM
    assert stored.record.ledger.last_report(Identity("MOE", 40)) is not None
    assert stored.record.ledger.last_report(Identity("MOE", 30)) is None


def test_a_report_on_a_known_command_is_never_too_late(tmp_path: Path) -> None:
    stored = Stored(tmp_path / "r")
    stored.run(1, lifecycle=(Stage.RECEIVED,))
    stored.last += 1  # EXECUTED is on its way
    for number in range(2, 31):
        stored.run(number)
    stored.record.prune(LIFETIME_S + 1.0)
    late = stored.report(2, Stage.EXECUTED, Identity("MOE", 1))
    assert stored.record.add_report(late, "late")
    assert not stored.record.add_report(late, "again")
    assert recorded(stored.record)[-1] == (89, 2)
