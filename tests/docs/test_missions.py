"""The missions of the page docs/missions.md, run without and with their faults."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from executive.faults import Reaction
from executive.values.reports import PlanStatus, Stage
from tests.docs.pages import CHECKOUT
from tests.support.examples import in_full
from tests.support.mission_timeline import draw
from tests.support.missions import (
    ALL_MISSIONS,
    DAY,
    FOLDER,
    Event,
    Mission,
    MissionRun,
    Scene,
    answer,
    contact,
    displaced,
    run_mission,
    voltage,
)

COMPLETED, FAILED, SUSPENDED = PlanStatus.COMPLETED, PlanStatus.FAILED, PlanStatus.SUSPENDED
PAGE = CHECKOUT / "docs" / "missions.md"
BY_NUMBER = {each.name[:2]: each for each in ALL_MISSIONS}
STAGE_OF = {
    "SUCCESS": {Stage.EXECUTED},
    "FAILURE": {Stage.FAILED, Stage.REJECTED, Stage.CANCELLED},
    "HALTED": {Stage.CANCELLED},
}


@dataclass(frozen=True, slots=True)
class Expected:
    """What an operator relies on.

    Attributes:
        course: see `MissionRun.course`.
        position: that of the rover at the end, x and y in m.
        text: the end of the plan's last text.
        begins, ends: times of nodes; see `MissionRun`.
    """

    status: PlanStatus
    course: str
    position: tuple[float, float]
    text: str = ""
    begins: dict[str, list[str]] = field(default_factory=dict)
    ends: dict[str, list[str]] = field(default_factory=dict)


def executed(names: str) -> str:
    """Return the course in which these nodes are EXECUTED."""
    return ", ".join(f"{each} EXECUTED" for each in names.split(", "))


PANORAMA = ", ".join(["setCameraAngles, takePicture"] * 5)
MARKS = ", ".join(["setCameraAngles, takePicture"] * 3)
EXPECTED = {
    "01": (
        Expected(
            COMPLETED,
            executed(f"setTravelSpeed, outcrop, {PANORAMA}, home"),
            (0, 0),
            begins={"outcrop": ["09:00:00"]},
        ),
        Expected(
            COMPLETED,
            "setTravelSpeed EXECUTED, outcrop CANCELLED, home EXECUTED",
            (0, 0),
            begins={"outcrop": ["09:00:00"], "home": ["09:00:08"]},
            ends={"Window": ["09:00:08 FAILURE"], "outcrop": ["09:00:08 HALTED"]},
        ),
    ),
    "02": (
        Expected(
            COMPLETED,
            executed(", ".join([*["takePicture, setStatusInterval"] * 2, "setStatusInterval"])),
            (0, 0),
            begins={
                "takePicture": ["10:12:00", "12:05:00"],
                "Sleep": ["10:13:00", "12:06:00"],
            },
            ends={"Sleep": ["10:17:00 SUCCESS", "12:10:00 SUCCESS"]},
        ),
        Expected(
            COMPLETED,
            executed("takePicture, takePicture, setStatusInterval, setStatusInterval"),
            (0, 0),
            begins={"takePicture": ["10:12:00", "12:05:00"]},
            ends={"link is up": ["10:18:40 FAILURE", "12:06:00 SUCCESS"]},
        ),
    ),
    "03": (
        Expected(COMPLETED, executed("rim, down, takePicture"), (8, 3)),
        Expected(COMPLETED, executed("shoulder, left, takePicture"), (7, 1)),
    ),
    "04": (
        Expected(
            COMPLETED,
            executed("edge, setCameraAngles, takePicture, slowly, other side"),
            (6, 0),
            begins={"Ask": ["10:00:06"]},
            ends={"Ask": ["10:10:06 SUCCESS"]},
        ),
        Expected(
            COMPLETED,
            executed("edge, setCameraAngles, takePicture, around"),
            (6, 0),
            begins={"Ask": ["10:00:06"]},
            ends={"Ask": ["11:30:06 SUCCESS"]},
        ),
    ),
    "05": (
        Expected(COMPLETED, executed("leg, leg, leg, leg, takePicture"), (12, 0)),
        Expected(
            COMPLETED,
            f"leg EXECUTED, leg CANCELLED, {executed('leg, leg, leg, takePicture')}",
            (12, 0),
            ends={"WaitFor": ["11:01:06 SUCCESS"]},
        ),
    ),
    "06": (
        Expected(
            COMPLETED,
            executed("flat place, stow, seldom, often, next"),
            (5, -1),
            ends={"sunrise": ["05:40:00 SUCCESS"], "warm and charged": ["06:30:00 SUCCESS"]},
        ),
        Expected(
            FAILED,
            executed("flat place, stow, seldom, often, why"),
            (2, -1),
            text="/stay/AlwaysFailure: fails always",
            ends={"warm and charged": ["08:40:00 FAILURE"]},
        ),
    ),
    "07": (
        Expected(
            COMPLETED,
            executed(", ".join(["in front of it", *["takePicture"] * 12])),
            (1, 0),
            ends={"most of them": ["12:00:04 SUCCESS"]},
        ),
        Expected(
            FAILED,
            f"{executed('in front of it, takePicture, takePicture')}, takePicture FAILED, "
            + executed("takePicture, takePicture"),
            (1.4, 0),
            text="/Near: 0.39 m away",
        ),
    ),
    "08": (
        Expected(
            COMPLETED,
            f"{executed(', '.join(['moveTo, takePicture'] * 5))}, moveTo CANCELLED, home EXECUTED",
            (0, 0),
            ends={"Timeout": ["10:00:25 FAILURE"]},
        ),
        Expected(
            COMPLETED,
            f"{executed(', '.join(['moveTo, takePicture'] * 5))}, moveTo CANCELLED, home EXECUTED",
            (0, 0),
            ends={"Timeout": ["10:00:25 FAILURE"]},
        ),
    ),
    "09": (
        Expected(COMPLETED, executed("up, one, further, two, stow, on"), (2, 0)),
        Expected(
            FAILED,
            f"{executed('up, one, further')}, two FAILED, stow after a failure EXECUTED",
            (0, 0),
            text="(no camera frame received within 5.0 s)",
        ),
    ),
    "10": (
        Expected(COMPLETED, executed("behind the hill"), (10, 4)),
        Expected(
            COMPLETED,
            "behind the hill CANCELLED, where it was EXECUTED, home EXECUTED",
            (0, 0),
            ends={
                "heard of in the last ten minutes": ["10:00:10 SUCCESS", "10:00:10 FAILURE"],
                "WaitFor": ["10:30:16 FAILURE"],
            },
        ),
    ),
    "11": (
        Expected(
            COMPLETED,
            executed(f"{MARKS}, site, site 2"),
            (5, 5),
            ends={"Ask": ["10:30:01 SUCCESS"]},
        ),
        Expected(COMPLETED, executed(MARKS), (0, 0), ends={"Ask": ["12:00:01 SUCCESS"]}),
    ),
    "12": (
        Expected(COMPLETED, executed("drive, setCameraAngles, on the way"), (4, 1)),
        Expected(
            COMPLETED,
            "drive EXECUTED, setCameraAngles EXECUTED, on the way FAILED, standing EXECUTED",
            (4, 1),
        ),
    ),
}


def examine(run: MissionRun, expected: Expected) -> None:
    """Compare a run with its expectation; each of its commands has one life."""
    assert (run.last.status, run.course) == (expected.status, expected.course), run.last
    assert run.last.text.endswith(expected.text or "completed"), run.last.text
    assert (run.pose.x_m, run.pose.y_m) == pytest.approx(expected.position, abs=0.06)
    assert {name: run.begins(name) for name in expected.begins} == expected.begins
    assert {name: run.ends(name) for name in expected.ends} == expected.ends
    steps = [each for each in run.spans if each.is_step]
    for step, (number, stages) in zip(steps, run.commands, strict=True):
        name = f"{number}: {step.plan.location.name}"
        assert stages.count(Stage.RECEIVED) == 1, name
        assert [each for each in stages if each.terminal] == stages[-1:], name
        assert stages[-1] in STAGE_OF[step.result], name


@pytest.mark.parametrize("mission", ALL_MISSIONS, ids=lambda mission: mission.name)
def test_a_mission_without_and_with_its_fault(
    mission: Mission, tmp_path_factory: pytest.TempPathFactory
) -> None:
    runs = [
        run_mission(mission, scene, tmp_path_factory.mktemp("run"))
        for scene in (mission.nominal, mission.fault)
    ]
    for run, expected in zip(runs, EXPECTED[mission.name[:2]], strict=True):
        examine(run, expected)
    picture = CHECKOUT / "docs" / "images" / f"mission-{mission.name[:2]}.svg"
    assert draw(runs) == picture.read_text("utf-8"), "python -m tests.support.mission_timeline"


LOW_AT_NIGHT = Event(f"{DAY}20:00:00Z", voltage(21.5))
BRIGHT = Event("2026-11-28T06:00:00Z", voltage(24.5))
ROVER_STAYS = executed("flat place, stow, seldom, often, stays")
OTHERS: dict[str, tuple[str, Scene, Expected]] = {
    "the rover is not where the plan begins": (
        "01",
        Scene("", (Event(f"{DAY}08:50:00Z", displaced(0.5, 0.0)),)),
        Expected(FAILED, "", (0.5, 0), "/as planned: 0.50 m away"),
    ),
    "no viewpoint can be reached": (
        "03",
        Scene("", keep_out=((4.5, -2.0), (9.0, -2.0), (9.0, 4.0), (4.5, 4.0))),
        Expected(FAILED, "", (0, 0), "target too near to keep-out zone 'rocks'"),
    ),
    "the answer is to stay": (
        "04",
        Scene("", (Event("Ask", answer("Ask", "stay"), 60.0),)),
        Expected(
            COMPLETED,
            executed("edge, setCameraAngles, takePicture, from here"),
            (4, 0),
            ends={"Ask": ["10:01:06 SUCCESS"]},
        ),
    ),
    "the battery is never charged": (
        "05",
        Scene("", (Event("leg", voltage(22.4), 2.0, times=2),)),
        Expected(
            FAILED,
            "leg EXECUTED, leg CANCELLED",
            (4.5, 0.5),
            "/WaitFor: not @BATERY_VOLTAGE > 25 within its deadline",
            ends={"WaitFor": [f"{hour}:00:06 FAILURE" for hour in (14, 18, 22)]},
        ),
    ),
    "the battery is nearly empty at night": (
        "06",
        Scene("", (LOW_AT_NIGHT,)),
        Expected(
            SUSPENDED,
            executed("flat place, stow, seldom"),
            (2, -1),
            "battery voltage 21.5 V is below 22.0 V",
        ),
    ),
    "the battery is nearly empty at night, and the rover warns only": (
        "06",
        Scene("", (LOW_AT_NIGHT, BRIGHT), battery_low=Reaction.WARN),
        Expected(COMPLETED, ROVER_STAYS, (2, -1)),
    ),
    "the rover is pushed": (
        "07",
        Scene("", (Event(f"{DAY}10:05:00Z", displaced(1.4, 0.0)),)),
        Expected(
            SUSPENDED, executed("in front of it, takePicture"), (1.4, 0), "by 0.41 m and 0.0°"
        ),
    ),
    "the link returns": (
        "10",
        Scene(
            "",
            (
                Event("behind the hill", contact(False), 4.0),
                Event("WaitFor", contact(True), 600.0),
            ),
        ),
        Expected(
            COMPLETED,
            "behind the hill CANCELLED, where it was EXECUTED",
            (4, 0),
            ends={"WaitFor": ["10:10:16 SUCCESS"]},
        ),
    ),
    "the answer is no": (
        "11",
        Scene("", (Event("Ask", answer("Ask", "no"), 60.0),)),
        Expected(COMPLETED, executed(MARKS), (0, 0)),
    ),
}


LIKE_OTHERS = {
    "the battery is never charged",
    "the battery is nearly empty at night, and the rover warns only",
    "the link returns",
    "the answer is no",
}


@pytest.mark.parametrize(
    ("number", "scene", "expected"),
    [in_full(*case) if name in LIKE_OTHERS else case for name, case in OTHERS.items()],
    ids=OTHERS,
)
def test_a_mission_in_another_scene(
    number: str, scene: Scene, expected: Expected, tmp_path: Path
) -> None:
    examine(run_mission(BY_NUMBER[number], scene, tmp_path), expected)


def test_after_its_window_the_rover_returns_at_once(tmp_path: Path) -> None:
    late = replace(BY_NUMBER["01"], begin=f"{DAY}14:00:01Z")
    course = executed("setTravelSpeed, home")
    examine(run_mission(late, Scene("late"), tmp_path), Expected(COMPLETED, course, (0, 0)))


def test_no_leg_is_driven_with_a_low_battery(tmp_path: Path) -> None:
    mission = BY_NUMBER["05"]
    run = run_mission(mission, mission.fault, tmp_path)
    (guard,) = (
        s for s in run.spans if s.plan.location.name == "not empty" and s.result != "SUCCESS"
    )
    braking_s = guard.end_utc_s + 1.0
    assert len(run.motion) > 100
    assert all(voltage_v > 23.0 for utc_s, voltage_v in run.motion if utc_s > braking_s)


def test_all_missions_are_on_the_page() -> None:
    text = PAGE.read_text("utf-8")
    files = sorted(path.name for path in FOLDER.glob("*.xml"))
    assert [f"{each.name}.xml" for each in ALL_MISSIONS] == files
    for mission in ALL_MISSIONS:
        assert f"images/mission-{mission.name[:2]}.svg" in text
        assert f"rover plan check config/plans/missions/{mission.name}.xml" in text
        assert f"rover plan prove config/plans/missions/{mission.name}.xml" in text
