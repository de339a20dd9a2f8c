import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import Command, FollowPath, MoveTo, Stop, Waypoint
from executive.record import Ledger, LedgerError, RelayedCommand, RelayRecord, digest
from executive.values.reasons import Figure, Reason
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage

WRITER = """
import sys
from pathlib import Path
from executive.commands import Command, Identity, MoveForward
from executive.record.ledger import Ledger
from executive.values.reports import Stage
ledger = Ledger(Path(sys.argv[1]))
number = 0
while True:
    number += 1
    ledger.record(Command(Identity("MOE", number), MoveForward(float(number)), "direct"))
    ledger.set_stage(Identity("MOE", number), Stage.STARTED)
    ledger.commit()
    print(number, flush=True)
"""


def command(number: int) -> Command:
    return Command(Identity("MOE", number), MoveTo(Waypoint(1.0, 2.0, 0.5)), "direct")


def report(sequence: int, number: int = 1, stage: Stage = Stage.REJECTED) -> Report:
    return Report(
        sequence=sequence,
        utc_s=1.5,
        kind=ReportKind.COMMAND,
        severity=Severity.WARNING,
        text="too far",
        identity=Identity("MOE", number),
        stage=stage,
        link="direct",
        reason=Reason.OUT_OF_RANGE,
        figures=(Figure("distance", 120.0, "m"), Figure("bound", 100.0, "m")),
    )


def test_reports_are_read_as_they_were_written(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "deep" / "ledger.sqlite")
    event = Report(2, 2.5, ReportKind.EVENT, Severity.ALARM, "odometry lost", fault="tilted")
    others = replace(event, sequence=3, fault=None, publishers=("/joystick",))
    none = replace(others, sequence=4, publishers=())
    stopped = replace(report(1), cause=Identity("MOE", 7))
    for each in (stopped, event, others, none):
        ledger.append_report(each)
    ledger.close()
    again = Ledger(tmp_path / "deep" / "ledger.sqlite")
    assert list(again.reports()) == [stopped, event, others, none]
    assert list(again.reports(since=2)) == [event, others, none]
    assert list(again.reports(command_id=1)) == [stopped]
    assert again.last_report(Identity("MOE", 1)) == stopped
    assert again.last_sequence == 4
    again.close()


def test_a_ledger_of_an_earlier_version_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite"
    Ledger(path).close()
    with closing(sqlite3.connect(path)) as file:
        file.execute("PRAGMA user_version = 0")
    with pytest.raises(
        LedgerError, match=r"ledger\.sqlite has the tables of another version \(0, not 1\)"
    ):
        Ledger(path)


def test_a_digest_depends_on_the_request_not_on_its_link() -> None:
    first = command(1)
    relayed = Command(Identity("MOE", 1), first.request, "relay", lifetime_s=3.0)
    assert digest(first) == digest(relayed)
    assert digest(first) != digest(Command(Identity("MOE", 1), Stop(), "direct"))


def test_unfinished_commands_are_read_completely_and_in_order(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "ledger.sqlite")
    path = Command(
        Identity("A", 9), FollowPath((Waypoint(1.0, 0.0), Waypoint(1.0, 1.0, 0.1, 0.2))), "direct"
    )
    for sequence, (requested, stage) in enumerate(
        [(path, Stage.STARTED), (command(1), Stage.ACCEPTED), (command(2), Stage.EXECUTED)], 1
    ):
        ledger.record(requested)
        ledger.set_stage(requested.identity, stage)
        ledger.append_report(
            Report(
                sequence,
                0.0,
                ReportKind.COMMAND,
                Severity.INFORMATIONAL,
                "",
                requested.identity,
                stage,
            )
        )
    ledger.commit()
    assert list(ledger.unfinished()) == [(path, Stage.STARTED), (command(1), Stage.ACCEPTED)]
    ledger.close()


def test_an_uncommitted_record_is_absent(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "ledger.sqlite")
    ledger.record(command(1))
    assert ledger.digest_of(Identity("MOE", 1)) == digest(command(1))
    ledger.abandon()
    again = Ledger(tmp_path / "ledger.sqlite")
    assert again.digest_of(Identity("MOE", 1)) is None
    again.close()


def test_a_failed_commit_writes_nothing_and_is_tried_again(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "ledger.sqlite")
    ledger.append_report(report(1))
    blocker = sqlite3.connect(tmp_path / "ledger.sqlite", isolation_level=None)
    blocker.execute("BEGIN IMMEDIATE")
    ledger.rows("PRAGMA busy_timeout = 0")
    with pytest.raises(LedgerError, match="locked"):
        ledger.commit()
    blocker.execute("ROLLBACK")
    blocker.close()
    ledger.commit()
    assert list(ledger.reports()) == [report(1)]
    ledger.close()


def test_a_file_that_is_no_ledger_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "ledger.sqlite").write_text("not a database, and long enough to be looked at")
    with pytest.raises(LedgerError, match=r"ledger\.sqlite"):
        Ledger(tmp_path / "ledger.sqlite")


@pytest.mark.at_length
@pytest.mark.parametrize("attempt", range(3))
def test_a_returned_commit_survives_kill_9(tmp_path: Path, attempt: int) -> None:
    path = tmp_path / "ledger.sqlite"
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout is not None
        promised = [writer.stdout.readline() for _ in range(20 + attempt)]
        os.kill(writer.pid, signal.SIGKILL)
        promised += [line for line in writer.stdout if line.endswith("\n")]
    ledger = Ledger(path)
    stored = [requested.identity.command_id for requested, _ in ledger.unfinished()]
    ledger.close()
    assert sorted(stored) == list(range(1, len(stored) + 1))
    assert len(stored) >= int(promised[-1])


def test_a_relayed_identity_is_forgotten_with_its_command(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "ledger.sqlite")
    record = RelayRecord(ledger, os.urandom)
    for number in (1, 2):
        command = Command(Identity("MOE", number), Stop(), "relay", counter=number)
        ledger.record(command)
        ledger.set_stage(command.identity, Stage.EXECUTED)
        record.add(command, 0x10)
    ledger.commit()
    ledger.prune(Identity("MOE", 1), Stage.EXECUTED)
    ledger.commit()
    assert record.find(Identity("MOE", 1)) is None
    assert record.find(Identity("MOE", 2)) == RelayedCommand(0x10, 2)
    ledger.close()
