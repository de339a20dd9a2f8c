"""Previews over the link: as typed, as parts of a message, and what refuses them."""

import asyncio
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import click
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from adapters.mal import Consumer, MalError
from adapters.mrs.aboard import query_services
from adapters.mrs.cli.preview_command import preview as preview_group
from adapters.mrs.cli.preview_command import preview_lines
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import (
    AreaError,
    Controller,
    PlanPreview,
    Preview,
    PreviewPose,
    PreviewRequest,
    ReceivedReport,
    Stage,
    frame_supplements,
    framed,
    motion_of,
    preview_request,
)
from executive.commands import (
    FollowPath,
    Motion,
    MoveForward,
    MoveTo,
    Stop,
    Waypoint,
    all_declarations,
)
from executive.core.runner import Executive
from executive.settings import NavigationGate
from executive.values.geometry import Point
from executive.values.reports import ReportKind
from tests.mrs.aboard import Aboard, raises
from tests.support.kinematic import Bench
from tests.support.navigated import settings
from tests.support.planned import PlannedBench
from tests.support.plans import AHEAD, TOO_LATE, plan

HERE = PreviewPose(time=2.0, x=1.0, y=0.0, heading=0.0)
REPORTED = Preview(
    duration=2.0,
    length=1.0,
    frame="odom",
    path=(HERE,),
    endUncertainty=0.02,
    headingUncertainty=0.03,
)


def typed(*arguments: str, to: Aboard | None = None) -> click.testing.Result:
    where = () if to is None else ("--to", to.uri)
    return CliRunner().invoke(preview_group, [*where, *arguments])


@given(st.one_of(*(st.from_type(kind) for kind in get_args(Motion))))
def test_a_motion_is_decoded_from_its_parts(motion: Motion) -> None:
    back = framed(motion_of(preview_request(motion)), frame_supplements(motion))
    assert repr(back) == repr(motion)


async def test_a_rover_previews_a_motion_and_a_plan(client: MrsClient) -> None:
    reported = await client.preview(MoveTo(Waypoint(3.0, 2.0, 1.5)))
    end = reported.path[-1]
    assert (end.x, end.y, end.heading) == pytest.approx((3.0, 2.0, 1.5), abs=0.05)
    assert reported.duration == end.time
    planned = await client.preview_plan(plan(f"<Sequence>{AHEAD}{AHEAD}</Sequence>"))
    assert planned.length == pytest.approx(8.0, abs=0.1)
    by_step = await client.preview_steps(plan(f"<Sequence>{AHEAD}{AHEAD}</Sequence>"))
    assert by_step.total == planned
    assert [each.length for each in by_step.steps] == pytest.approx([4.0, 4.0], abs=0.05)
    assert by_step.steps[-1].end.x == planned.path[-1].x
    late = await client.preview_steps(plan(f"<Sequence>{AHEAD}{TOO_LATE}{AHEAD}</Sequence>"))
    assert (late.total, len(late.steps), late.steps[0].refusal) == (None, 2, None)
    assert late.steps[1].refusal is not None
    assert late.steps[1].refusal.endswith("s exceeds 1 s (761 PLAN_DEADLINE)")
    assert late.refusal == f"{late.steps[1].node}: {late.steps[1].refusal}"
    with raises(AreaError.INVALID.value):
        await client.preview_steps(plan("<fly/>"))
    assert await client.get_plan_status() == ()
    assert await client.get_notifications() == ()


async def test_it_needs_no_mode_and_the_refusal_gives_the_reason(client: MrsClient) -> None:
    await client.submit(client.command(Stop()))
    assert (await client.preview(MoveForward(1.0))).length == pytest.approx(1.0, abs=0.05)
    with pytest.raises(MalError, match="distance 1000 m is above its bound of 100 m") as refused:
        await client.preview(MoveForward(1000.0))
    assert refused.value.number == AreaError.INVALID.value
    assert "(102 OUT_OF_RANGE)" in str(refused.value)


