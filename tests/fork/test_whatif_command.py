"""`rover whatif`, from the command line and from other processes."""

import json
import re
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from adapters.recording import RunFile, RunReader, decode
from executive.core.recording import CoreCalled
from sim.fork import __main__
from sim.fork.answer import answer_lines
from sim.fork.changed import read_change
from sim.fork.commands import whatif
from sim.fork.model import Change, Fidelity, WhatIf


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


def test_seeds_need_a_change(stuck: Path) -> None:
    done = run(stuck, "--at", 2, "--seeds", 3)
    assert done.exit_code == 2
    assert "--seeds draws other noise for a change: give one" in done.output


def test_a_fork_at_the_end_of_a_recording_is_not_compared(answer: WhatIf) -> None:
    """Only the replay is the same there: nothing was simulated that the recording has."""
    at_the_end = replace(answer, fidelity=Fidelity.NOT_COMPARED)
    first, *_ = answer_lines(at_the_end, Change())
    assert first == "without a change: not compared, the fork begins at the end of the recording"


def test_seeds_are_counted(answer: WhatIf) -> None:
    twice = replace(answer, forks=answer.forks * 2)
    assert any(each.endswith(" s in 2 of 2") for each in answer_lines(twice, Change()))


def test_a_change_without_effect_is_reported(answer: WhatIf) -> None:
    same = replace(answer, forks=(answer.unchanged,))
    assert list(answer_lines(same, Change(without=("tip",))))[1:] == [
        "without tip: no decision differs until the end of the recording"
    ]


def test_a_truncated_recording_is_named(stuck: Path, tmp_path: Path) -> None:
    """Outcomes behind its end are shown, though no decision differs before."""
    cut = tmp_path / "cut.mcap"
    with closing(RunFile(cut)) as file:
        for message in RunReader(stuck).messages():
            item = decode(message.topic, message.data)
            if isinstance(item, CoreCalled) and item.now_s > 2.0:
                break
            file.put(item)
        file.flush()
        octets = cut.read_bytes()
    cut.write_bytes(octets)
    lines = run(cut, "--set", "faults.battery_low.below=20").output.splitlines()
    assert lines[0] == "the recording is truncated: it ends at 2.0 s"
    assert lines[1] == "without a change: as recorded (bit-equal)"
    assert "no decision differs until the end" in lines[2]
    assert lines[3].startswith("MOE:1 moveForward: recorded STARTED 1.00 s; with")
    assert lines[3].endswith(" WHEELS_OFF_COMMAND")


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
        lambda self, *_: (self.recorded, Fidelity.DIFFERENT),
    )
    done = run(stuck, "--set", "drive.travel_speed=0.6")
    assert done.exit_code == 1
    assert "there is no answer" in done.output


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--set", "drive.sped=1"), "drive: unknown key 'sped'"),
        (("--set", "0.6"), "'0.6' is not KEY=VALUE, as drive.travel_speed=0.6"),
        (("--drop", "two"), "'two' is no command id such as MOE:2"),
        (("--without", "tip"), "no fault 'tip'"),
        (("--command", "moveTo 3 2"), "give --at SECONDS"),
        (("--at", "3", "--command", "fly 3"), "No such command 'fly'"),
        (("--world", "nowhere"), "nowhere"),
        (("--at", "9", "--command", "stop"), "--at 9 is after the end of the recording, 3 s"),
    ],
)
def test_bad_input_has_status_two(stuck: Path, arguments: tuple[str, ...], text: str) -> None:
    done = run(stuck, *arguments)
    assert done.exit_code == 2
    assert text in done.output


def test_other_processes_start_the_same_command() -> None:
    assert vars(__main__)["whatif"] is whatif


def test_a_change_is_shown_as_text(answer: WhatIf) -> None:
    change = read_change(["drive.travel_speed=1"], ["stop"], ["MOE:2"], ["tip"], "mpc", "yard")
    text = "with drive.travel_speed=1, with mpc, in yard, with stop, without MOE:2, without tip"
    assert any(each.startswith(f"end {text}: ") for each in answer_lines(answer, change))
