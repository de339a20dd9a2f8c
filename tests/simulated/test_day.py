"""A shortened day on one uplink; `rover bench plan-days` plays whole ones."""

import re
from dataclasses import replace
from pathlib import Path

from executive.commands import PlanDefinition
from sim.rover.faults import CameraDead
from sim.rover.world import Rock
from tests.simulated.day import (
    BEGIN_UTC_S,
    Day,
    DayScene,
    Pass,
    Site,
)
from tests.simulated.day_goals import judge

NEAR, FAR = Site("A", 2.0, 0.0), Site("B", 2.0, 2.0, panorama=True)
NEXT = Site("H", 0.0, -2.0, morning=True)
PASS_S = 90.0
SUNSET_S, SUNRISE_S, END_S = 700.0, 1300.0, 1800.0
SHORT = Day(
    seed=1,
    begin_utc_s=BEGIN_UTC_S,
    sites=(NEAR, FAR, NEXT),
    passes=tuple(
        Pass(begin_s, begin_s + PASS_S, begin_s + 5.0) for begin_s in (0.0, 600.0, 1400.0)
    ),
    sunset_s=SUNSET_S,
    sunrise_s=SUNRISE_S,
    end_s=END_S,
    rocks=(Rock(NEAR.x_m, NEAR.y_m, 0.35, 0.6),),
    walls=(),
    fault=CameraDead(),
    near=FAR,
    fault_s=30.0,
    charge_ratio=0.9,
    hail_s=10.0,
)
"""Half an hour with three passes, a rock on the first site, a camera that fails, and a night."""
PLAN = Path("config/plans/day.xml")


def short_plan() -> PlanDefinition:
    """Return the plan of the whole day, with fewer sites and passes, and earlier times."""

    def utc(at_s: float) -> str:
        return f"{BEGIN_UTC_S + at_s:.0f}"

    passes = "".join(
        f'<SubTree ID="Pass" aos="{utc(each.begin_s)}" los="{utc(each.end_s)}"/>'
        for each in SHORT.passes
    )
    round_ = """
        <SubTree ID="Visit" name="A" x="2" y="0" pans="0" seen="{a}" _skipIf="a == 1"/>
        <SubTree ID="Visit" name="B" x="2" y="2" pans="-1.2;-0.4;0.4;1.2" seen="{b}"
          _skipIf="b == 1"/>
        <Sleep msec="30000" _skipIf="a + b == 2"/>"""
    work = f"""
        <Script code="a := 0; b := 0; h := 0; way := 'go'"/>
        <setTravelSpeed speed="0.5" deadline_s="5"/>
        <ForceSuccess><Window until="{utc(500.0)}"><Repeat num_cycles="6"><Sequence>{round_}
        </Sequence></Repeat></Window></ForceSuccess>
        <moveTo x="0" y="0" deadline_s="60"/>
        <Ask question="On in the morning?" options="go;stay" default="go" deadline_s="300"
          answer="{{way}}"/>
        <WaitUntil utc="{utc(SUNRISE_S + 10.0)}"/>
        <SubTree ID="Visit" name="H" x="0" y="-2" pans="0" seen="{{h}}" _skipIf="way == 'stay'"/>
        <moveTo x="0" y="0" deadline_s="60"/>"""
    text = PLAN.read_text()
    for name, body in (("Work", work), ("Passes", passes)):
        tree = (
            rf'(?<=<BehaviorTree ID="{name}">\n    <Sequence>).*?(?=</Sequence>\n  </BehaviorTree>)'
        )
        text, count = re.subn(tree, body.replace("\\", ""), text, flags=re.DOTALL)
        assert count == 1
    return PlanDefinition("day", "day", "BTCPP4", text.encode())


def test_a_shortened_day_reaches_what_foreknowledge_reaches(tmp_path: Path) -> None:
    with DayScene(SHORT, tmp_path, short_plan()) as scene:
        scene.play()
        goals = judge(scene)
        assert [goal.name for goal in goals if not goal.reached] == []
        assert scene.fault_ends_s is not None
        texts = [text for at_s, text in scene.received.events if at_s < 700.0]
    assert any("On in the morning?" in text for text in texts)


def test_without_a_plan_no_goal_is_reached_that_needs_one(tmp_path: Path) -> None:
    brief = replace(SHORT, passes=SHORT.passes[:1], sunset_s=100.0, sunrise_s=200.0, end_s=300.0)
    with DayScene(brief, tmp_path, None) as scene:
        scene.play()
        reached = {goal.name for goal in judge(scene) if goal.reached}
    assert reached == {"home for the night", "charged for the night", "survived the night"}
