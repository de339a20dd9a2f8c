"""`rover plan try`: plans are executed in lock step under drawn conditions, and repeat."""

import json
import shlex
from base64 import b64encode
from io import StringIO
from pathlib import Path
from typing import Any, Final

import pytest
from click.testing import CliRunner, Result

from adapters.mrs.cli.plan_command import plan
from adapters.mrs.spec import trial_of
from executive.plans import FORMAT
from sim.trial.__main__ import main

DRIVE: Final = '<moveTo name="there" x="0.4" y="0" deadline_s="30"/>'
COMMAND: Final = '<setStatusInterval interval="5" deadline_s="5"/>'
CHOICES: Final = f"""
<Sequence>
  {COMMAND}
  <Ask name="go" question="Go?" options="yes;no" default="no" deadline_s="300" answer="{{go}}"/>
  <Fallback name="in time">
    <Timeout msec="2000"><Sleep msec="7200000"/></Timeout>
    <WaitFor if="go == 'maybe'" deadline_s="90"/>
    <AlwaysSuccess name="anyway"/>
  </Fallback>
  <Switch2 variable="{{go}}" case_1="yes" case_2="no">
    <AlwaysSuccess name="it goes"/>
    <AlwaysFailure name="it stays"/>
    <AlwaysFailure name="other"/>
  </Switch2>
</Sequence>"""
DRAWS: Final = 6