@pytest.mark.parametrize(
    ("requested", "message"),
    [
        (PreviewRequest("moveBy", None, None), "operation 'moveBy': one of moveTo, moveForward"),
        (PreviewRequest("stop", None, None), "one of moveTo"),
        (PreviewRequest("drive", None, (1.0,)), "has 3: travel, rotate, duration; 1 were given"),
        (PreviewRequest("moveTo", (), None), "waypoints: moveTo has 1: target; 0 were given"),
        (PreviewRequest("followPath", (), (1.0,)), "figures: followPath has 0; 1 were given"),
        (
            PreviewRequest("moveForward", None, (1.0,), Controller.MPC),
            "controller: moveForward has",
        ),
    ],
)
def test_parts_that_are_no_motion_are_refused(requested: PreviewRequest, message: str) -> None:
    with pytest.raises(MalError) as refused:
        motion_of(requested)
    assert message in str(refused.value)


async def test_concurrent_previews_are_bounded(consumer: Consumer) -> None:
    requested = ("MotionControl", "preview", "moveForward", None, (3.0,), None)
    maximum = query_services.MAX_CONCURRENT
    first = [asyncio.create_task(consumer.request(*requested)) for _ in range(maximum)]
    await asyncio.sleep(0)
    with raises(AreaError.BUSY.value):
        await consumer.request(*requested)
    for reported in await asyncio.gather(*first):
        assert reported[0].length == pytest.approx(3.0, abs=0.1)
    await consumer.request("MotionControl", "preview", "moveForward", None, (1.0,), None)


