"""A journal survives what kills its writer, and a view knows what its journal knows."""

from pathlib import Path

from executive.commands.catalogue import Arrival, Command, PlanDefinition
from executive.plans.builder import check_plan
from executive.reasons import Reason, Refusal
from executive.reports import Identity, Kind, Report, Severity, Stage
from executive.settings import load_settings
from tests.stress.command_generator import PLAN, random_command
from tests.stress.kills_journal import (
    Answer,
    Answered,
    Entry,
    Fetched,
    Fetching,
    Heard,
    Journal,
    Sent,
    View,
    Way,
)

FIRST = Identity("KILLS", 1)


def report(sequence: int, stage: Stage | None = None) -> Report:
    return Report(
        sequence=sequence,
        utc_s=1.5,
        kind=Kind.EVENT if stage is None else Kind.COMMAND,
        severity=Severity.WARNING,
        text="that",
        identity=None if stage is None else FIRST,
        stage=stage,
        reason=Reason.STOPPED,
    )


def entries() -> list[Entry]:
    commands = [random_command(7, number, "direct", 12.25) for number in range(1, 200)]
    assert {command.arrival for command in commands} == set(Arrival)
    return [
        *map(Sent, commands),
        Answered(FIRST, Answer.DUPLICATE),
        Heard(report(1), Way.BROKER),
        Heard(report(2, Stage.EXECUTED), Way.LEDGER),
        Fetching("samples/0.bin", "fetched-1", 4096),
        Fetched("samples/0.bin", "fetched-1", "00ff"),
    ]


def test_everything_written_is_read(tmp_path: Path) -> None:
    written = entries()
    with Journal(tmp_path / "journal") as journal:
        for entry in written:
            journal.write(entry)
    with Journal(tmp_path / "journal") as again:
        assert again.entries == written


def test_a_line_cut_short_is_no_line(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    with Journal(path) as journal:
        journal.write(Answered(FIRST, Answer.TAKEN))
        journal.write(Heard(report(1), Way.BROKER))
    path.write_bytes(path.read_bytes()[:-5])
    with Journal(path) as journal:
        assert journal.entries == [Answered(FIRST, Answer.TAKEN)]
        journal.write(Answered(FIRST, Answer.DUPLICATE))
    with Journal(path) as journal:
        assert len(journal.entries) == 2


def test_commands_depend_on_seed_and_number_alone() -> None:
    assert random_command(1, 5, "direct", 0.0) == random_command(1, 5, "direct", 0.0)
    differ = [
        random_command(1, number, "", 0.0) != random_command(2, number, "", 0.0)
        for number in range(2, 20)
    ]
    assert any(differ)


def test_the_plan_that_is_sent_is_one() -> None:
    plan = PlanDefinition("plan-0", "look", "BTCPP4", PLAN)
    assert not isinstance(check_plan(plan, load_settings("jackal")), Refusal)


def test_a_view_goes_on_where_it_was(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    command = Command(FIRST, random_command(1, 1, "direct", 0.0).request, "direct")
    with Journal(path) as journal:
        view = View(journal)
        assert (view.next_number, view.next_name) == (1, "fetched-1")
        view.note(Sent(command))
        view.hear(report(1, Stage.RECEIVED), Way.BROKER)
        view.hear(report(3, Stage.EXECUTED), Way.BROKER)
        view.hear(report(3, Stage.EXECUTED), Way.LEDGER)
        view.note(Fetching("a", view.next_name, 0))
    with Journal(path) as journal:
        view = View(journal)
        assert view.unanswered == view.commands == [command]
        assert (view.next_number, view.next_name) == (2, "fetched-2")
        assert (view.whole_to, view.newest) == (1, 3)
        assert view.living == []
        assert view.interrupted == Fetching("a", "fetched-1", 0)
        view.hear(report(2), Way.LEDGER)
        view.note(Answered(FIRST, Answer.DUPLICATE))
        view.note(Fetched("a", "fetched-1", "00"))
        assert sum(isinstance(entry, Heard) for entry in journal.entries) == 3
    with Journal(path) as journal:
        view = View(journal)
        assert view.whole_to == 3
        assert not view.unanswered
        assert view.interrupted is None
