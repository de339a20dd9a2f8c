"""Why: the reason that is named is the cause that was injected, from the recording of the run."""

import json
import re
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from adapters.cli.log import log
from adapters.cli.why import why
from adapters.explanation import (
    Explanation,
    LogFilter,
    entries,
    entry_line,
    explain_command,
    explain_now,
    explanation_lines,
    select_for,
)
from adapters.recording import RunFile, read_history
from executive.commands import Command, MoveForward, Resume, Stop
from executive.history import CommandHistory, RunHistory
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from tests.explanation.case import Case
from tests.explanation.fault_situations import FAULTS
from tests.explanation.live import LiveBench
from tests.explanation.plan_situations import PLANS
from tests.explanation.situations import CASES
from tests.support.kinematic import Bench
from tests.support.plans import AHEAD, TOO_LATE, PlanBench


def recorded(case: Case, folder: Path) -> Path:
    """Bring a situation about, and return its recording."""
    path = folder / "run.mcap"
    with closing(RunFile(path)) as tape, Bench(folder, case.settings, tape=tape) as bench:
        case.inject(bench)
    return path


def typed(command: click.Command, *arguments: object) -> Result:
    return CliRunner().invoke(command, list(map(str, arguments)), catch_exceptions=False)


def explain(history: RunHistory, command: str | None) -> Explanation:
    return explain_now(history) if command is None else explain_command(history, command)


ALL = (*CASES, *FAULTS, *PLANS)


def reported(explanation: Explanation) -> str:
    """Return an explanation without the end of a link loss, which the query itself causes."""
    lines = explanation_lines(explanation, lambda utc_s: f"{utc_s:.2f}")
    return "\n".join(line for line in lines if "ground link recovered" not in line)


def is_right(case: Case, explained: Explanation) -> bool:
    """Whether an explanation names the cause that was injected, and no other."""
    return explained.reason is case.reason and case.output in reported(explained)


def reworded(history: RunHistory) -> RunHistory:
    """Return a history with other texts of its reports and situations, on which nothing depends.

    RECEIVED and ACCEPTED have the name of the request as their text.
    """
    named = {Stage.RECEIVED, Stage.ACCEPTED}
    return replace(
        history,
        reports=tuple(
            each if each.stage in named else replace(each, text="x") for each in history.reports
        ),
        situations=tuple(replace(each, why="x") for each in history.situations),
    )


def shape(explanation: Explanation) -> tuple[object, ...]:
    """Return an explanation without its texts, but with the commands that these name."""
    times = [each.utc_s for each in explanation.steps]
    named = [re.findall(r"as number (\d+)", each.text) for each in explanation.steps]
    return explanation.reason, explanation.evidence, times, named


@pytest.mark.parametrize("case", ALL, ids=lambda case: case.name)
def test_the_reason_is_the_cause_that_was_injected(case: Case, tmp_path: Path) -> None:
    with LiveBench(tmp_path, case) as bench:
        case.inject(bench)
        bench.recorder.end()
        if case.ends:
            bench.restart()
        live = bench.request(lambda client: client.get_history(case.command))
        starts = bench.starts
    recorded, _ = read_history(tmp_path / "run.mcap")
    explained, requested = explain(recorded, case.command), explain(live, case.command)
    assert is_right(case, explained), reported(explained)
    assert is_right(case, requested), reported(requested)
    assert reported(explain(select_for(recorded, case.command), case.command)) == reported(
        explained
    )
    assert shape(explain(reworded(recorded), case.command)) == shape(explained)
    less = select_for(reworded(recorded), case.command)
    assert shape(explain(less, case.command)) == shape(explained)
    known = {each.identity for each in recorded.received}
    of_plans = {each.identity for each in live.received} - known
    if starts == 1 and not of_plans:  # whose arguments the ledger knows
        assert reported(requested) == reported(explained)


SOME = {
    "refused WRONG_MODE when stopped": "reasons",
    "replaced": "received",
    "waits while paused": "situations",
    "under way": "leaves",
    "limited by a setting": "fastest",
    "slowed by a fault": "slowing",
    "now: tilted": "reports",
}
"""Situations, and of each what its explanation must not lack."""


@pytest.fixture(scope="module")
def some(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Case, RunHistory]]:
    """Give some situations with what is known of each."""
    cases = [case for case in ALL if case.name in SOME]
    return [
        (case, read_history(recorded(case, tmp_path_factory.mktemp("some")))[0]) for case in cases
    ]


def test_an_explanation_of_another_situation_is_noticed(
    some: list[tuple[Case, RunHistory]],
) -> None:
    assert len(some) == len(SOME)
    for case, _ in some:
        for other, history in some:
            right = is_right(case, explain(history, other.command))
            assert right == (case is other), (case.name, other.name)


