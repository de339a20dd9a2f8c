"""Drafts of plans: steps become XML and XML becomes steps, checked and previewed, never sent."""

import asyncio
from pathlib import Path
from typing import Any

from adapters.console.requests.drafts import node_entries, templates
from executive.settings import config_folder
from executive.values.plan_nodes import PlanNodeReport
from tests.console.consoles import JsonMessage, Operator, at_console
from tests.mrs.aboard import Aboard
from tests.support.examples import ALL
from tests.support.plans import AHEAD, xml

TRAVERSE = [
    {"name": "wp1", "operation": "moveTo", "args": {"x": 2.0, "y": 0.5}},
    {"operation": "takePicture", "args": {}, "deadline": 20},
    {"name": "way", "operation": "followPath", "args": {"waypoints": [{"x": 3, "y": 0.5}]}},
]


async def drafted(anna: Operator, may_fail: bool = False, **body: Any) -> JsonMessage:
    status, answer = await anna.post("api/plans/jackal/draft", **({"plan": "traverse"} | body))
    assert status == 200, answer
    assert answer["preview"] or answer["problem"] or not body.get("preview", True) or may_fail, (
        answer["not_previewed"]
    )
    return answer


async def test_steps_are_written_read_back_and_previewed(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        draft = await drafted(anna, steps=TRAVERSE)
        assert (draft["problem"], draft["not_steps"], draft["not_previewed"]) == (None, None, None)
        assert '<moveTo name="wp1" x="2.0" y="0.5" deadline_s="600.0"/>' in draft["xml"]
        steps = draft["steps"]
        assert [each["name"] for each in steps] == ["wp1", "takePicture", "way"]
        assert [each["deadline"] for each in steps] == [600, 20, 600]
        assert steps[2]["args"] == {"waypoints": [{"x": 3.0, "y": 0.5}]}
        preview = draft["preview"]
        assert [each["node"] for each in preview["steps"]] == [each["node"] for each in steps]
        lengths = [each["length"] for each in preview["steps"]]
        assert abs(preview["total"]["length"] - sum(lengths)) < 1e-6
        assert lengths[1] == 0
        again = await drafted(anna, xml=draft["xml"], preview=False)
        assert (again["steps"], again["preview"]) == (steps, None)

        await asyncio.gather(*(drafted(anna, steps=TRAVERSE) for _ in range(4)))
        fast = [*TRAVERSE, {"operation": "setTravelSpeed", "args": {"speed": 50}}]
        draft = await drafted(anna, steps=fast)
        problem = draft["problem"]
        assert (problem["step"], problem["reason"]) == (3, "PLAN_BAD_ARGUMENT")
        assert problem["text"].startswith("speed 50 m/s is above its bound")
        assert (len(draft["steps"]), draft["preview"]) == (4, None)
        for step, text in (
            ({"operation": "movTo", "args": {"x": 1}}, "did you mean moveTo?"),
            ({"operation": "moveTo", "args": {"x": 1}}, "moveTo needs y"),
            ({"operation": "moveTo", "args": {"x": 1, "y": 1, "z": 1}}, "unknown attribute 'z'"),
            ({"operation": "stop", "args": {}}, "an external stop suspends the plan"),
            ({"operation": "followPath", "args": {"waypoints": [{"x": 1, "heading": 1}]}}, "''"),
        ):
            problem = (await drafted(anna, steps=[TRAVERSE[1], step]))["problem"]
            assert text in problem["text"]
            assert (problem["step"], problem["line"]) == (1, 5)
        near = [TRAVERSE[0], {"operation": "moveForward", "args": {"distance": 9}, "deadline": 2}]
        preview = (await drafted(anna, steps=near))["preview"]
        assert preview["total"] is None
        assert "exceeds 2 s (761 PLAN_DEADLINE)" in preview["steps"][1]["refusal"]
        assert preview["refusal"].startswith("plan:traverse/Sequence/moveForward: ")

        tree = xml(f"<Fallback>{AHEAD}</Fallback>").decode()
        other = await drafted(anna, xml=tree)
        assert (other["steps"], other["not_steps"]) == (
            None,
            "line 3: Fallback is no step of a single sequence",
        )
        assert [(each["depth"], each["kind"], each["text"]) for each in other["outline"]] == [
            (0, "Fallback", ""),
            (1, "moveForward", "distance 4, deadline_s 60"),
        ]
        assert other["preview"]["total"]
        variable = tree.replace('"4"', '"{far}"', 2).replace('format="{far}"', 'format="4"')
        problem = (await drafted(anna, xml=variable))["problem"]
        missing = "distance: no value given for {far}: set it before, or give --arg far=VALUE"
        assert problem["text"] == missing
        filled = await drafted(anna, xml=variable, arguments={"far": "1"})
        assert abs(filled["preview"]["total"]["length"] - 1.0) < 0.05
        typo = await drafted(anna, xml=tree.replace("moveForward", "moveForwrd"))
        assert (typo["problem"]["line"], typo["problem"]["step"]) == (3, None)
        for body, field in (
            ({}, "steps"),
            ({"steps": ["wp1"]}, "steps[0]"),
            ({"steps": [{"operation": "moveTo", "args": {'x="1" y': 2}}]}, "steps"),
            ({"xml": ""}, "content"),
        ):
            status, answer = await anna.post("api/plans/jackal/draft", plan="a", **body)
            assert (status, answer["field"]) == (422, field)
        assert not [each for each in anna.page.got if each["ty"] == "plan"]
        found = (await anna.get("api/plans/templates"))["templates"]
        assert "look-around" in [each["name"] for each in found]
        rover.close()
        while (draft := await drafted(anna, True, steps=TRAVERSE))["preview"] is not None:
            pass
        assert "cannot be reached" in draft["not_previewed"]


async def test_drafts_are_checked_proved_and_tried_by_the_rover(
    rover: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()

        async def check(level: str, **body: Any) -> JsonMessage:
            sent = {"plan": "traverse", "level": level} | body
            status, answer = await anna.post("api/plans/jackal/check", **sent)
            assert status == 200, answer
            return answer

        twice = "<ReactiveSequence><AlwaysSuccess/><Sequence/></ReactiveSequence>"
        refused = await check("check", xml=xml(twice).decode())
        assert refused["verdict"] == "refused"
        assert "Sequence needs at least 1 child" in refused["refusal"]
        proved = await check("prove", steps=TRAVERSE)
        assert (proved["verdict"], proved["limits"], proved["findings"]) == ("proved", [], [])
        assert proved["states"] > 3
        limited = await check("prove", xml=xml(f"<Repeat num_cycles='9'>{AHEAD}</Repeat>").decode())
        assert limited["verdict"] == "no fault found"
        assert "cycles" in limited["limits"][0]
        if ALL:  # ten seconds of a core
            tried = await check("try", steps=TRAVERSE[:1], draws=1)
            assert (tried["verdict"], tried["trial"]["draws"]) == ("tried", 1)
        for body, field in (
            ({"level": "guess"}, "level"),
            ({"level": "check", "draws": 3}, "draws"),
        ):
            status, answer = await anna.post("api/plans/jackal/check", plan="a", steps=[], **body)
            assert (status, answer["field"]) == (422, field)


def test_an_orbiter_that_knows_no_root_loses_no_node() -> None:
    root, question = (PlanNodeReport(path, "Ask", 0) for path in ("plan:day", "plan:day/Ask"))
    entries = [node_entries("day", found) for found in ((root, question), (question,), ())]
    assert [[each.path for each in some] for some in entries] == [
        [question.path],
        [question.path],
        [],
    ]


def test_the_plans_of_the_configuration_are_templates() -> None:
    found = templates(config_folder() / "plans")
    assert {"look-around", "06-night"} <= {each.name for each in found}
    assert all(each.about and each.xml.startswith("<") for each in found)
