"""Drives of a simulated Jackal by navigations in processes of their own, honest or not.

    python -m pytest -s tests/stress/navigation_processes.py

Each behaviour drives some times, each time as a new process. Then the navigation,
the executive or both are killed or paused during a drive. The printed figures are true ones of
the simulation, and those of the rover's odometry.
"""

import json
import os
import shutil
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import hypot
from pathlib import Path
from random import Random
from typing import Final

import pytest
from nav_msgs.msg import Odometry

from adapters.ros import odometry_fact
from executive.commands.catalogue import Resume
from executive.settings import NavigationGate, load_settings
from executive.values.geometry import Pose
from executive.values.reasons import Reason
from executive.values.reports import Report, Stage
from tests.support.ground import carry_out, until_located
from tests.support.navigated_rover import Track, end_of, navigated, navigation, start_move
from tests.support.navigation import Navigation
from tests.support.probe import Probe, probing
from tests.support.processes import executive, simulation

pytestmark = pytest.mark.usefixtures("nav2_msgs")

TIMES: Final = int(os.environ.get("NAVIGATED_DRIVES", "3"))
"""Number of drives with each behaviour."""
EXECUTED: Final = None
ENDS: Final[dict[str, set[Reason | None]]] = {
    "aborts": {Reason.NAVIGATION_FAILED},
    "aborts_and_drives_on": {Reason.NAVIGATION_FAILED},
    "another_takes_over": {Reason.NAVIGATION_PREEMPTED},
    "feedback_lies": {Reason.OFF_TARGET},
    "frozen_midway": {Reason.NAVIGATION_TIMEOUT},
    "never_answers": {Reason.NAVIGATION_TIMEOUT},
    "never_ends": {EXECUTED, Reason.DRIVE_DEADLINE},
    "rejects": {Reason.NAVIGATION_REJECTED},
    "restarts_midway": {Reason.NAVIGATION_TIMEOUT},
    "silent_midway": {Reason.NAVIGATION_TIMEOUT},
    "succeeds_at_once": {Reason.OFF_TARGET},
    # A cancel of all goals finds none after a success: it drives on for 4 s.
    "succeeds_moving": {EXECUTED, Reason.NAVIGATION_UNCOMMANDED_MOTION},
    "succeeds_off_target": {EXECUTED, Reason.OFF_TARGET},
    "succeeds_then_moves": {EXECUTED, Reason.NAVIGATION_UNCOMMANDED_MOTION},
}
"""Ends that are right; of all other behaviours, EXECUTED is."""
WATCHED_S: Final = 8.0
"""Observation after an end."""
MAX_OFF_M, MAX_MOVED_M = 0.06, 0.06
"""Of a success, from its target, and later."""
MAX_FAILED_MOVED_M: Final = 0.2
"""After a failure, until the gate and the base's braking have stopped the rover."""
MAX_STATIONARY_S, PAUSE_S = 0.5, 2.0
POLL_S, NEAR_M, AREA_M = 0.05, 2.5, 4.0