def test_an_omission_is_detected(some: list[tuple[Case, RunHistory]]) -> None:
    for case, history in some:
        lacking = SOME[case.name]
        if lacking == "reasons":
            reports = tuple(replace(each, reason=None) for each in history.reports)
            less = replace(history, reports=reports)
        else:
            nothing = type(getattr(history, lacking))()
            less = replace(history, **{lacking: nothing})
        assert not is_right(case, explain(less, case.command)), case.name


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the recording of a drive that a stop ends, a refusal, and a resume."""

    def play(bench: Bench) -> None:
        bench.drive_on()
        bench.submit(Stop(), 2)
        bench.run(1.0)
        bench.submit(MoveForward(1.0), 3)
        bench.send(Command(Identity("LAB", 3), Resume(), "relay"))
        bench.run(0.5)

    return recorded(Case("", play, None, None), tmp_path_factory.mktemp("run"))


def test_the_log_has_each_command_on_a_line(run: Path) -> None:
    result = typed(log, "--file", run)
    assert result.exit_code == 0
    first, second, third, fourth = result.output.splitlines()
    assert "MOE:1 moveForward distance 5 m (direct): accepted" in first
    assert first.endswith("CANCELLED 1.05 s: stopped by MOE:2 (STOPPED 801)")
    assert "MOE:2 stop (direct): " in second
    assert "EXECUTED" in second
    assert "MOE:3 moveForward distance 1 m (direct): REJECTED 2.05 s: not accepted in mode" in third
    assert "LAB:3 resume (relay): accepted 2.05 s, started 2.05 s, EXECUTED 2.05 s" in fourth


@pytest.mark.parametrize(
    ("options", "lines"),
    [
        (("--command", "MOE:2"), 1),
        (("--command", "3"), 2),
        (("--command", "MOE:1", "--unfold"), 4),
        (("--source", "LAB"), 1),
        (("--severity", "warn"), 2),
        (("--since", "2s"), 2),
        (("--since", "2999-05-04"), 0),
        (("--since", "1990-05-04T10:30"), 4),
        (("--until", "0.5"), 1),
        (("--mode", "stopped"), 2),
        (("--source", "nobody"), 0),
    ],
)
def test_the_log_is_filtered(run: Path, options: tuple[str, ...], lines: int) -> None:
    result = typed(log, "--file", run, *options)
    assert result.exit_code == 0
    assert len(result.output.splitlines()) == lines, result.output


def test_log_and_why_are_printed_as_json(run: Path) -> None:
    lifecycles = [
        json.loads(each) for each in typed(log, "--file", run, "--json").output.splitlines()
    ]
    assert [each["identity"]["command_id"] for each in lifecycles] == [1, 2, 3, 3]
    assert lifecycles[0]["reports"][-1]["reason"] == "STOPPED"
    reported = json.loads(typed(why, "MOE:1", "--file", run, "--json").output)
    assert reported["reason"] == "STOPPED"
    assert reported["steps"][0]["text"].startswith("MOE requested moveForward distance 5 m")


def test_why_is_given_for_a_time(run: Path) -> None:
    assert typed(why, "--file", run, "--at", 0.5).output.startswith("MOVING: moves at")
    assert typed(why, "--file", run, "--at", 1.5).output.startswith("STOPPED: ")
    assert typed(why, "--file", run).output.startswith("IDLE: ")


def test_bad_input_is_reported(run: Path, tmp_path: Path) -> None:
    for command, arguments, reported in (
        (why, ("MOE:9", "--file", run), "the latest known: MOE:1, MOE:2, MOE:3, LAB:3"),
        (why, ("3", "--file", run), "name one of MOE:3, LAB:3"),
        (why, ("--file", tmp_path / "none.mcap"), "cannot be read"),
        (log, ("--file", tmp_path / "none.mcap"), "cannot be read"),
        (log, ("--file", run, "--severity", "loud"), "'loud' is not one of"),
        (log, ("--file", run, "--since", "noon"), "'noon' is no time: write 90, 10min, today"),
    ):
        result = typed(command, *arguments)
        assert result.exit_code == 2, result.output
        assert reported in result.output


def test_each_report_without_a_number_is_listed() -> None:
    losses = [
        Report(0, 1.0, ReportKind.LINK, Severity.ALARM, "lost", Identity("MOE", number))
        for number in (7, 8)
    ]
    assert list(entries(RunHistory(1.0, tuple(losses)), LogFilter())) == losses


def test_the_loss_of_a_command_is_a_line_of_its_own_and_names_it_once() -> None:
    moe = Identity("MOE", 7)
    begun = Report(
        1, 1.0, ReportKind.COMMAND, Severity.INFORMATIONAL, "stop", moe, Stage.RECEIVED, "relay"
    )
    loss = Report(0, 2.0, ReportKind.LINK, Severity.ALARM, "MOE:7 may not have arrived", moe)
    history = RunHistory(2.0, (begun, loss))
    first, second = entries(history, LogFilter(command="7"))
    assert first is loss
    assert isinstance(second, CommandHistory)
    assert entry_line(loss, str) == "2.0  ALARM MOE:7 may not have arrived"


def test_a_node_of_a_plan_is_explained_by_its_decisions(tmp_path: Path) -> None:
    body = f'<Fallback name="there">{TOO_LATE}{AHEAD}</Fallback>'
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, PlanBench(tmp_path, tape=tape) as bench:
        bench.outcome(body)
    shown = typed(why, "there", "--file", path).output
    assert shown.startswith("there took the second branch moveForward 2: moveForward was CANCELLED")
    assert (
        "there/moveForward 2 gave plan:survey:2"
        in typed(why, "moveForward 2", "--file", path).output
    )


def test_each_cycle_of_a_loop_has_its_decision(tmp_path: Path) -> None:
    never = '<ScriptCondition name="never" code="1 == 2"/>'
    cycle = (
        f'<Sequence><Fallback name="there">{never}{AHEAD}</Fallback><Sleep msec="200"/></Sequence>'
    )
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, PlanBench(tmp_path, tape=tape) as bench:
        bench.outcome(f'<Repeat num_cycles="2">{cycle}</Repeat>')
    for number in (1, 2):
        shown = typed(why, f"plan:survey:{number}", "--file", path).output
        assert "there took the second branch moveForward: never: not 1 == 2" in shown