@pytest.fixture
def no_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no map, which takes a second."""
    monkeypatch.setattr("sim.scenario.pictures.write_run", lambda *_: ())


def _plan(folder: Path, content: str, name: str = "p") -> Path:
    path = folder / f"{name}.xml"
    text = f'<root BTCPP_format="4"><BehaviorTree ID="M">{content}</BehaviorTree></root>'
    path.write_text(text, encoding="utf-8")
    return path


def _try(path: Path, *options: str) -> Result:
    arguments = ["try", str(path), "--jobs", "1", "--out", str(path.parent / "out"), *options]
    return CliRunner().invoke(plan, arguments)


def _report(path: Path, *options: str, status: int = 0) -> dict[str, Any]:
    found = _try(path, "--json", *options)
    assert found.exit_code == status, found.output
    report: dict[str, Any] = json.loads(found.output)
    return report


def test_a_sound_plan_completes_in_all_draws(tmp_path: Path) -> None:
    """Share, figures and clearance are those of its runs; the map of the worst is written."""
    rock = "world.rocks=[{x: 0.4, y: 1.2, radius: 0.5, height: 0.5}]"
    report = _report(_plan(tmp_path, DRIVE), "--draws", "2", "--set", "world=flat", "--set", rock)
    assert (report["draws"], report["completed"]) == (2, 2)
    assert report["share"]["low"] == pytest.approx(0.025**0.5, abs=1e-3)  # Clopper-Pearson
    assert report["share"]["high"] == 1.0
    duration, energy, clearance = report["figures"]
    assert 1.0 < duration["low"] <= duration["median"] <= duration["high"] < 5.0
    assert energy["median"] > 30 * duration["median"]
    assert clearance["median"] == pytest.approx(1.2 - 0.5 - 0.43 / 2, abs=0.05)
    assert not report["failures"]
    [node] = (each for each in report["nodes"] if each["kind"] == "moveTo")
    assert node["success"] == 2
    assert Path(report["worst"]["folder"], "map.png").is_file()


@pytest.mark.usefixtures("no_maps")
def test_drawn_answers_decide_branches_and_repeat(tmp_path: Path) -> None:
    """Answers, deadlines and branches are counted, and a run repeats."""
    path = _plan(tmp_path, CHOICES)
    report = _report(path, "--draws", str(DRAWS), status=1)
    counts = {(each["kind"], each["choice"]): each["count"] for each in report["branches"]}
    answers = {key[1]: count for key, count in counts.items() if key[0] == "Ask"}
    assert answers.keys() == {"answered yes", "answered no", "took the default no"}
    assert sum(answers.values()) == DRAWS
    yes = answers["answered yes"]
    assert counts["Switch2", "took the case 1 it goes"] == yes == report["completed"]
    assert counts["Switch2", "took the case 2 it stays"] == DRAWS - yes
    assert counts["Timeout", "expired"] == counts["WaitFor", "expired"] == DRAWS
    assert counts["Fallback", "took the third branch anyway"] == DRAWS
    [group] = report["failures"]
    assert group["count"] == DRAWS - yes
    assert "it stays" in group["reason"]
    worst = report["worst"]
    assert worst["draw"] in group["draws"]
    _, _, *arguments = shlex.split(worst["command"])
    again = CliRunner().invoke(plan, [*arguments, "--json", "--out", str(tmp_path / "again")])
    repeated = json.loads(again.output)
    assert again.exit_code == 1
    assert repeated["draws"] == 1
    assert repeated["worst"]["digest"] == worst["digest"]
    other = json.loads(_try(path, "--json", "--draw", str(worst["draw"]), "--seed", "1").output)
    assert other["worst"]["digest"] != worst["digest"]


@pytest.mark.usefixtures("no_maps")
def test_choices_are_counted_below_loops_and_not_in_each_tick(tmp_path: Path) -> None:
    """A branch that is taken in each cycle counts each time; a test in each tick counts once."""
    branches = '<Timeout msec="500"><Sleep msec="7000"/></Timeout><Sleep msec="1000"/>'
    tested = '<Fallback name="ok"><AlwaysSuccess/></Fallback>'
    tests = f'<ReactiveSequence>{tested}<Sleep msec="2000"/>'
    loop = f'<Repeat num_cycles="3"><Fallback name="way">{branches}</Fallback></Repeat>'
    path = _plan(tmp_path, f"<Sequence>{COMMAND}{loop}{tests}</ReactiveSequence></Sequence>")
    report = _report(path, "--draws", "1")
    counts = {each["choice"]: each["count"] for each in report["branches"]}
    assert counts == {
        "expired": 3,
        "took the second branch Sleep": 3,
        "took the first branch AlwaysSuccess": 1,
    }
    [found] = (each for each in report["nodes"] if each["node"].endswith("/way"))
    assert (found["success"], found["failure"], found["tries"]) == (1, 0, 3)


@pytest.mark.usefixtures("no_maps")
def test_a_plan_that_ends_while_the_link_is_down_has_ended(tmp_path: Path) -> None:
    """The run ends with the plan, though the ground has not received its end."""
    scenario = tmp_path / "outage.yaml"
    scenario.write_text(
        "title: outage\nduration: 60\ntimeline:\n  - {at: 2, outage: 30}\n"
        "expect:\n  - {rover: stationary, for: 1}\n",
        encoding="utf-8",
    )
    path = _plan(tmp_path, f'<Sequence>{COMMAND}<Sleep msec="5000"/></Sequence>')
    report = _report(path, "--draws", "1", "--scenario", str(scenario))
    assert report["figures"][0]["median"] == pytest.approx(5, abs=0.3)


@pytest.mark.usefixtures("no_maps")
def test_a_refused_begin_is_a_failed_run(tmp_path: Path) -> None:
    """A rover that does not accept the plan ends the run at once, with its reason."""
    report = _report(_plan(tmp_path, DRIVE), "--draws", "1", "--set", "world.charge=0", status=1)
    [group] = report["failures"]
    assert group["status"] == "SUBMITTED"
    assert group["reason"].startswith("refused: ")
    assert "SAFE" in group["reason"]


@pytest.mark.usefixtures("no_maps")
def test_a_plan_with_times_begins_before_them(tmp_path: Path) -> None:
    """Without `--at` the begin is one minute before the first time; with it a wait is late."""
    wait = '<WaitUntil utc="2026-11-27T09:00:00Z" late_s="60"/>'
    path = _plan(tmp_path, f"<Sequence>{COMMAND}{wait}</Sequence>")
    assert _report(path, "--draws", "1")["figures"][0]["median"] == pytest.approx(60, abs=0.2)
    late = _report(path, "--draws", "1", "--at", "2026-11-27T10:00:00Z", status=1)
    assert late["branches"][0]["choice"] == "expired"
    assert "--at" in late["worst"]["command"]


@pytest.mark.parametrize(
    ("content", "options", "text"),
    [
        ('<movTo x="1" y="0" deadline_s="9"/>', (), "did you mean moveTo?"),
        (DRIVE, ("--set", "wold.friction=1"), "no key 'wold.friction'"),
        (DRIVE, ("--set", "friction"), "is not KEY=VALUE"),
        (DRIVE, ("--campaign", "nowhere"), "nowhere"),
        (DRIVE, ("--scenario", "nowhere"), "nowhere"),
    ],
)
def test_unusable_input_is_one_error(
    tmp_path: Path, content: str, options: tuple[str, ...], text: str
) -> None:
    """A refused plan and wrong options exit 2, with one line."""
    found = _try(_plan(tmp_path, content), *options)
    assert found.exit_code == 2
    assert text in found.output
    assert len(found.output.splitlines()) == 1


def test_another_process_gets_the_report_as_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`python -m sim.trial` reads the plan from stdin."""
    content = _plan(tmp_path, COMMAND).read_bytes()
    request = {
        "plan_id": "p",
        "name": "p.xml",
        "format": FORMAT,
        "content_base64": b64encode(content).decode(),
        "arguments": [],
        "asset": "jackal",
        "draws": 2,
        "begin_utc_s": None,
    }
    monkeypatch.setattr("sys.stdin", StringIO(json.dumps(request)))
    with pytest.raises(SystemExit) as left:
        main()
    assert not left.value.code
    report = json.loads(capsys.readouterr().out)
    assert (report["plan"], report["completed"]) == ("p", 2)
    trial = trial_of(report)
    assert (trial.draws, trial.successes, trial.worst) == (2, 2, "draw 0: completed")
    request["content_base64"] = b64encode(b"<root/>").decode()
    monkeypatch.setattr("sys.stdin", StringIO(json.dumps(request)))
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    assert capsys.readouterr().err.startswith("Error: ")
