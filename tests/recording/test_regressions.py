"""Recordings in a folder that decide differently are grouped by their first different decision."""

import json
import shutil
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from adapters.recording import RunFile
from adapters.recording.commands import BAD_FILE, DIFFERS, SAME
from adapters.recording.commands import replay as replay_command
from executive.commands import DriveFor, MoveForward, Request
from executive.motion import Arbiter
from executive.motion.velocity_control import DriveLaw
from executive.settings import config_folder
from executive.values.geometry import STANDING, Velocity
from executive.values.reports import Identity
from tests.support.kinematic import Bench

Patch = pytest.MonkeyPatch
END = "FAILED WHEELS_OFF_COMMAND (faults.wheels_off_command)"


def typed(*arguments: object, judge: bool = False) -> Result:
    options = [*map(str, arguments), "--judge" if judge else "--no-judge"]
    return CliRunner().invoke(replay_command, options, catch_exceptions=False)


def document(*arguments: object) -> tuple[int, dict[str, Any]]:
    reported = typed(*arguments, "--json")
    shown: dict[str, Any] = json.loads(reported.stdout)
    return reported.exit_code, shown


def rows(reported: Result) -> list[list[str]]:
    """Return the cells of the table."""
    lines = [line for line in reported.output.splitlines() if line.startswith("| ")][1:]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def changed(folder: Path, old: str, new: str) -> Path:
    """Return the settings of the Jackal with another text."""
    text = (config_folder() / "jackal.yaml").read_text()
    assert old in text
    path = folder / "changed.yaml"
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder of recordings of a rover without physics: two drives, and one held velocity."""
    folder = tmp_path_factory.mktemp("drives")
    requests: list[Request] = [MoveForward(0.2), MoveForward(0.3), DriveFor(0.2, 0.1, 0.5)]
    for number, request in enumerate(requests):
        with (
            closing(RunFile(folder / f"{number}.mcap")) as tape,
            Bench(folder / str(number), tape=tape) as bench,
        ):
            bench.execute(request, 1)
    return folder


def test_settings_are_grouped_by_the_fault_that_no_longer_ends_a_command(
    stuck: Path, tmp_path: Path
) -> None:
    runs = tmp_path / "runs"
    for name in ("one", "two"):
        (runs / name).mkdir(parents=True)
        shutil.copy(stuck, runs / name)
    ignoring = changed(
        tmp_path, "\nfaults:\n", "\nfaults:\n  wheels_off_command: {reaction: ignore}\n"
    )
    reported = typed(runs, "--with", ignoring)
    assert reported.exit_code == DIFFERS
    path = runs / "one" / "run.mcap"
    assert rows(reported) == [["2", "moveForward", "nothing", END, "", "", f"{path}, 2.25 s"]]
    assert reported.output.endswith("\n\n0 of 2 recordings decide the same\n")


def test_an_earlier_end_is_a_decision_that_is_not_recorded(stuck: Path, tmp_path: Path) -> None:
    earlier = changed(tmp_path, "\nfaults:\n", "\nfaults:\n  wheels_off_command: {window: 0.1}\n")
    (row,) = rows(typed(stuck, "--with", earlier, "--markdown"))
    assert row[1:4] == ["moveForward", END, "nothing"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\nfaults:\n", "\n# A comment.\nfaults:\n"),
        ("battery_low: {below: 22.0}", "battery_low: {below: 21.0}"),
    ],
)
def test_settings_that_no_run_uses_decide_the_same(
    old: str, new: str, stuck: Path, tmp_path: Path
) -> None:
    reported = typed(stuck.parent, "--with", changed(tmp_path, old, new))
    assert (reported.exit_code, reported.output) == (SAME, "1 of 1 recordings decide the same\n")


def _other_gain(patch: Patch) -> None:
    want = DriveLaw.intent

    def less(law: DriveLaw, now_s: float) -> Velocity:
        wanted = want(law, now_s)
        return replace(wanted, travel_mps=0.9 * wanted.travel_mps)

    patch.setattr(DriveLaw, "intent", less)


def _standing(patch: Patch) -> None:
    patch.setattr(DriveLaw, "intent", lambda *_: STANDING)


def _raises(patch: Patch) -> None:
    patch.setattr(Arbiter, "commit", lambda *_: 1 / 0)


@pytest.mark.parametrize(
    ("plant", "decision", "has_figure"),
    [
        (_other_gain, "velocity: travel slower", True),
        (_standing, "velocity: travel stopped", False),
    ],
)
def test_a_changed_law_is_grouped_by_the_velocity(
    plant: Callable[[Patch], None],
    decision: str,
    has_figure: bool,
    drives: Path,
    monkeypatch: Patch,
) -> None:
    plant(monkeypatch)
    status, shown = document(drives)
    assert (status, shown["recordings"], shown["same"]) == (DIFFERS, 3, 1)
    (group,) = shown["groups"]
    assert (group["command"], group["replayed"], group["recorded"]) == ("moveForward", decision, "")
    assert (-0.1 < group["change"] < 0.0) if has_figure else group["change"] is None
    assert [Path(each["path"]).stem for each in group["recordings"]] == ["0", "1"]


def test_a_core_that_raises_is_a_group(drives: Path, monkeypatch: Patch) -> None:
    _raises(monkeypatch)
    _, shown = document(drives)
    (group,) = shown["groups"]
    assert group["replayed"].startswith("ZeroDivisionError: division by zero (line ")
    assert len(group["recordings"]) == 3


def test_changed_texts_are_a_group_of_their_own(drives: Path, monkeypatch: Patch) -> None:
    monkeypatch.setattr(Identity, "__str__", lambda identity: f"no. {identity.command_id}")
    (row,) = rows(typed(drives))
    assert row[:4] == ["3", "", "only texts or figures differ", ""]


def test_recordings_are_replayed_in_several_processes(drives: Path, tmp_path: Path) -> None:
    for number in range(3):
        shutil.copytree(drives, tmp_path / str(number))
    reported = typed(tmp_path, "--jobs", 2)
    assert (reported.exit_code, reported.output) == (SAME, "9 of 9 recordings decide the same\n")


def test_files_that_cannot_be_used_are_named_and_the_others_are_replayed(
    drives: Path, flushed: Path, tmp_path: Path
) -> None:
    runs = shutil.copytree(drives, tmp_path / "runs")
    (runs / "text.mcap").write_text("no recording")
    cut = runs / "cut.mcap"
    cut.write_bytes(flushed.read_bytes()[:-20_000])
    reported = typed(runs)
    assert reported.exit_code == BAD_FILE
    assert f"- not used: {runs}/text.mcap: is no MCAP file, or damaged" in reported.output
    assert f"- {cut}: truncated or damaged, compared up to " in reported.output
    assert reported.output.endswith("\n4 of 5 recordings decide the same\n")
    status, shown = document(runs, "--with", "mocup")
    assert (status, shown["same"], shown["groups"]) == (BAD_FILE, 0, [])
    assert "is of jackal, not of mocup" in shown["unusable"][0]["error"]


def test_each_difference_is_judged_by_its_fork(stuck: Path, tmp_path: Path) -> None:
    ignoring = changed(
        tmp_path, "\nfaults:\n", "\nfaults:\n  wheels_off_command: {reaction: ignore}\n"
    )
    reported = typed(stuck.parent, "--with", ignoring, judge=True)
    assert reported.exit_code == DIFFERS
    (row,) = rows(reported)
    assert row[5] == "1 same"
    _, shown = document(stuck, "--with", ignoring)
    assert shown["groups"][0]["recordings"][0]["verdict"] == ""


def test_without_the_simulation_nothing_is_judged(
    stuck: Path, tmp_path: Path, monkeypatch: Patch
) -> None:
    monkeypatch.setattr("adapters.recording.regressions.find_spec", lambda _: None)
    slower = changed(tmp_path, "travel_speed_mps: 1.0", "travel_speed_mps: 0.9")
    reported = typed(stuck.parent, "--with", slower, judge=True)
    assert rows(reported)[0][5] == "1 not judged"
    assert "is not installed: pip install 'rover-executive[sim]'" in reported.output


def test_the_extra_sim_alone_judges(stuck: Path, tmp_path: Path, monkeypatch: Patch) -> None:
    monkeypatch.setattr(
        "adapters.recording.regressions.find_spec",
        lambda name: None if name == "scipy" else find_spec(name),  # of the extra campaign
    )
    slower = changed(tmp_path, "travel_speed_mps: 1.0", "travel_speed_mps: 0.9")
    reported = typed(stuck.parent, "--with", slower, judge=True)
    assert "not judged" not in reported.output


def test_a_fork_that_fails_is_named(stuck: Path, tmp_path: Path, monkeypatch: Patch) -> None:
    monkeypatch.setattr("adapters.recording.regressions.JUDGE", "sim.fork.none")
    slower = changed(tmp_path, "travel_speed_mps: 1.0", "travel_speed_mps: 0.9")
    reported = typed(stuck.parent, "--with", slower, judge=True)
    assert "- not judged: " in reported.output
    assert "the fork failed: " in reported.output
    assert "No module named sim.fork.none" in reported.output
