import json
from functools import partial
from io import StringIO
from math import pi
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from executive.motion.locomotion import Bounds
from executive.motion.polylines import initial_guesses
from executive.values.geometry import Pose
from tests.benchmarks import console_fleet, console_soak, mal
from tests.benchmarks.commands import bench
from tests.benchmarks.competitors import COMPETITORS
from tests.benchmarks.locomotion import OWN_GOALS, read_goals
from tests.benchmarks.lower_bound import lower_bound_s
from tests.support.browser import BROWSER, REQUIRED
from tests.support.figures import Figure, Goal, quantile, table

ALL = Goal(24.0, at_least=True)
NONE = Goal(0.0)
GOALS = {
    "limits": {
        "travel_speed_mps": 1.0,
        "rotate_speed_radps": 1.5,
        "travel_acceleration_mps2": 1.0,
        "rotate_acceleration_radps2": 3.0,
    },
    "goals": [
        {
            "id": "mine",
            "x_m": 1,
            "y_m": 0.0,
            "heading_rad": 0.0,
            "best_known_time_s": 2.0,
            "lower_bound_s": 2.0,
        }
    ],
}


def test_a_strangers_goals_are_driven_and_written_down(tmp_path: Path) -> None:
    (tmp_path / "goals.json").write_text(json.dumps(GOALS))
    out = tmp_path / "figures.json"
    result = CliRunner().invoke(
        bench, ["locomotion", "--goals", str(tmp_path / "goals.json"), "--json", str(out)]
    )
    assert result.exit_code == 0, result.output
    rows = {row["name"]: row for row in json.loads(out.read_text())}
    times = rows["turn-drive: sum of times"]
    assert 0.98 < times["value"] < 1.2
    assert times["unit"] == "ratio"
    assert times["goal"] == {"bound": 1.45, "at_least": False}
    assert times["met"] is True


@pytest.mark.parametrize("name", ["mpc", "brick"])
def test_previews_are_compared_with_the_results_of_the_motions(tmp_path: Path, name: str) -> None:
    out = tmp_path / "figures.json"
    arguments = ["previews", "--motions", "2", "--controller", name, "--seed", "1"]
    result = CliRunner().invoke(bench, [*arguments, "--json", str(out)])
    rows = {row["name"]: row["value"] for row in json.loads(out.read_text())}
    assert result.exit_code in (0, 1), result.output
    assert rows[f"{name}: refused or failed"] == 0
    assert 0.0 < rows[f"{name}: duration off, median"] < 5.0
    assert rows[f"{name}: end within two sigma"] >= 75


def test_mpc_is_measured_with_its_planning(tmp_path: Path) -> None:
    (tmp_path / "goals.json").write_text(json.dumps(GOALS))
    out = tmp_path / "figures.json"
    goals = ["--goals", str(tmp_path / "goals.json")]
    result = CliRunner().invoke(
        bench, ["locomotion", "--controller", "mpc", *goals, "--json", str(out)]
    )
    assert result.exit_code in (0, 1), result.output  # how long plans take depends on the machine
    values = {row["name"]: row["value"] for row in json.loads(out.read_text())}
    assert values["mpc: goals done, to 3 cm and 2°"] == 1
    assert values["mpc: sum of times"] > 1.0
    assert values["mpc: first plan, worst"] > 0.0
    assert values["mpc: plan of a tick, median"] > 0.0


