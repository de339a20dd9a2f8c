"""`rover plan`, as typed, without a rover and against one."""

import json
from io import StringIO
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result
from rich.console import Console

from adapters.cli.main import main
from adapters.mrs.cli.plan_command import COLUMNS, PlanLines, plan_row
from adapters.mrs.cli.plan_command import plan as plan_group
from adapters.mrs.cli.plan_palette import palette
from adapters.mrs.cli.terminal import table
from executive.plans import LEAVES
from executive.plans.plan_xml import read_xml
from executive.values.reports import PlanStatus, PlanUpdate
from tests.mrs.aboard import Aboard
from tests.support.plans import plan

EXAMPLE = Path(__file__).parents[2] / "config" / "plans" / "look-around.xml"

OWN = ["LoopPlace", "Window", "WaitUntil", "WaitFor", "Ask", "Near", "Reachable", "FaultActive"]


def rover(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["plan", *arguments])


def test_a_plan_is_checked_where_no_rover_is(tmp_path: Path) -> None:
    good = rover("check", str(EXAMPLE))
    first, note = good.stdout.splitlines()
    assert (good.exit_code, first) == (0, "look-around: 8 leaves, 10 commands at most")
    assert note.startswith("  line 11: note: Sequence/get there/at least ahead: after a stop")
    bad = tmp_path / "bad.xml"
    bad.write_text(EXAMPLE.read_text().replace("<takePicture", "<takePictures"))
    reported = rover("check", str(bad))
    assert reported.exit_code == 1
    assert "PLAN_UNKNOWN_NODE: line 23: unknown node 'takePictures'" in reported.stderr
    requests = tmp_path / "asks.xml"
    requests.write_bytes(plan('<moveForward distance="{far}" deadline_s="9"/>').content)
    assert rover("check", str(requests)).exit_code == 1
    assert rover("check", str(requests), "--arg", "far=2").exit_code == 0
    assert rover("check", str(requests), "--arg", "far").exit_code == 2
    assert rover("check", str(requests), "--asset", "nobody").exit_code == 2


def test_a_plan_is_proved_or_its_faults_are_named_by_line(tmp_path: Path) -> None:
    good = rover("prove", str(EXAMPLE))
    assert (good.exit_code, good.stdout) == (0, "look-around: proved, 11 states, 43 ticks\n")
    body = """<Sequence>
      <moveForward distance="1" deadline_s="9"/>
      <AlwaysFailure/></Sequence>"""
    bad = tmp_path / "bad.xml"
    bad.write_bytes(plan(body).content)
    found = rover("prove", "--json", str(bad))
    assert found.exit_code == 1
    (fault,) = json.loads(found.stdout)["findings"]
    assert (fault["line"], fault["level"], fault["node"]) == (3, "error", "Sequence")
    late = plan('<Window until="2027-01-01T00:00:00Z"><takePicture deadline_s="9"/></Window>')
    bad.write_bytes(late.content)
    for at, exit_code in (("2026-12-31T00:00:00Z", 0), ("2027-01-01T00:00:09Z", 1)):
        checked = rover("check", "--at", at, "--json", str(bad))
        assert checked.exit_code == exit_code
        assert len(json.loads(checked.stdout)["findings"]) == exit_code
    assert rover("check", "--at", "noon", str(bad)).exit_code == 2
    bad.write_text("no plan")
    assert json.loads(rover("prove", "--json", str(bad)).stdout)["reason"] == "PLAN_NOT_XML"


def test_a_plan_is_steered_as_typed(running: Aboard, tmp_path: Path) -> None:
    to = ("--to", running.uri)
    file = tmp_path / "ahead.xml"
    file.write_bytes(plan('<moveForward distance="{far}" deadline_s="90"/>').content)
    assert rover("submit", str(file), "--arg", "far=3", *to).exit_code == 0
    refused = rover("submit", str(file), "--id", "other", *to)
    assert refused.exit_code == 1
    assert "PLAN_BAD_ARGUMENT: line 3: distance: no value given for {far}" in refused.output
    readme = tmp_path / "README.md"
    readme.write_text("# A plan\n")
    refused = rover("submit", str(readme), *to)
    assert (refused.exit_code, refused.stdout) == (1, "")
    assert refused.stderr.startswith(f"{readme}: 113 PLAN_NOT_XML: line 1: invalid XML: ")
    assert rover("suspend", "ahead", *to).exit_code == 1
    assert "name a plan; suspended: none" in rover("resume", *to).stderr
    surplus = rover("submit", str(file), "--id", "other", "--arg", "far=3", "--arg", "fra=4", *to)
    assert "reads the argument 'fra': did you mean far?" in surplus.output
    assert rover("activate", "ahead", *to).exit_code == 0
    watched = rover("watch", "ahead", *to)
    assert watched.exit_code == 0
    assert "ahead  COMPLETED  1/1 ended  moveForward  completed" in watched.output
    as_json = rover("status", "--json", *to).output
    assert json.loads(as_json) | {"planId": "ahead", "status": "COMPLETED"} == json.loads(as_json)
    status = rover("status", *to).output
    assert "COMPLETED" in status
    assert "1 of 1" in status
    assert rover("abort", "ahead", *to).exit_code == 0
    assert rover("remove", "ahead", *to).exit_code == 0
    assert rover("status", *to).output == "no plans: submit one with `rover plan submit`\n"
    closed = rover("status", "ahead", *to)
    assert (closed.exit_code, closed.stderr) == (1, "Error: NotFound: ahead\n")


