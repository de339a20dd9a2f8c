"""Rover and console continue with the data folders of an earlier version, and lose nothing."""

import json
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from adapters.recording import RunReader, missing_for_fork, read_history
from adapters.recording.replay import replay
from executive.commands import Command, Mode, MoveForward, ResumePlan
from executive.commands.lifecycle import Duplicate
from executive.core.recording import LedgerBehind, ProcessStart
from executive.values.clock import ManualClock
from executive.values.parameters import Parameter
from executive.values.reasons import Reason
from executive.values.reports import Identity, PlanStatus, Stage
from tests.compatibility.messages import decoded_reports
from tests.compatibility.session import DRIVEN, PENDING, Then, answers, launched
from tests.console.consoles import ALL, at_console
from tests.support.plans import PlanBench

DOWN_S = 3600.0
"""Time from the start of the session to that of today's executive."""


@pytest.fixture
def data(left: Path, tmp_path: Path) -> Path:
    """Give data of a version that may be changed."""
    return Path(shutil.copytree(left, tmp_path / "data"))


@pytest.fixture
def bench(data: Path) -> Iterator[PlanBench]:
    """Give an executive of today that started on a ledger of then."""
    clock = ManualClock()
    clock.set(DOWN_S)
    with PlanBench(data / "rover", clock=clock) as bench:
        yield bench


def identities(file: Path) -> list[Identity]:
    """Return the commands of operators in a ledger, as SQLite has them."""
    with closing(sqlite3.connect(file)) as database:
        rows = database.execute("SELECT source, command_id FROM commands").fetchall()
    return [Identity(source, number) for source, number in rows if ":" not in source]


def test_the_ledger_has_all_reports_settings_and_files(left: Path, bench: PlanBench) -> None:
    before = decoded_reports((left / "reports.mal").read_bytes())
    now = bench.ledger.reports(1, count=10_000)
    assert [each.sequence for each in now] == list(range(1, len(now) + 1))
    for then, report in zip(before, now, strict=False):
        assert (then.identity, then.stage, then.reason, then.text, then.fault) == (
            *(report.identity, report.stage, report.reason, report.text, report.fault),
        )
    values = {each.parameter: each.value for each in bench.executive.parameters()}
    assert values[Parameter.TRAVEL_SPEED] == pytest.approx(0.4)
    pictures = {str(path) for path in bench.executive.files.paths()}
    assert "pictures/rock.jpg" in pictures
    assert len(pictures) == 3


def test_each_command_has_one_end_and_is_not_executed_again(left: Path, bench: PlanBench) -> None:
    commands = identities(left / "rover" / "ledger.sqlite")
    assert len(commands) > 10
    bench.run(1.0)
    pose = bench.rover.pose
    for identity in commands:
        ends = [
            report.stage
            for report in bench.ledger.reports(1, identity.command_id, 10_000)
            if report.identity == identity and report.stage and report.stage.terminal
        ]
        assert len(ends) == 1, identity
        request = bench.ledger.request(identity)
        assert request is not None
        answer = bench.send(Command(identity, request, "direct"))
        assert isinstance(answer, Duplicate), (identity, answer)
        assert answer.last_report.stage is ends[0]
    bench.run(3.0)
    assert bench.rover.pose == pose


def test_a_suspended_plan_continues_at_its_step(bench: PlanBench) -> None:
    assert bench.status().status is PlanStatus.SUSPENDED
    before = bench.status().done
    assert before == 2
    bench.request(ResumePlan("survey"))
    assert bench.until(PlanStatus.COMPLETED, PlanStatus.FAILED) is PlanStatus.COMPLETED
    executed = [each for each, stages in bench.commanded() if stages[-1] is Stage.EXECUTED]
    assert len(executed) == bench.status().total - before


def test_a_stop_before_a_power_loss_still_holds(data: Path) -> None:
    with PlanBench(data / "stopped") as bench:
        assert bench.executive.mode is Mode.STOPPED
        assert bench.refusal(MoveForward(1.0), 2).reason is Reason.WRONG_MODE


async def test_a_console_answers_as_before(left: Path, data: Path) -> None:
    before = json.loads((left / "http.json").read_text(encoding="utf-8"))
    with closing(launched(data / "rover")) as rover:
        async with at_console(data, rover.uri, "anna", topics=ALL, system=Then()) as (anna,):
            await anna.page.is_up()
            for name in PENDING:
                await anna.page.command(name, "failed", "cancelled")
            now = await answers(anna)
    for path, answer in before.items():
        assert list(lacking(answer, now[path])) == [], path
    path = "api/commands?asset=jackal"
    states = {each["id"]: each["state"] for each in now[path]["commands"]}
    for each in before[path]["commands"]:
        assert each["id"] in PENDING or states[each["id"]] == each["state"]
    for path, name in (("api/plans/jackal", "plans"), ("api/objects", "objects")):
        assert before[path][name]
        assert [each for each in before[path][name] if each not in now[path][name]] == []


def lacking(before: Any, now: Any, path: str = "") -> Iterator[str]:
    """Yield each key that an answer had and lacks now, and each value of another type."""
    match before, now:
        case dict(), dict():
            for key, part in before.items():
                if key not in now:
                    yield f"{path} {key}"
                else:
                    yield from lacking(part, now[key], f"{path} {key}")
        case list(), list():
            yield from lacking(_merged(before), _merged(now), f"{path} []")
        case _ if before is not None and now is not None and kind(before) is not kind(now):
            yield f"{path}: was {before}, is {now}"


def kind(value: Any) -> type:
    """Return the type of a value in JSON, which has one for all numbers."""
    return float if type(value) is int else type(value)


def _merged(items: list[Any]) -> dict[str, Any]:
    """Return one object with the keys of all in a list, at any depth."""
    merged: dict[str, Any] = {}
    for key, value in (pair for item in items if isinstance(item, dict) for pair in item.items()):
        if isinstance(value, dict):
            merged[key] = _merged([merged.get(key), value])
        elif value is not None or key not in merged:
            merged[key] = value
    return merged


def test_a_recording_is_explained_and_its_commands_end_the_same(left: Path) -> None:
    path = left / "run.mcap"
    history, _ = read_history(path)
    ends = {
        identity.command_id: each.end.stage
        for identity, each in history.command_histories().items()
        if identity.source == "MOE" and each.end is not None
    }
    assert {number: ends[number] for number in DRIVEN} == DRIVEN
    # With settings it is replayed to its end. Decisions may be better, or at another tick.
    reader = RunReader(path)
    assert any(reader.messages({LedgerBehind}))  # found by their numbers of polls
    kinds = {message.topic.kind for message in reader.messages()}
    lacks = [each.partition(" is missing: ")[0] for each in missing_for_fork(kinds)]
    assert lacks == ["/sim/world", "/sim/state", "/sim/timeline"]
    recorded: ProcessStart = reader.decoded(next(reader.messages({ProcessStart})))
    replayed = replay(path, recorded.settings)
    assert replayed.whole
    assert replayed.starts == 2
    assert replayed.difference is None or not replayed.difference.raised
    assert [each for each in replayed.reports if each.report.stage is not None] == []