def test_controllers_are_listed_side_by_side_and_each_is_drawn(tmp_path: Path) -> None:
    goals = [GOALS["goals"][0], GOALS["goals"][0] | {"id": "back", "x_m": -0.5, "y_m": 0.2}]  # type: ignore[index]
    (tmp_path / "goals.json").write_text(json.dumps(GOALS | {"goals": goals}))
    names = ["turn-drive", *COMPETITORS]
    requested = [word for name in names for word in ("--controller", name)]
    paths = ["--goals", str(tmp_path / "goals.json"), "--json", str(tmp_path / "figures.json")]
    result = CliRunner().invoke(
        bench, ["locomotion", *requested, *paths, "--max-ratio", "9", "--plots", str(tmp_path)]
    )
    assert result.exit_code == 0, result.output
    rows = json.loads((tmp_path / "figures.json").read_text())
    assert [row["name"] for row in rows[: len(names)]] == [
        f"{name}: goals done, to 3 cm and 2°" for name in names
    ]
    values = {row["name"]: row["value"] for row in rows}
    for name in names:
        assert values[f"{name}: goals done, to 3 cm and 2°"] == 2
        assert values[f"{name}: sum of times over bound"] > 1.0
        assert values[f"{name}: true error, worst"] < 13.0
        assert values[f"{name}: energy, median"] > 0.0
        assert (tmp_path / f"locomotion-{name}.svg").read_text().count("back") == 1
    assert values["turn-drive: sum of times"] < values["proportional: sum of times"]
    assert [row["goal"] for row in rows if row["name"].startswith("mppi")] == [None] * 15


def test_a_folder_for_drawings_has_to_be_there(tmp_path: Path) -> None:
    result = CliRunner().invoke(bench, ["locomotion", "--plots", str(tmp_path / "none")])
    assert result.exit_code == 2
    assert "none" in result.output


TRAVEL, ROTATE = Bounds(1.0, 1.0), Bounds(1.5, 3.0)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    x_m=st.floats(-6.0, 6.0),
    y_m=st.floats(-6.0, 6.0),
    from_rad=st.floats(-pi, pi),
    to_rad=st.floats(-pi, pi),
)
def test_no_motion_is_faster_than_the_lower_bound(
    x_m: float, y_m: float, from_rad: float, to_rad: float
) -> None:
    start, end = Pose(heading_rad=from_rad), Pose(x_m, y_m, heading_rad=to_rad)
    bound_s = lower_bound_s(start, end, TRAVEL, ROTATE)
    motions = initial_guesses(start.point, from_rad, end.point, to_rad, TRAVEL, ROTATE)
    assert all(each.duration_s >= bound_s - 1e-3 for each in motions)
    assert lower_bound_s(start, end, TRAVEL, ROTATE, 0.03, 0.03) <= bound_s + 1e-3


def test_the_lower_bound_is_that_of_the_goals_file() -> None:
    rows = json.loads(OWN_GOALS.read_text())["goals"]
    ends = [Pose(row["x_m"], row["y_m"], heading_rad=row["heading_rad"]) for row in rows]
    found_s = [lower_bound_s(Pose(), end, TRAVEL, ROTATE) for end in ends]
    assert found_s == pytest.approx([row["lower_bound_s"] for row in rows], rel=0.025)
    best_s = [row["best_known_time_s"] for row in rows]
    assert all(low <= high + 1e-3 for low, high in zip(found_s, best_s, strict=True))


def test_a_missed_goal_is_named_and_ends_with_1(tmp_path: Path) -> None:
    hard = GOALS | {"goals": [GOALS["goals"][0] | {"best_known_time_s": 0.5}]}  # type: ignore[index]
    (tmp_path / "goals.json").write_text(json.dumps(hard))
    result = CliRunner().invoke(bench, ["locomotion", "--goals", str(tmp_path / "goals.json")])
    assert result.exit_code == 1
    assert "goals missed: turn-drive: sum of times" in result.output


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not JSON"),
        ("[]", "must be an object"),
        ('{"limits": {}, "goals": []}', "one goal at least"),
        (json.dumps(GOALS | {"limits": {"travel_speed_mps": 1}}), "rotate_speed_radps"),
        (json.dumps(GOALS | {"goals": [{"id": "x"}]}), "x_m"),
        (json.dumps(GOALS | {"goals": [GOALS["goals"][0] | {"x_m": float("nan")}]}), "[0].x_m"),  # type: ignore[index]
        (json.dumps(GOALS | {"goals": [3]}), "goals"),
        (
            json.dumps(GOALS | {"limits": GOALS["limits"] | {"travel_speed_mps": -1}}),  # type: ignore[operator]
            "travel_speed_mps must be above 0",
        ),
    ],
)
def test_a_goals_file_that_cannot_be_gets_one_error(
    tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "goals.json").write_text(text)
    result = CliRunner().invoke(bench, ["locomotion", "--goals", str(tmp_path / "goals.json")])
    assert result.exit_code == 2
    assert message in result.output
    assert "goals.json" in result.output
    assert "Traceback" not in result.output