async def test_a_preview_that_takes_too_long_is_aborted(
    client: MrsClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(query_services, "MAX_PREVIEW_S", 0.0)
        with pytest.raises(MalError, match="was not computed within 0 s") as refused:
            await client.preview(MoveForward(1.0))
    assert refused.value.number == AreaError.BUSY.value
    assert (await client.preview(MoveForward(1.0))).length == pytest.approx(1.0, abs=0.05)


def test_as_typed(aboard: Aboard, tmp_path: Path) -> None:
    reported = typed("moveTo", "3", "2", "--heading", "90deg", to=aboard)
    assert reported.exit_code == 0, reported.output
    assert "ends at x 3.0" in reported.stdout
    assert "heading 90." in reported.stdout or "heading 89." in reported.stdout
    as_json = typed("--json", "moveForward", "-1", to=aboard)
    assert json.loads(as_json.stdout)["path"][0]["time"] == 0.0
    file = tmp_path / "ahead.xml"
    file.write_bytes(plan('<moveForward distance="{far}" deadline_s="90"/>').content)
    assert typed("--plan", str(file), "--arg", "far=3", to=aboard).exit_code == 0
    refused = typed("--plan", str(file), to=aboard)
    assert (refused.exit_code, "no value given for {far}" in refused.output) == (1, True)
    assert typed("moveForward", "1000", to=aboard).exit_code == 1


def test_what_makes_no_sense_as_typed(tmp_path: Path) -> None:
    assert "give an operation, or --plan FILE" in typed().output
    file = tmp_path / "some.xml"
    file.write_bytes(b"")
    assert typed("--plan", str(file), "moveForward", "1").exit_code == 2
    assert typed("--arg", "far=1", "moveForward", "1").exit_code == 2
    misplaced = typed("moveForward", "1", "--json")
    assert "--json is an option of `rover preview`: write it before" in misplaced.output


def test_every_motion_can_be_typed() -> None:
    motions = {each.name for each in all_declarations() if each.kind in get_args(Motion)}
    assert set(preview_group.commands) == motions
    shown = CliRunner().invoke(preview_group, ["moveTo", "--help"]).output
    assert "rover preview moveTo 3 2 --heading 90deg" in shown
    assert "--replace" not in shown


def test_formatted_lines() -> None:
    assert preview_lines(REPORTED) == [
        "duration 2.0 s, 1.00 m",
        "ends at x 1.00 m, y 0.00 m, heading 0.0°, within 0.02 m and 1.7° (2 sigma)",
    ]
    more = replace(REPORTED, energy=111.4, clearance=0.5, nearest="rock 'boulder'")
    first, _, last = preview_lines(more)
    assert first == "duration 2.0 s, 1.00 m, 111 J"
    assert last == "clearance 0.50 m to rock 'boulder'"
    assert preview_lines(replace(more, note="along straight lines: so"))[-1].startswith("along")


class _Gateway:
    """Answers queries at once, and lets a tick pass after each."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    def query(self, question: Callable[[Executive], Any]) -> asyncio.Future[Any]:
        answer = asyncio.get_running_loop().create_future()
        answer.set_result(question(self._bench.executive))
        self._bench.step()
        return answer


@pytest.mark.parametrize(
    ("via", "length_m", "note"),
    [
        ((Point(0.0, 3.0),), 8.0, None),
        ("TF_ERROR", 4.0, "along straight lines: TF_ERROR"),
        (None, 4.0, "along straight lines: no path of the planner in time"),
    ],
)
def test_a_navigated_motion_is_previewed_along_the_path_of_the_planner(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    via: tuple[Point, ...] | str | None,
    length_m: float,
    note: str | None,
) -> None:
    monkeypatch.setattr(query_services, "PLANNER_WAIT_S", 0.2)
    with PlannedBench(tmp_path, settings(NavigationGate.LOCK)) as bench:
        bench.rover.via = via
        served: Any = SimpleNamespace(serve=lambda *_: None)
        gateway: Any = _Gateway(bench)
        service = query_services.PreviewService(served, gateway)
        motion = MoveTo(Waypoint(4.0, 0.0))
        reported = asyncio.run(service._work_out(motion))
        assert reported.length == pytest.approx(length_m, abs=0.1)
        assert reported.note == note
        assert not bench.rover.goals


def test_a_planner_that_does_not_answer_is_requested_once_in_a_preview(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(query_services, "PLANNER_WAIT_S", 0.2)
    with PlannedBench(tmp_path, settings(NavigationGate.LOCK)) as bench:
        bench.rover.via = None
        served: Any = SimpleNamespace(serve=lambda *_: None)
        gateway: Any = _Gateway(bench)
        service = query_services.PreviewService(served, gateway)
        path = FollowPath(tuple(Waypoint(float(each), 0.0) for each in range(1, 6)))
        reported = asyncio.run(service._work_out(path))
        assert reported.length == pytest.approx(5.0, abs=0.2)
        assert len(bench.rover.requests) == 1


async def test_a_prediction_accompanies_a_command(aboard: Aboard, client: MrsClient) -> None:
    aboard.runs = True
    received: list[ReceivedReport] = []
    outcome = await client.run(client.command(MoveForward(0.5)), received.append)
    predicted = outcome.prediction
    assert predicted is not None
    assert (predicted.kind, predicted.stage) == (ReportKind.EVENT, None)
    assert predicted.identity == outcome.reports[0].identity == outcome.command.identity
    assert predicted.identity.source == client.source
    assert [each.report.stage for each in received] == [
        *(each.stage for each in outcome.reports[:-1]),
        None,
        Stage.EXECUTED,
    ]
    values = {each.name: each.value for each in outcome.reports[-1].figures}
    reported = {each.name: each.value for each in predicted.figures}
    assert reported
    assert {name: values[name] for name in reported} == reported
    assert values["duration"] == pytest.approx(values["predicted duration"], abs=0.2)
    past = await client.get_notifications(command_id=predicted.identity.command_id)
    assert predicted in [each.report for each in past]


def test_a_preview_may_take_longer_than_other_answers(
    running: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(query_services, "PAUSE_S", 1.2)
    monkeypatch.setattr(query_services, "SLICE_TICKS", 10_000)

    async def previewed() -> PlanPreview:
        async with await MrsClient.connect(running.uri, timeout_s=1.0) as client:
            return await client.preview_steps(plan(AHEAD))

    assert asyncio.run(previewed()).total is not None
