"""Missions that the dialect was not written for: no false alarm, and what they do with faults."""

from collections.abc import Callable
from pathlib import Path

import pytest

from executive.commands import PlanDefinition
from executive.plans import FORMAT, Level, find_faults, read_plan
from executive.values.reasons import Refusal
from executive.values.reports import PlanStatus
from tests.support.examples import in_full
from tests.support.missions import (
    DAY,
    Event,
    Mission,
    MissionRun,
    Scene,
    answer,
    around,
    camera,
    charge,
    contact,
    run_mission,
    voltage,
)
from trees.plan import prove

pytestmark = pytest.mark.at_length
FOLDER = Path(__file__).with_name("missions")
COMPLETED, FAILED = PlanStatus.COMPLETED, PlanStatus.FAILED
CHARGED = Event(f"{DAY}09:59:00Z", charge(0.9))
MORNING = "2026-11-28T"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.xml")), ids=lambda path: path.stem)
def test_a_sound_mission_has_no_finding(path: Path) -> None:
    plan = read_plan(PlanDefinition(path.stem, path.stem, FORMAT, path.read_bytes()))
    assert not isinstance(plan, Refusal), plan.text
    assert [each for each in find_faults(plan) if each.level is not Level.NOTE] == []
    assert prove(plan).findings == ()


Run = Callable[..., MissionRun]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    def run(
        name: str, *events: Event, begin: str = f"{DAY}10:00:00Z", **options: object
    ) -> MissionRun:
        scene = Scene("", events, **options)  # type: ignore[arg-type]
        found = run_mission(Mission(name, begin, scene, scene, folder=FOLDER), scene, tmp_path)
        assert found.course is not None  # each command belongs to its node
        return found

    return run


def test_a_survey_ends_with_its_energy(run: Run) -> None:
    done = run("survey-energy", CHARGED, Event("moveTo", charge(0.7), 0.5, times=3))
    assert done.course.endswith("takePicture EXECUTED, moveTo CANCELLED, home EXECUTED")
    assert done.last.status is FAILED
    assert done.last.text.endswith("not seen >= 3")


def test_a_survey_leaves_a_blocked_spot_out(run: Run) -> None:
    done = run("survey-energy", CHARGED, keep_out=around(6.0, 0.0))
    assert (done.last.status, done.course.count("REJECTED")) == (COMPLETED, 1)
    assert done.course.count("takePicture EXECUTED") == 4


def test_a_survey_does_not_begin_with_an_unknown_charge(run: Run) -> None:
    assert run("survey-energy").course == "home EXECUTED"


def test_a_picture_that_failed_is_not_transmitted_in_the_pass(run: Run) -> None:
    link = Event(f"{DAY}11:02:00Z", contact(True))
    faults = (Event("takePicture", camera(False)), Event("setCameraAngles", camera(True), times=2))
    done = run("pass-downlink", *faults, link, contact=False)
    assert done.last.status is COMPLETED
    assert "takePicture FAILED" in done.course
    assert done.course.endswith("setStatusInterval EXECUTED, del two EXECUTED, slow EXECUTED")
    assert done.ends("up") == ["11:02:00 SUCCESS"]


@pytest.mark.parametrize(
    ("charged", "began"),
    [("06:00:00", "06:00:00"), ("", None), in_full("10:30:00", "10:30:00")],
)
def test_a_start_at_dawn_or_at_ten(run: Run, charged: str, began: str | None) -> None:
    night = Event(f"{DAY}20:00:00Z", voltage(23.0))
    events = (night, Event(f"{MORNING}{charged}Z", voltage(25.0))) if charged else (night,)
    done = run("dawn-start", *events, begin=f"{DAY}18:00:00Z")
    assert done.begins("a") == ([began] if began else [])
    assert done.last.status is (COMPLETED if began else FAILED)