@dataclass
class Course:
    """The rover with its probe, and where it drives next."""

    probe: Probe
    random: Random = field(default_factory=lambda: Random(1))
    odometry: list[Odometry] = field(default_factory=list)
    rows: list[dict[str, object]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Subscribe to odometry."""
        self.probe.receive(self.probe.topics.odometry, self.odometry.append)

    def poses(self) -> tuple[Pose, Pose]:
        """Return the pose of the rover by its odometry, and the true one."""
        self.odometry.clear()
        truth = self.probe.fresh_truth()
        self.probe.until(lambda: bool(self.odometry), "odometry")
        return odometry_fact(self.odometry[-1]).pose, odometry_fact(truth).pose

    def target(self, pose: Pose) -> tuple[float, float]:
        """Return a target at some distance that is not far from the origin."""
        while True:
            x_m, y_m = (self.random.uniform(-AREA_M, AREA_M) for _ in range(2))
            if NEAR_M < hypot(x_m - pose.x_m, y_m - pose.y_m) < NEAR_M + 1.0:
                return round(x_m, 2), round(y_m, 2)

    def note(self, **figures: object) -> None:
        """Print and store a row of figures."""
        rounded = {
            name: round(each, 3) if isinstance(each, float) else each
            for name, each in figures.items()
        }
        self.rows.append(rounded)
        print(json.dumps(rounded), flush=True)


@pytest.fixture(scope="module", params=NavigationGate, ids=lambda gate: gate.value)
def course(
    request: pytest.FixtureRequest,
    module_ros_domain: int,
    patient: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Course]:
    """Give the course of a simulated Jackal with a navigation behind a gate."""
    assert module_ros_domain > 0
    folder = tmp_path_factory.mktemp("navigated")
    shutil.copytree(patient, folder / "config")
    navigated(folder / "config", request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROVER_CONFIG", str(folder / "config"))
        assert load_settings("jackal").navigation is not None
        with simulation(folder, "--camera", "rays"), probing() as probe:
            yield Course(probe)


def error_m(start: tuple[Pose, Pose], end: Pose, target: tuple[float, float]) -> float:
    """Return the true distance from a target that was given by the odometry at the start."""
    odometry, truth = start
    wanted = truth.compose(odometry.inverse.compose(Pose(*target)))
    return end.point.distance_m(wanted.point)


def reason_of(end: Report) -> Reason | None:
    if end.stage is Stage.EXECUTED:
        return EXECUTED
    assert isinstance(end.reason, Reason), end
    return end.reason


@pytest.mark.parametrize("behaviour", Navigation.behaviours())
def test_a_navigation_of_each_behaviour(course: Course, behaviour: str, tmp_path: Path) -> None:
    for index in range(TIMES):
        with executive(tmp_path) as (_, uri):
            until_located(uri)
            carry_out(uri, Resume())
            log = tmp_path / f"navigation-{index}.log"
            with navigation(log, behaviour, "--seed", str(index)):
                drive(course, uri, behaviour)


def drive(course: Course, uri: str, behaviour: str) -> None:
    """Drive once, and compare the end, the position and the motion after it."""
    start = course.poses()
    target = course.target(start[0])
    begun_s = time.monotonic()
    end = end_of(uri, start_move(uri, *target))
    took_s, track = time.monotonic() - begun_s, Track(course.probe)
    odometry, truth = course.poses()
    stationary_s, braked_m = track.stationary()
    later_m = moved_m(course, track)
    off_m = error_m(start, truth, target)
    reason = reason_of(end)
    course.note(
        behaviour=behaviour,
        end=reason.name if reason else "EXECUTED",
        took_s=took_s,
        off_by_odometry_m=odometry.point.distance_m(Pose(*target).point),
        off_m=off_m,
        stationary_s=stationary_s,
        braked_m=braked_m,
        moved_later_m=later_m,
        text=end.text,
    )
    assert reason in ENDS.get(behaviour, {EXECUTED}), end
    if reason is EXECUTED:
        assert off_m < MAX_OFF_M
        assert braked_m + later_m < MAX_MOVED_M
    else:
        assert braked_m + later_m < MAX_FAILED_MOVED_M


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "paused"])
@pytest.mark.parametrize("ended", ["navigation", "executive", "both"])
def test_a_killed_or_paused_process_leaves_a_stationary_rover(
    course: Course, ended: str, number: signal.Signals, tmp_path: Path
) -> None:
    with (
        executive(tmp_path) as (onboard, uri),
        navigation(tmp_path / "navigation.log", "honest") as below,
    ):
        until_located(uri)
        carry_out(uri, Resume())
        start, _ = course.poses()
        command = start_move(uri, *course.target(start))
        course.probe.advanced(0.8)
        chosen = {"navigation": (below,), "executive": (onboard,), "both": (below, onboard)}[ended]
        track = Track(course.probe)
        for each in chosen:
            each.send(number)
        stationary_s, braked_m = track.stationary()
        if number == signal.SIGSTOP:
            time.sleep(PAUSE_S)
            for each in chosen:  # a navigation continues; an executive is replaced
                each.send(signal.SIGCONT if each is below else signal.SIGKILL)
        if onboard in chosen:
            onboard.ended()
            with executive(tmp_path):
                later_m = moved_m(course, track)
        elif number == signal.SIGKILL:
            with navigation(tmp_path / "next.log", "honest"):
                later_m = moved_m(course, track)
        else:
            later_m = moved_m(course, track)
        figures = {"stationary_s": stationary_s, "braked_m": braked_m, "moved_later_m": later_m}
        course.note(ended=ended, signal=number.name, **figures)
        if ended == "navigation":
            assert end_of(uri, command).reason is Reason.NAVIGATION_TIMEOUT
    assert stationary_s < MAX_STATIONARY_S
    assert later_m < 0.01


def moved_m(course: Course, track: Track) -> float:
    """Return the distance that the rover moves from now on."""
    begun_s = time.monotonic()
    course.probe.until(lambda: time.monotonic() - begun_s > WATCHED_S, "the observation")
    return track.moved_m()