def test_a_missing_goals_file_and_an_unknown_controller_are_named(tmp_path: Path) -> None:
    missing = CliRunner().invoke(bench, ["locomotion", "--goals", str(tmp_path / "none.json")])
    assert missing.exit_code == 2
    assert "none.json" in missing.output
    unknown = CliRunner().invoke(bench, ["locomotion", "--controller", "psychic"])
    assert unknown.exit_code == 2
    assert "turn-drive" in unknown.output


def test_a_missing_folder_for_figures_is_named_before_any_measurement(
    tmp_path: Path,
) -> None:
    result = CliRunner().invoke(bench, ["lockstep", "--json", str(tmp_path / "none" / "f.json")])
    assert result.exit_code == 2
    assert "there is no folder" in result.output
    assert "lock step:" not in result.output


def test_our_own_goals_are_24_with_limits() -> None:
    goals = read_goals(OWN_GOALS)
    assert len(goals.goals) == 24
    assert goals.limits.rotate_speed_radps == 1.5


def test_the_tick_of_a_plan_is_measured(tmp_path: Path) -> None:
    out = tmp_path / "figures.json"
    result = CliRunner().invoke(bench, ["plan-tick", "--batches", "5", "--json", str(out)])
    assert result.exit_code in (0, 1), result.output
    rows = {row["name"]: row["value"] for row in json.loads(out.read_text())}
    assert 0.1 < rows["plan: tick / tick of py_trees"] < 1.0
    assert rows["plan: stored state"] < 4096


def test_lock_step_repeats_and_a_small_storm_breaks_nothing() -> None:
    result = CliRunner().invoke(bench, ["storm", "--commands", "500", "--seed", "3"])
    assert result.exit_code == 0, result.output
    assert result.output.count("met") >= 4


@pytest.mark.busy
@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain", "warm_children")
@pytest.mark.parametrize(
    ("requested", "figures"),
    [
        (("echo",), {"stop to zero, median", "echo, median"}),
        (
            ("stop", "--while", "nothing"),
            {"nothing else: aboard after, p99", "nothing else: stands after, max"},
        ),
    ],
)
def test_a_stop_is_measured_over_real_processes(
    requested: tuple[str, ...], figures: set[str], tmp_path: Path
) -> None:
    out = tmp_path / "figures.json"
    result = CliRunner().invoke(bench, [*requested, "--samples", "10", "--json", str(out)])
    assert out.is_file(), result.output
    assert result.exit_code in (0, 1), result.output
    values = {row["name"]: row["value"] for row in json.loads(out.read_text())}
    assert all(0.0 < values[name] < 10_000.0 for name in figures)


def test_a_condition_of_the_stop_that_is_not_there_is_named() -> None:
    result = CliRunner().invoke(bench, ["stop", "--while", "raining"])
    assert result.exit_code == 2
    assert "raining: one of nothing, fetch" in result.output


def test_the_mal_is_measured_over_real_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mal, "measure", partial(mal.measure, samples=300, transfers=1))
    out = tmp_path / "figures.json"
    result = CliRunner().invoke(
        bench, ["mal", "--seconds", "1", "--subscribers", "10", "--json", str(out)]
    )
    assert result.exit_code in (0, 1), result.output
    rows = {row["name"]: row for row in json.loads(out.read_text())}
    assert rows["REQUEST, median"]["value"] > 0.0
    assert rows["NOTIFY to 10, lost"]["value"] == 0
    assert rows["PROGRESS over plain TCP"]["goal"] == {"bound": 0.5, "at_least": True}


