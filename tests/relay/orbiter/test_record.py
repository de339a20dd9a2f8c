"""tests.relay.orbiter.test_record"""

from pathlib import Path

import pytest

from adapters.bundle import BundleId, Ipn
from adapters.bundle.codec.bundle import Creation
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


def asked(
    record: RoverRecord,
    request: Request,
    identity: Identity,
    utc_s: float = 1.0,
    bundle: BundleId = BUNDLE,
) -> None:
    command = Command(identity, request, "relay")
    record.outstanding.add(command, b"asked", bundle, utc_s, utc_s + LIFETIME_S)


def test_a_report_is_told_once_however_often_it_comes(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    assert record.add_report(report(3), "a 0")
    assert not record.add_report(report(3), "b 0")
    record.close()
    again = RoverRecord(tmp_path / "r")
    assert not again.add_report(report(3), "a 0")
    assert again.ledger.reports() == [report(3)]


def test_reports_that_overtake_one_another_are_kept_in_order(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    asked(record, MoveForward(1.0), IDENTITY)
    assert (record.outstanding.active(), record.outstanding.queued()) == (None, 1)
    record.add_report(report(4, Stage.EXECUTED), "a 0")
    record.add_report(report(3, Stage.STARTED), "b 0")
    assert [known.sequence for known in record.ledger.reports()] == [3, 4]
    assert recorded(record) == [(1, 4), (2, 3)]
    assert record.ledger.last_report(IDENTITY) == report(4, Stage.EXECUTED)
    assert (record.outstanding.active(), record.outstanding.queued()) == (None, 0)


def test_who_begins_to_name_its_ledger_goes_on(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    record.add_report(report(1), "a 0")
    assert not record.ledgers.new("named")
    numbers = [
        record.ledgers.number(name, sequence)
        for name, sequence in (("named", 2), ("", 3), ("other", 1), ("", 2), ("named", 4))
    ]
    assert numbers == [2, 3, LEDGER_STRIDE + 1, LEDGER_STRIDE + 2, 4]


def test_a_refusal_without_number_is_kept_aside(tmp_path: Path) -> None:
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
    asked(record, Stop(), IDENTITY, 10.0)
    asked(record, Stop(), Identity("MOE", 8), 20.0, later)
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
        asked(record, request, identity)
        record.add_report(report(number, Stage.ACCEPTED, identity), f"{number} 0")
        seen.append(record.ledger.last_stop() is not None)
    assert seen == [True, True, False]


def test_what_a_full_disk_held_up_is_told_once(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    room = record.ledger.rows("PRAGMA max_page_count")[0][0]
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
    record.ledger.rows(f"PRAGMA max_page_count = {room}")
    assert not record.add_report(held, f"{number} 0"), "it was written with the next commit"
    assert [known.sequence for known in record.ledger.reports()] == list(range(1, number + 1))


def test_older_telemetry_does_not_replace_newer(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    assert record.last_telemetry() is None
    for utc_s, message in ((1.0, b"a"), (3.0, b"c"), (2.0, b"b")):
        record.add_telemetry(message, utc_s)
    assert record.last_telemetry() == (3.0, b"c")


MOST = 10
LIFE = (Stage.RECEIVED, Stage.ACCEPTED, Stage.EXECUTED)
TABLES = ("commands", "stages", "asked", "reports", "recorded", "heard")


class Kept:
    """A record with a short memory, and the commands that came and ended."""

    def __init__(self, path: Path, numbered: bool = True) -> None:
        self.path, self.numbered = path, numbered
        self.record = RoverRecord(path, numbered, MOST)
        self.last = 0

    def restart(self) -> None:
        self.record.close()
        self.record = RoverRecord(self.path, self.numbered, MOST)

    def run(
        self,
        number: int,
        request: Request = MoveForward(1.0),  # noqa: B008 - frozen
        life: tuple[Stage, ...] = LIFE,
        utc_s: float = 0.0,
    ) -> None:
        identity = Identity("MOE", number)
        bundle = BundleId(Ipn(1, 1), Creation(1000, number))
        command = Command(identity, request, "relay")
        self.record.outstanding.add(command, b"asked", bundle, utc_s, utc_s + LIFETIME_S)
        self.record.outstanding.note_departure(bundle, utc_s)
        for stage in life:
            self.tell(stage, identity)

    def tell(self, stage: Stage, identity: Identity) -> bool:
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


def test_the_oldest_is_forgotten_whole(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    for number in range(1, 21):
        kept.run(number)
    kept.record.prune(LIFETIME_S + 1.0)
    assert [r.sequence for r in kept.record.ledger.reports()] == list(range(49, 61))
    assert list(kept.sizes().values()) == [4, 4, 4, 12, 12, 0]
    assert recorded(kept.record)[0] == (49, 49)
    assert not kept.known(16)
    assert kept.known(17)


def test_what_was_forgotten_is_not_told_again(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    for number in range(1, 21):
        kept.run(number)
    kept.record.prune(LIFETIME_S + 1.0)
    kept.restart()
    again = kept.report(3, Stage.EXECUTED, Identity("MOE", 1))
    assert not kept.record.add_report(again, "once more")
    kept.run(21)
    assert kept.record.ledger.reports()[-1].sequence == 63


def test_within_its_lifetime_every_command_is_known(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    for number in range(1, 21):
        kept.run(number, utc_s=float(number))
    kept.record.prune(LIFETIME_S + 5.5)
    assert [kept.known(number) for number in range(1, 21)] == [False] * 5 + [True] * 15
    assert kept.sizes()["reports"] == 45


def test_what_is_under_way_stays_and_so_does_a_stop_that_holds(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    kept.run(1, life=(Stage.RECEIVED, Stage.STARTED))
    kept.run(2, Stop())
    for number in range(3, 31):
        kept.run(number)
    kept.record.prune(LIFETIME_S + 1.0)
    assert kept.known(1)
    assert kept.record.outstanding.active() == 1
    assert kept.record.ledger.last_stop() == Identity("MOE", 2)
    assert not kept.known(3)
    kept.tell(Stage.EXECUTED, Identity("MOE", 1))
    assert kept.record.outstanding.active() is None


def test_events_and_replies_of_a_brick_are_forgotten_too(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r", numbered=False)
    kept.run(1, Stop())  # which holds nothing
    for number in range(2, 41):
        kept.run(number)
    kept.record.prune(LIFETIME_S + 1.0)
    sizes = kept.sizes()
    assert sizes["reports"] == sizes["heard"] == 12
    assert kept.record.ledger.reports()[-1].sequence == 120
    events = Kept(tmp_path / "e")
    for number in range(1, 41):
        event = Report(number, 1.0, ReportKind.EVENT, Severity.WARNING, "a stone")
        events.record.add_report(event, f"unit {number}")
    events.record.prune(0.0)
    assert events.sizes()["reports"] == MOST


def test_refusals_without_a_number_are_forgotten_too(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    for number in range(1, 41):
        refusal = kept.report(0, Stage.REJECTED, Identity("MOE", number))
        assert kept.record.add_report(refusal, f"unit {number}")
    kept.record.prune(0.0)
    assert kept.sizes()["reports"] == kept.sizes()["heard"] == MOST
    assert kept.record.ledger.last_report(Identity("MOE", 40)) is not None
    assert kept.record.ledger.last_report(Identity("MOE", 30)) is None


def test_a_report_on_a_known_command_is_never_too_late(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    kept.run(1, life=(Stage.RECEIVED,))
    kept.last += 1  # EXECUTED is on its way
    for number in range(2, 31):
        kept.run(number)
    kept.record.prune(LIFETIME_S + 1.0)
    late = kept.report(2, Stage.EXECUTED, Identity("MOE", 1))
    assert kept.record.add_report(late, "late")
    assert not kept.record.add_report(late, "again")
    assert recorded(kept.record)[-1] == (89, 2)
