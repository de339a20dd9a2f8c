"""`rover whatif`, from the command line and from other processes."""

import json
import re
from dataclasses import replace
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from adapters.mrs.cli.command_group import read_command
from executive.commands import MoveTo, PreemptionPolicy, Waypoint
from executive.settings import SettingsError
from sim.fork import __main__ as process
from sim.fork.commands import whatif
from sim.fork.model import Fidelity, WhatIf
from sim.fork.question import Question
from sim.fork.text import answer_lines


def run(*arguments: object) -> Result:
    return CliRunner().invoke(whatif, [*map(str, arguments)], catch_exceptions=False)


def test_the_answer_names_the_difference_and_the_outcomes(stuck: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run(stuck, "--without", "left_wheels_stuck", "--out", out)
    assert done.exit_code == 0
    lines = done.output.splitlines()
    assert lines[0] == "without a change: as recorded (bit-equal)"
    assert lines[1].startswith("first different decision after 2.1")
    assert any(
        each.startswith("MOE:1 moveForward: recorded FAILED 2.25 s WHEELS_OFF_COMMAND; without")
        and re.search(r"EXECUTED 3\.\d+ s$", each)
        for each in lines
    )
    assert {each.name for each in out.iterdir()} == {"fork.mcap", "plot.png"}
    assert run(stuck, "--without", "left_wheels_stuck", "--out", out).exit_code == 2


def test_seeds_are_counted(answer: WhatIf) -> None:
    twice = replace(answer, forks=answer.forks * 2)
    assert any(each.endswith(" s in 2 of 2") for each in answer_lines(twice, "so"))


def test_a_change_without_effect_is_reported(answer: WhatIf) -> None:
    same = replace(answer, forks=(answer.unchanged,))
    assert list(answer_lines(same, "so"))[1:] == ["so: no decision differs"]


def test_the_document_is_json(answer: WhatIf) -> None:
    document = json.loads(json.dumps(answer.document()))
    assert document["fidelity"] == "BIT_EQUAL"
    assert document["forks"][0]["commands"][0]["stage"] == "EXECUTED"
    assert document["recorded"]["commands"][0]["reason"] == "WHEELS_OFF_COMMAND"


def test_without_reproduction_the_status_is_one(
    stuck: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "sim.fork.forkable.Forkable.unchanged",
        lambda self, _: (self.recorded, Fidelity.DIFFERENT),
    )
    done = run(stuck, "--set", "drive.travel_speed=0.6")
    assert done.exit_code == 1
    assert "there is no answer" in done.output


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--set", "drive.sped=1"), "drive has no key 'sped'"),
        (("--set", "0.6"), "'0.6' is not KEY=VALUE, as drive.travel_speed=0.6"),
        (("--drop", "two"), "'two' is no command id such as MOE:2"),
        (("--without", "tip"), "no fault 'tip'"),
        (("--command", "moveTo 3 2"), "give --at SECONDS"),
        (("--at", "3", "--command", "fly 3"), "No such command 'fly'"),
        (("--world", "nowhere"), "nowhere"),
    ],
)
def test_bad_input_has_status_two(stuck: Path, arguments: tuple[str, ...], text: str) -> None:
    done = run(stuck, *arguments)
    assert done.exit_code == 2
    assert text in done.output


def test_other_processes_send_json(
    stuck: Path,
    answer: WhatIf,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(process, "whatif", lambda *_: answer)
    question = {"recording": str(stuck), "without": ["left_wheels_stuck"], "at_s": 2}
    monkeypatch.setattr("sys.stdin", _Text(json.dumps(question)))
    with pytest.raises(SystemExit) as ended:
        process.main()
    assert ended.value.code == 0
    assert json.loads(capsys.readouterr().out)["fidelity"] == "BIT_EQUAL"
    monkeypatch.setattr("sys.stdin", _Text(json.dumps({**question, "wihtout": []})))
    with pytest.raises(SystemExit) as ended:
        process.main()
    assert ended.value.code == 2
    assert "wihtout" in capsys.readouterr().err


class _Text:
    def __init__(self, text: str) -> None:
        self._text = text

    def read(self) -> str:
        return self._text


def test_commands_are_typed_as_for_rover_command() -> None:
    assert read_command("moveTo 3 2 --replace") == (
        MoveTo(Waypoint(3.0, 2.0)),
        PreemptionPolicy.REPLACE,
    )
    request, preemption = read_command("moveTo -- -3 50cm")
    assert request == MoveTo(Waypoint(-3.0, 0.5))
    assert preemption is PreemptionPolicy.APPEND
    for text in ("", "moveTo 3", "moveTo 3 2 --frame north", "moveTo '3"):
        with pytest.raises(click.UsageError):
            read_command(text)


def test_a_question_is_shown_as_text() -> None:
    question = Question("run.mcap", set=("drive.travel_speed=1",), drop=("MOE:2",))
    assert question.text == "with drive.travel_speed=1, without MOE:2"
    with pytest.raises(SettingsError):
        Question("run.mcap", drop=("MOE",)).change()