@pytest.mark.parametrize(("blocked", "x_m"), [(9.0, 6.0), in_full(3.0, 0.0)])
def test_a_route_that_fails_ends_at_its_last_safe_position(
    run: Run, blocked: float, x_m: float
) -> None:
    done = run("safe-place", keep_out=around(blocked, 0.0))
    assert done.course.endswith(
        "leg REJECTED, leg REJECTED, safe place EXECUTED, situation EXECUTED"
    )
    assert done.last.status is FAILED
    assert done.pose.x_m == pytest.approx(x_m, abs=0.05)
    assert "path blocked by keep-out zone 'rocks'" in done.last.text


def test_without_an_answer_the_second_attempt_is_left_out(run: Run) -> None:
    done = run("two-attempts", keep_out=around(6.0, 0.0))
    assert done.course == "direct REJECTED, obstacle EXECUTED, home EXECUTED"
    assert (done.last.status, done.ends("side")) == (FAILED, ["11:00:00 SUCCESS"])


def test_a_patrol_changes_its_round_without_the_link_and_ends_with_the_battery(run: Run) -> None:
    lost = Event("far", contact(False), 1.0, times=2)
    low = Event("near", voltage(23.4), 1.0, times=3)
    done = run("patrol-battery", lost, low)
    assert done.course.endswith("near EXECUTED, back EXECUTED, home EXECUTED")
    assert (done.course.count("once"), done.course.count("near EXECUTED")) == (1, 3)
    assert (done.last.status, done.ends("many")[-1:]) == (COMPLETED, [done.ends("many")[0]])


@pytest.mark.parametrize(
    ("word", "course"),
    [
        ("yes", "leg EXECUTED, home EXECUTED"),
        in_full("no", "leg EXECUTED, " * 4 + "goal EXECUTED"),
    ],
)
def test_a_recall_ends_the_route_at_once(run: Run, word: str, course: str) -> None:
    done = run("recall", Event("recall", answer("recall", word), 64.0))
    assert (done.last.status, done.course) == (COMPLETED, course)
    assert done.ends("recall") == ["10:01:04 SUCCESS"]


def test_a_station_continues_at_the_step_that_failed(run: Run) -> None:
    faults = (Event("there", camera(False), 1.0), Event("rest", camera(True), 1.0))
    done = run("stations", *faults)
    assert done.last.status is COMPLETED
    assert done.course.startswith(
        "there EXECUTED, takePicture FAILED, takePicture EXECUTED, there EXECUTED"
    )


def test_two_stations_of_three_suffice(run: Run) -> None:
    done = run("stations", keep_out=around(3.0, 3.0))
    assert (done.last.status, done.course.count("there")) == (COMPLETED, 2)
    assert done.ends("Window")[1] == "10:04:04 FAILURE"


@pytest.mark.parametrize("fault", ["battery", in_full("link")])
def test_the_mast_is_stowed_while_the_rover_is_not_well(run: Run, fault: str) -> None:
    first, last = (
        (voltage(22.5), voltage(24.5)) if fault == "battery" else (contact(False), contact(True))
    )
    done = run("fault-watch", Event("shot", first, 10.0), Event("shot", last, 1800.0))
    assert done.last.status is COMPLETED
    assert (done.course.count("stow"), done.course.count("shot EXECUTED")) == (1, 6)
    assert done.ends("well again") == ["10:30:00 HALTED"]


@pytest.mark.parametrize(
    ("begin", "aim"), [("10:00", "east"), in_full("13:00", "up"), ("15:30", "west")]
)
def test_the_time_of_day_decides(run: Run, begin: str, aim: str) -> None:
    done = run("hours", begin=f"{DAY}{begin}:00Z")
    assert done.course == (f"spot EXECUTED, {aim} EXECUTED, takePicture EXECUTED, home EXECUTED")


def test_a_drive_home_ends_in_the_dark(run: Run) -> None:
    done = run("hours", begin=f"{DAY}15:59:50Z")
    assert (done.last.status, done.ends("home")) == (COMPLETED, ["16:00:00 HALTED"])
