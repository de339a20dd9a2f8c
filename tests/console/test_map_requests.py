"""What the map of a console asks for: other clients' arguments, steps of plans, obstacles."""

import asyncio
import threading
from math import pi
from pathlib import Path

import pytest

from adapters.console.requests.map_requests import route_of
from adapters.console.rovers import RoverLink, rover_link
from adapters.mrs.ground import MrsClient
from executive.commands import (
    FollowPath,
    MoveForward,
    PlanDefinition,
    SetTravelSpeed,
    SubmitPlan,
    Waypoint,
)
from executive.plans import PlanNode, check_plan, steps
from executive.settings import load_settings
from executive.values.geometry import Pose
from executive.values.reports import Identity
from tests.console.conftest import Launch
from tests.console.consoles import LIMIT_S, JsonMessage, at_console
from tests.mrs.aboard import Aboard, LinkedBench
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
        wrong = await anna.request("GET", "api/plans/jackal/survey/steps?done=all")
        assert (wrong[0], wrong[1]["field"]) == (422, "done")
        assert (await anna.get("api/plans/jackal/survey/steps?done=1")) == {"steps": []}


async def test_arguments_are_requested_again_after_a_timeout(
    launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rover_link, "ANSWER_S", 0.3)
    rover, released, repeated = launch(), threading.Event(), asyncio.Event()
    original, requested = RoverLink.request_arguments, set[Identity]()

    def request_arguments(link: RoverLink, identity: Identity) -> None:
        if identity in requested:
            repeated.set()
        requested.add(identity)
        original(link, identity)

    monkeypatch.setattr(RoverLink, "request_arguments", request_arguments)

    def receive_and_wait(bench: LinkedBench) -> None:
        bench.submit(MoveForward(2.0), 7)
        released.wait(LIMIT_S)

    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        # The console has caught up with the reports: that needs the core, which then waits.
        await asyncio.to_thread(rover.do, lambda bench: bench.submit(SetTravelSpeed(0.3), 6))
        await anna.page.until(lambda message: message.get("name") == "setTravelSpeed")
        waiting = asyncio.create_task(asyncio.to_thread(rover.do, receive_and_wait))
        await anna.page.until(lambda message: message.get("name") == "moveForward")
        await asyncio.wait_for(repeated.wait(), LIMIT_S)
        released.set()
        await waiting
        await anna.page.until(lambda message: message.get("args") == {"distance": 2.0})


def root(definition: PlanDefinition) -> PlanNode:
    found = check_plan(definition, load_settings("jackal"))
    assert isinstance(found, PlanNode)
    return found


def test_the_targets_of_a_plan_follow_one_another() -> None:
    settings = load_settings("jackal")
    start = Pose(1.0, 1.0, heading_rad=-pi / 2)
    found = list(route_of(root(plan(SURVEY)), settings, start))
    assert [(each.number, each.name, each.times, each.at, each.points) for each in found] == [
        (1, "moveForward", 1, (1.0, 0.0), ((1.0, 0.0),)),
        (2, "moveTo", 2, (3.0, 0.0), ((3.0, 0.0),)),
        (3, "takePicture", 1, (3.0, 0.0), ()),
        (4, "moveForward", 1, (4.0, 0.0), ((4.0, 0.0),)),
        (5, "followPath", 1, (4.0, 1.0), ((4.0, 1.0),)),
    ]
    present = route_of(root(plan(SURVEY)), settings, start, found[2].node)
    assert [(each.number, each.at) for each in present] == [
        (3, (1.0, 1.0)),
        (4, (1.0, 0.0)),
        (5, (4.0, 1.0)),
    ]
    assert [each.points for each in route_of(root(plan(SURVEY)), settings, None)][:2] == [
        (),  # a start that is unknown
        ((3.0, 0.0),),
    ]


def test_a_loop_of_a_plan_has_a_bounded_route() -> None:
    body = """<Fallback>
        <Repeat num_cycles="900"><moveForward distance="1" deadline_s="60"/></Repeat>
        <rotateBy angle="1" deadline_s="60"/></Fallback>"""
    settings, loop = load_settings("jackal"), root(plan(f"<Sequence>{body}{body}</Sequence>"))
    route = list(route_of(loop, settings, Pose()))
    assert [(each.number, each.times) for each in route] == [(1, 900)] * 20 + [(3, 900)] * 20
    (turn,) = (each for each in steps(loop) if each.location.number == 5)
    after = route_of(loop, settings, Pose(), turn.location.path)
    assert {each.number for each in after} == {3}
