"""The nodes of a plan, as the MRS and the command line show them."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from adapters.cli.main import main
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AreaError
from executive.commands import ActivatePlan, SubmitPlan
from executive.values.plan_nodes import NodeStatus
from tests.mrs.aboard import Aboard, raises
from tests.support.plans import AHEAD, plan

pytestmark = pytest.mark.usefixtures("running")


def rover(*arguments: str) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(main, ["plan", *arguments])


QUESTION = plan("""<Sequence>
  <Ask name="ditch" question="Cross it?" options="cross;turn back" default="turn back"
       deadline_s="600" answer="{way}"/>
  <moveForward distance="1" deadline_s="60"/>
</Sequence>""")


async def test_the_nodes_of_a_plan_are_reported(client: MrsClient) -> None:
    with raises(AreaError.NOT_FOUND.value):
        await client.get_plan_nodes("survey")
    await client.run(client.command(SubmitPlan(QUESTION)))
    nodes = await client.get_plan_nodes("survey")
    assert [(each.kind, each.line) for each in nodes] == [
        ("SubTree", 2),
        ("Sequence", 3),
        ("Ask", 4),
        ("moveForward", 6),
    ]
    assert {each.status for each in nodes} == {NodeStatus.IDLE}
    assert [each.tries for each in nodes] == [0] * 4
    await client.run(client.command(ActivatePlan("survey")))


def test_the_status_of_a_named_plan_lists_its_nodes(running: Aboard, tmp_path: Path) -> None:
    file, to = tmp_path / "crossing.xml", ("--to", running.uri)
    file.write_bytes(QUESTION.content)
    for typed in (("submit", str(file)), ("activate", "crossing")):
        assert rover(*typed, *to).exit_code == 0
    running.run(1.0)
    shown = rover("status", "crossing", *to).output
    (row,) = (line for line in shown.splitlines() if "ditch (Ask)" in line)
    assert "RUNNING" in row
    assert "Cross it?" in row
    (found,) = map(json.loads, rover("status", "crossing", "--json", *to).output.splitlines())
    ditch = next(each for each in found["nodes"] if each["path"].endswith("ditch"))
    assert ditch["question"]["options"] == ["cross", "turn back"]
    assert ditch["next"] == ditch["question"]["until"]
    assert rover("answer", "ditch", "turn back", *to).exit_code == 0
    assert rover("watch", "crossing", *to).exit_code == 0
    why = CliRunner().invoke(main, ["why", "ditch", *to]).output
    assert why.startswith("Sequence/ditch ended last with SUCCESS\n")
    assert "Sequence/ditch answered turn back" in why
    unknown = CliRunner().invoke(main, ["why", "nothing", *to])
    assert unknown.exit_code == 2
    assert "'nothing' is neither NUMBER nor SOURCE:NUMBER, and no node" in unknown.output
    ended = rover("status", "crossing", *to).output
    assert "answered turn back" in ended
    assert ended.count("SUCCESS") == 4


@pytest.mark.parametrize("utc", ["9999-12-31T23:59:59Z", "1e300"])
async def test_times_beyond_those_of_the_wire_are_reported(client: MrsClient, utc: str) -> None:
    body = f'<Window until="{utc}"><WaitUntil utc="{utc}"/></Window>'
    await client.run(client.command(SubmitPlan(plan(f"<Sequence>{body}{AHEAD}</Sequence>"))))
    await client.run(client.command(ActivatePlan("survey")))
    nodes = await client.get_plan_nodes("survey")
    while nodes[0].status is NodeStatus.IDLE:
        nodes = await client.get_plan_nodes("survey")
    assert [each.kind for each in nodes] == [
        "SubTree",
        "Sequence",
        "Window",
        "WaitUntil",
        "moveForward",
    ]


def test_a_narrow_table_of_nodes_has_long_texts_below(running: Aboard, tmp_path: Path) -> None:
    file, to = tmp_path / "crossing.xml", ("--to", running.uri)
    file.write_bytes(QUESTION.content)
    for typed in (("submit", str(file)), ("activate", "crossing")):
        assert rover(*typed, *to).exit_code == 0
    running.run(1.0)
    run = CliRunner(env={"COLUMNS": "60"}).invoke
    shown = run(main, ["plan", "status", "crossing", *to]).output.splitlines()
    (at,) = (i for i, line in enumerate(shown) if "    ditch (Ask)  " in line)
    assert shown[at + 1].strip() == "Cross it? (cross or turn back, else turn back)"
    assert "tries" in shown[at - 3]
    assert "    moveForward" in shown
    assert max(map(len, shown[at:])) <= 60


def test_steering_that_is_not_executed_yet_is_reported(running: Aboard, tmp_path: Path) -> None:
    file, to = tmp_path / "crossing.xml", ("--to", running.uri)
    file.write_bytes(QUESTION.content)
    assert rover("submit", str(file), *to).exit_code == 0
    for typed in (("answer", "ditch", "cross"), ("hold", "moveForward")):
        assert rover(*typed, "--plan", "crossing", *to).exit_code == 0
    shown = rover("status", "crossing", *to).output
    assert "answered cross in advance" in shown
    assert "the plan is suspended before it begins" in shown
    assert rover("activate", "crossing", *to).exit_code == 0
    running.run(1.0)
    shown = rover("status", "crossing", *to).output
    assert "answered cross" in shown
    assert "in advance" not in shown
    assert "before it begins" not in shown.partition("node  ")[2]
