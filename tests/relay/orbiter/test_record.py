from pathlib import Path

import pytest

from adapters.bundle import BundleId
from adapters.bundle.codec.bundle import Creation
from adapters.bundle.codec.eid import Ipn
from adapters.relay.orbiter.record import LEDGER_STRIDE, RoverRecord
from executive.commands.catalogue import Command, MoveForward, Request, Resume, Stop
from executive.record import LedgerError
from executive.reports import Identity, Kind, Report, Severity, Stage

IDENTITY = Identity("MOE", 7)
LIFETIME_S = 100.0
BUNDLE = BundleId(Ipn(1, 1), Creation(1000, 0))


def report(sequence: int, stage: Stage = Stage.STARTED, identity: Identity = IDENTITY) -> Report:
    return Report(sequence, 1.0, Kind.COMMAND, Severity.INFORMATIONAL, "", identity, stage, "relay")


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
    assert record.add_report(report(3), "a 0") == report(3)
    assert record.add_report(report(3), "b 0") is None
    record.close()
    again = RoverRecord(tmp_path / "r")
    assert again.add_report(report(3), "a 0") is None
    assert again.ledger.reports() == [report(3)]


def test_reports_that_overtake_one_another_are_kept_in_order(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    asked(record, MoveForward(1.0), IDENTITY)
    assert (record.outstanding.active(), record.outstanding.queued()) == (None, 1)
    record.add_report(report(4, Stage.EXECUTED), "a 0")
    record.add_report(report(3, Stage.STARTED), "b 0")
    assert [known.sequence for known in record.ledger.reports()] == [3, 4]
    assert record.last_report(IDENTITY) == report(4, Stage.EXECUTED)
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
    assert record.add_report(refusal, "a 0") == refusal
    assert record.add_report(refusal, "a 0") is None
    assert record.add_report(other, "b 0") == other
    assert record.add_report(report(1, identity=Identity("MOE", 9)), "c 0") is not None
    assert [known.sequence for known in record.ledger.reports(since=0)] == [1]
    assert record.last_report(IDENTITY) == refusal


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
    assert record.outstanding.oldest_utc_s() == 10.0
    assert record.outstanding.left_outbox(BUNDLE, 30.0) == IDENTITY
    assert record.outstanding.left_outbox(BUNDLE, 30.0) is None
    assert record.outstanding.oldest_utc_s() == 20.0
    record.outstanding.outbox_empty(30.0)
    assert record.outstanding.oldest_utc_s() is None


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
    assert record.add_report(held, f"{number} 0") == held
    assert record.add_report(held, f"{number} 0") is None
    assert [known.sequence for known in record.ledger.reports()] == list(range(1, number + 1))


def test_older_telemetry_does_not_replace_newer(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "r")
    assert record.last_telemetry() is None
    for utc_s, message in ((1.0, b"a"), (3.0, b"c"), (2.0, b"b")):
        record.add_telemetry(message, utc_s)
    assert record.last_telemetry() == (3.0, b"c")
