"""Missions of docs/missions.md in their whole length, which its tests shorten."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

from executive.commands import SetTravelSpeed
from executive.values.reports import PlanStatus
from tests.support.missions import ALL_MISSIONS, Event, Scene, contact, run_mission

BY_NUMBER = {each.name[:2]: replace(each, shortened=("", "")) for each in ALL_MISSIONS}


def test_the_link_is_lost_behind_the_hill_for_ten_minutes(tmp_path: Path) -> None:
    slow = Event("behind the hill", lambda bench: bench.numbered(SetTravelSpeed(0.015)))
    lost = Event("behind the hill", contact(False), 30.0)
    run = run_mission(BY_NUMBER["10"], Scene("", (slow, lost)), tmp_path)
    assert run.course == "behind the hill CANCELLED, where it was EXECUTED, home EXECUTED"
    assert run.ends("behind the hill") == ["10:10:30 HALTED"]
    assert (run.last.status, round(run.pose.x_m, 1)) == (PlanStatus.COMPLETED, 0.0)


def test_a_patrol_of_two_hours(tmp_path: Path) -> None:
    mission = BY_NUMBER["08"]
    run = run_mission(mission, mission.nominal, tmp_path)
    assert run.last.status is PlanStatus.COMPLETED
    assert run.ends("Timeout") == ["12:00:00 FAILURE"]
    ends = Counter(run.course.split(", "))
    assert set(ends) - {"moveTo CANCELLED", "takePicture CANCELLED"} == {
        "moveTo EXECUTED",
        "takePicture EXECUTED",
        "home EXECUTED",
    }
    assert ends["home EXECUTED"] == 1
    assert ends["takePicture EXECUTED"] > 1000
