"""What the map of a console asks for: other clients' arguments, steps of plans, obstacles."""

from math import pi
from pathlib import Path

import pytest

from adapters.console.requests.map_requests import route_of
from adapters.mrs.ground import MrsClient
from executive.commands import FollowPath, PlanDefinition, SubmitPlan, Waypoint
from executive.plans import PlanNode, check_plan
from executive.settings import load_settings
from executive.values.geometry import Pose
from tests.console.consoles import JsonMessage, at_console
from tests.mrs.aboard import Aboard
from tests.support.plans import plan

SURVEY = """<Sequence>
  <moveForward distance="1" deadline_s="60"/>
  <Repeat num_cycles="2"><moveTo x="3" y="0" deadline_s="60"/></Repeat>
  <takePicture deadline_s="60"/>
  <moveForward distance="1" deadline_s="60"/>
  <followPath waypoints="4,0;4,1" deadline_s="60"/>
</Sequence>"""


async def test_a_page_gets_what_another_client_commanded(rover: Aboard, tmp_path: Path) -> None:
    """Over a direct link the console requests the arguments once per command."""
    definition = plan('<moveTo x="2" y="1" deadline_s="60"/>')
    async with (
        at_console(tmp_path, rover.uri, "anna") as (anna,),
        await MrsClient.connect(rover.uri) as terminal,
    ):
        await anna.page.is_up()

        def has(message: JsonMessage, **args: object) -> bool:
            return (message["ty"], message.get("args")) == ("cmd", args)

        path = FollowPath((Waypoint(0.5, 0.0), Waypoint(1.0, 0.0)))
        await terminal.submit(terminal.command(path, source="TER"))
        waypoints = [{"x": 0.5, "y": 0.0}, {"x": 1.0, "y": 0.0}]
        found = await anna.page.until(lambda message: has(message, waypoints=waypoints))
        assert (found["by"], found["name"]) == ("TER", "followPath")
        await anna.page.command(found["id"], "executed")
        await terminal.run(terminal.command(SubmitPlan(definition), source="TER"))
        (step,) = (await anna.get("api/plans/jackal/survey/steps"))["steps"]
        assert (step["name"], step["args"]) == ("moveTo", {"x": 2.0, "y": 1.0})
        assert (step["frame"], step["points"]) == ("odom", [[2.0, 1.0]])
        await anna.send("go", "activatePlan", plan_id="survey")
        found = await anna.page.until(lambda message: has(message, x=2.0, y=1.0))
        assert (found["by"], found["name"]) == ("plan:survey", "moveTo")
        assert (await anna.get("api/obstacles/jackal")) == {"obstacles": []}
        assert (await anna.request("GET", "api/plans/jackal/none/steps"))[0] == 501
        wrong = await anna.request("GET", "api/plans/jackal/survey/steps?start=1,2")
        assert (wrong[0], wrong[1]["field"]) == (422, "start")


def root(definition: PlanDefinition) -> PlanNode:
    found = check_plan(definition, load_settings("jackal"))
    assert isinstance(found, PlanNode)
    return found


def test_the_targets_of_a_plan_follow_one_another() -> None:
    settings = load_settings("jackal")
    start = Pose(1.0, 1.0, heading_rad=-pi / 2)
    steps = list(route_of(root(plan(SURVEY)), settings, start))
    assert [each.name for each in steps] == [
        *("moveForward", "moveTo", "moveTo", "takePicture", "moveForward", "followPath")
    ]
    expected = [[(1.0, 0.0)], [(3.0, 0.0)], [], [], [(4.0, 0.0)], [(4.0, 1.0)]]
    for each, points in zip(steps, expected, strict=True):
        assert each.points == pytest.approx([pytest.approx(point) for point in points])
    assert [each.points for each in route_of(root(plan(SURVEY)), settings, None)][:2] == [
        (),  # a start that is unknown
        ((3.0, 0.0),),
    ]