def test_a_row_of_figures_is_a_line_of_80_columns() -> None:
    figures = [
        Figure("turn-drive-trapezoid: goals done, to 3 cm and 2°", 23.0, "goals", "24 goals", ALL),
        Figure("storm: motion while stopped or safe", 12345.6, "commands", "24 goals", NONE),
        Figure("executive over bare node, CPU", 1.234, "ratio", "bare node", Goal(1.5)),
    ]
    console = Console(width=80, file=StringIO())
    console.print(table(figures))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert max(map(len, lines)) <= 80
    assert [line.split()[-1] for line in lines if "≤" in line or "≥" in line] == ["1", "1", "2"]
    assert [line.split(maxsplit=1) for line in lines[-2:]] == [
        ["*1", "24 goals"],
        ["*2", "bare node"],
    ]


def test_goals_have_a_side_and_quantiles_a_rank() -> None:
    assert Figure("speed", 51.0, "×", goal=Goal(50.0, at_least=True)).met
    assert not Figure("time", 1.36, "ratio", goal=Goal(1.35)).met
    assert Figure("time", 1.36, "ratio").met is None
    assert quantile([3.0, 1.0, 2.0], 0.5) == 2.0
    assert quantile([3.0, 1.0, 2.0], 0.99) == 3.0


def test_a_console_is_measured_with_its_pages(tmp_path: Path) -> None:
    out = tmp_path / "figures.json"
    arguments = ["console", "--pages", "2", "--seconds", "1", "--json", str(out)]
    result = CliRunner().invoke(bench, arguments)
    assert result.exit_code in (0, 1), result.output  # the CPU is that of a loaded machine
    values = {row["name"]: row["value"] for row in json.loads(out.read_text())}
    assert values["console: values sent"] > 0
    assert 0 < values["console: value to page, p50"] < 60_000


@pytest.mark.slow
def test_a_console_is_measured_with_many_rovers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console_fleet, "SETTLE_S", 0.2)
    out = tmp_path / "figures.json"
    arguments = ["console-fleet", "--rovers", "2", "--values", "60", "--pages", "1"]
    result = CliRunner().invoke(bench, [*arguments, "--seconds", "1", "--json", str(out)])
    assert result.exit_code in (0, 1), result.output
    values = {row["name"]: row["value"] for row in json.loads(out.read_text())}
    assert values["fleet: values"] > 0
    assert -1e-9 < values["fleet: CPU"] < 100  # told in steps of 10 ms: a second may show none
    assert values["fleet: memory"] > 0


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium")
def test_a_page_that_stays_open_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console_soak, "SETTLE_S", 0.2)
    out = tmp_path / "figures.json"
    arguments = ["console-soak", "--commands", "2", "--seconds", "2", "--json", str(out)]
    result = CliRunner().invoke(bench, arguments)
    assert result.exit_code in (0, 1), result.output
    values = {row["name"]: row["value"] for row in json.loads(out.read_text())}
    assert 1.0 < values["soak: heap at last"] < 100.0
    assert values["soak: elements at last"] > 100
    assert values["soak: CPU at last"] > 0


@pytest.mark.busy
@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain", "warm_children")
@pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium")
def test_the_pages_of_a_console_are_measured_in_a_browser(tmp_path: Path) -> None:
    out = tmp_path / "figures.json"
    arguments = ["console-page", "--loads", "1", "--samples", "3", "--pages", "1"]
    result = CliRunner().invoke(bench, [*arguments, "--seconds", "1", "--json", str(out)])
    assert result.exit_code in (0, 1), result.output
    values = {row["name"]: row["value"] for row in json.loads(out.read_text())}
    assert 0.5 < values["whole page: loads"] < 1.4
    assert 0 < values["light page: loads"] < 0.2
    for name in ("whole page: value, p50", "light page: value, p50", "picture, p50"):
        assert 0 < values[name] < 60_000
