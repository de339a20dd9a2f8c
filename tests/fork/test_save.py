"""`rover whatif --save`: the minimal change that saves a recorded run, or that none does."""

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from adapters.recording import RunFile
from executive.core.recording import CommandDequeued, Item, SimulationItem, Truth
from executive.values.reports import Identity
from sim.fork import hypotheses
from sim.fork.commands import whatif
from sim.fork.forkable import Forkable
from sim.fork.model import Change
from sim.fork.save import judge
from sim.rover.faults import LeftWheelsStuck, OdometryLost, SimulatedFault
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario
from tests.fork.conftest import play
from tests.fork.test_forks import rewritten

FORWARD = ("duration=2.6", "command.go.distance=0.6")
ROW = "settings.faults.motion_blocked"


def save(recording: Path, *options: str) -> Result:
    arguments = [str(recording), "--save", "--seeds", "1", *options]
    return CliRunner().invoke(whatif, arguments, catch_exceptions=False)


def test_a_tight_limit_is_named_with_its_least_factor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim.fork.candidates.FACTORS", (2.0, 5.0))
    play(tmp_path, "motion_forward", *FORWARD, f"{ROW}.above=9", f"{ROW}.ratio=0.36")
    done = save(tmp_path / "run.mcap")
    assert done.exit_code == 0
    assert done.output.splitlines() == [
        "MOE:1 moveForward FAILED MOTION_BLOCKED",
        "saved by faults.motion_blocked.above=18 (recorded 9)",
        "  EXECUTED with 1 of 1 seeds",
        "  EXECUTED without a change with 0 of 1 seeds",
    ]


def test_no_change_saves_a_rover_without_odometry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim.fork.candidates.FACTORS", (1.5, 5.0))
    play(tmp_path, "motion_forward", *FORWARD, "inject={odometry_lost, at: 1.1}")
    done = save(tmp_path / "run.mcap", "--json")
    answer = json.loads(done.output)
    assert done.exit_code == 0
    assert (answer["fidelity"], answer["hypotheses"]) == ("BIT_EQUAL", [])
    assert (answer["saving"]["minimal"], answer["saving"]["saved"]) == ("", 0)


class WithoutSimulation:
    """A recording of a rover that is not simulated: only its true poses are in it."""

    def __init__(self, tape: RunFile) -> None:
        self._tape = tape

    def put(self, item: Item) -> None:
        if isinstance(item, Truth) or not isinstance(item, SimulationItem):
            self._tape.put(item)


def test_hypotheses_explain_an_unknown_fault_before_a_change_is_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def few(_: object) -> Sequence[SimulatedFault]:
        return OdometryLost(), LeftWheelsStuck()

    monkeypatch.setattr(hypotheses, "possible_faults", few)
    monkeypatch.setattr(hypotheses, "REFINED", 1)
    monkeypatch.setattr("sim.fork.save.Search.run", lambda _: None)
    changes = ("duration=3", "command.go.distance=1", "inject={left_wheels_stuck, at: 1.8}")
    scenario = load_scenario(
        "motion_forward", RunMode.LOCK_STEP, tuple(map(Override.parse, changes))
    )
    with closing(RunFile(tmp_path / "run.mcap")) as tape:
        run_in_lock_step(scenario, tmp_path / "data", WithoutSimulation(tape))
    done = save(tmp_path / "run.mcap", "--json")
    answer = json.loads(done.output)
    assert answer["fidelity"] == "DIFFERENT"
    best, *others = answer["hypotheses"]
    assert best["fault"] == {"left_wheels_stuck": {}}
    assert best["begin_s"] == pytest.approx(1.8, abs=0.3)
    assert all(best["score"] <= each["score"] for each in others)
    monkeypatch.setattr("sim.fork.save.EXPLAINED", 0.0)
    unexplained = save(tmp_path / "run.mcap")
    assert unexplained.exit_code == 1
    assert "none explains it" in unexplained.output


def test_a_run_is_saved_only_if_nothing_else_is_worse(stuck: Path) -> None:
    forkable = Forkable(stuck)
    recorded = forkable.recorded.record
    repaired = forkable.fork(Change(without=("left_wheels_stuck",))).record
    failed = Identity("MOE", 1)
    assert judge(failed, recorded, recorded).text == "MOE:1 FAILED WHEELS_OFF_COMMAND"
    assert judge(Identity("MOE", 9), recorded, recorded).text == "MOE:9 has no end"
    assert judge(Identity("MOE", 2), repaired, recorded).text == "MOE:1 no longer ends EXECUTED"
    assert not judge(failed, repaired, repaired).text
    # The recording has a command after the failure, which is not sent without it.
    assert not judge(failed, recorded, repaired).text
    fixed = [replace(each, pose=repaired.poses[0].pose) for each in repaired.poses]
    assert "is not true" in judge(failed, repaired, replace(repaired, poses=fixed)).text
    repaired.contacts = 2
    assert judge(failed, recorded, repaired).text == "2 contacts"


def test_a_failed_command_from_before_the_recording_is_not_saved(
    stuck: Path, tmp_path: Path
) -> None:
    rewritten(stuck, tmp_path / "run.mcap", without=(CommandDequeued,))
    done = save(tmp_path / "run.mcap")
    assert (done.exit_code, "there is nothing to save" in done.output) == (2, True)


def test_a_fork_with_another_seed_continues_until_its_commands_end(tmp_path: Path) -> None:
    play(tmp_path, "motion_forward", "duration=1.4", "command.go.distance=0.6")
    forkable = Forkable(tmp_path / "run.mcap")
    assert [each.stage for each in forkable.recorded.outcome.commands] == ["STARTED"]
    assert [each.stage for each in forkable.fork(Change(seed=3)).outcome.commands] == ["EXECUTED"]


def test_a_recording_without_a_failure_and_other_options_are_refused(tmp_path: Path) -> None:
    play(tmp_path, "motion_forward", *FORWARD)
    done = save(tmp_path / "run.mcap")
    assert (done.exit_code, "there is nothing to save" in done.output) == (2, True)
    done = save(tmp_path / "run.mcap", "--set", "drive.travel_speed=0.6")
    assert (done.exit_code, "--save finds the change" in done.output) == (2, True)