def test_watching_a_plan_that_fails_exits_1(running: Aboard, tmp_path: Path) -> None:
    file = tmp_path / "late.xml"
    file.write_bytes(plan('<moveForward distance="50" deadline_s="1"/>').content)
    to = ("--to", running.uri)
    rover("submit", str(file), *to)
    rover("activate", "late", *to)
    assert rover("watch", "late", *to).exit_code == 1


def test_the_suspended_plan_is_resumed_at_a_step(running: Aboard, tmp_path: Path) -> None:
    to = ("--to", running.uri)
    file = tmp_path / "route.xml"
    steps = "".join(f'<moveForward name="wp{n}" distance="90" deadline_s="900"/>' for n in (1, 2))
    file.write_bytes(plan(f"<Sequence>{steps}<takePicture deadline_s='9'/></Sequence>").content)
    for typed in (("submit", str(file)), ("activate", "route"), ("suspend", "route")):
        assert rover(*typed, *to).exit_code == 0
    unknown = rover("resume", "--at", "wp3", *to)
    assert unknown.exit_code == 1
    assert "603 NO_SUCH_STEP" in unknown.output
    assert "remaining steps: Sequence/wp1, Sequence/wp2, Sequence/takePicture" in unknown.output
    resumed = rover("resume", "--at", "takePicture", *to)
    assert resumed.exit_code == 0, resumed.output
    assert "at takePicture, skipping wp1, wp2" in resumed.stdout
    assert rover("watch", "route", *to).exit_code == 0
    assert "3 of 3" in rover("status", *to).output


def test_an_active_plan_is_steered_as_typed(running: Aboard, tmp_path: Path) -> None:
    to = ("--to", running.uri)
    file = tmp_path / "route.xml"
    question = '<Ask name="ditch" question="?" options="go;stay" deadline_s="9000" answer="{a}"/>'
    far = '<moveForward name="far" distance="90" deadline_s="900"/>'
    photo = '<takePicture name="photo" deadline_s="9"/>'
    file.write_bytes(
        plan(f"<Sequence>{far}{question}<Inverter>{photo}</Inverter></Sequence>").content
    )
    assert rover("submit", str(file), *to).exit_code == 0
    nothing = rover("hold", "photo", *to)
    assert nothing.exit_code == 1
    assert "name a plan; activated or executing or suspended: none" in nothing.stderr
    assert rover("hold", "far", "--plan", "route", *to).exit_code == 0
    assert rover("activate", "route", *to).exit_code == 0
    wrong = rover("answer", "ditch", "fly", *to)
    assert wrong.exit_code == 1
    assert "118 NO_SUCH_OPTION: plan:route/Sequence/ditch: 'fly' is no option" in wrong.output
    for typed in (("answer", "ditch", "go"), ("skip", "far"), ("skip", "photo", "--failure")):
        steered = rover(*typed, *to)
        assert steered.exit_code == 0, steered.output
    late = rover("retry", "far", *to)
    assert late.exit_code == 1
    assert "206 PLAN_STATUS" in late.output
    rover("resume", *to)
    assert rover("watch", "route", *to).exit_code == 0
    assert "2 of 2" in rover("status", *to).output


def update(node: str, text: str) -> PlanUpdate:
    return PlanUpdate("look", PlanStatus.EXECUTING, 1.7e9, node, done=1, total=3, text=text)


def test_a_remark_on_a_leaf_is_printed_once_and_short() -> None:
    lines = PlanLines()
    late = "plan:look/a: not done within 3 s"
    first = lines.line(update("plan:look/a", late))
    assert first.endswith("look  EXECUTING  1/3 ended  a  not done within 3 s")
    assert lines.line(update("plan:look/b", late)).endswith("1/3 ended  b")
    assert lines.line(update("plan:look/b", "completed")).endswith("b  completed")


def test_plans_fit_a_narrow_terminal() -> None:
    reported = StringIO()
    maximum = "plan:look/Fallback/takePicture"
    rows = [plan_row(update(maximum, f"{maximum}: CANCELLED"))]
    Console(file=reported, width=80).print(table(rows, *COLUMNS))
    assert "Fallback/takePicture   CANCELLED" in reported.getvalue()
    assert "plan:look" not in reported.getvalue()


def test_assets_are_completed() -> None:
    check = plan_group.commands["check"]
    (asset,) = (each for each in check.params if each.name == "asset")
    found = asset.shell_complete(click.Context(check), "j")
    assert [each.value for each in found] == ["jackal"]


def test_to_watch_needs_no_plan() -> None:
    assert "watch [OPTIONS] [PLAN]" in rover("watch", "--help").output


@pytest.mark.parametrize("name", list(plan_group.commands))
def test_every_sub_command_has_an_example(name: str) -> None:
    assert f"  rover plan {name}" in rover(name, "--help").output


def test_the_nodes_for_groot2_are_all_there_are() -> None:
    assert rover("nodes").output == palette()
    (model,) = read_xml(palette().encode()).children
    assert [node.attributes["ID"] for node in model.children] == [*OWN, *LEAVES]
    roles = {node.attributes["ID"]: node.tag for node in model.children}
    assert (roles["Window"], roles["Near"], roles["Ask"]) == ("Decorator", "Condition", "Action")
    (picture,) = (node for node in model.children if node.attributes["ID"] == "takePicture")
    ports = {port.attributes["name"]: port.tag for port in picture.children}
    assert (ports["reason"], ports["file"]) == ("output_port", "output_port")
