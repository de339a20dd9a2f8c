"""Previews: what becomes of the command, where they are refused, what they leave alone."""

from dataclasses import replace
from math import inf, pi
from pathlib import Path

import pytest

from executive.commands import (
    Command,
    ConfirmPose,
    DriveFor,
    FollowPath,
    Motion,
    MoveForward,
    MoveTo,
    PlanDefinition,
    RotateBy,
    RotateTo,
    SetTravelSpeed,
    Stop,
    Waypoint,
)
from executive.core.runner import Executive
from executive.motion import SharedSolver, Trajectory, TrajectoryProblem, make_solver
from executive.obstacles import zones
from executive.obstacles.zones import KeepOut, KnownRock, Zones
from executive.preview import MAX_POSES, KinematicBase, Preview, PreviewRun, TimedPose, preview
from executive.preview.predictions import SLICE_TICKS
from executive.settings import (
    Controller,
    PredictionSettings,
    SettingsError,
    load_settings,
    structure,
)
from executive.values.clock import ManualClock
from executive.values.geometry import STANDING, Point, Pose, Velocity, wrap_rad
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, Stage
from sim.rover import World
from sim.rover.lockstep import LockStep
from tests.benchmarks.previews import crowd
from tests.support.kinematic import Bench
from tests.support.plans import AHEAD, BACK, plan

JACKAL = load_settings("jackal")
ROCK = KnownRock("boulder", 3.0, 0.0, 0.5)
ASIDE = Waypoint(1.0, 1.0, pi / 2)


def worked_out(executive: Executive, requested: Motion | PlanDefinition) -> Preview | Refusal:
    run = executive.preview(requested)
    if isinstance(run, Refusal):
        return run
    run.set_up()
    while not run.advance(7):
        pass
    assert run.result is not None
    return run.result


def previewed(bench: Bench, requested: Motion | PlanDefinition) -> Preview:
    found = worked_out(bench.executive, requested)
    assert isinstance(found, Preview), found
    return found


def refused(bench: Bench, requested: Motion | PlanDefinition) -> Refusal:
    found = worked_out(bench.executive, requested)
    assert isinstance(found, Refusal), found
    return found


@pytest.mark.at_length
@pytest.mark.parametrize(
    "motion",
    [
        MoveTo(Waypoint(3.0, 2.0, pi / 2)),
        MoveForward(-1.5),
        RotateTo(2.0),
        RotateBy(-3.0),
        DriveFor(0.5, 0.3, 4.0),
        FollowPath((Waypoint(1.0, 0.0), Waypoint(1.0, 1.0, pi / 2), Waypoint(-1.0, 0.0))),
    ],
)
def test_it_returns_the_result_of_the_command(bench: Bench, motion: Motion) -> None:
    reported = previewed(bench, motion)
    began_s = bench.clock.now_s()
    bench.execute(motion, 1)
    pose = bench.executive.status.pose
    assert reported.duration_s == pytest.approx(bench.clock.now_s() - began_s, rel=0.05, abs=0.25)
    assert pose.point.distance_m(reported.end.point) <= reported.within_m
    assert abs(wrap_rad(pose.heading_rad - reported.end.heading_rad)) <= reported.within_rad


def test_it_begins_at_the_end_of_active_motion_and_changes_nothing(bench: Bench) -> None:
    bench.submit(MoveTo(Waypoint(2.0, 0.0)), 1)
    bench.run(1.0)
    before = (
        len(bench.received.reports),
        bench.executive.last_sequence,
        bench.executive.goal_count,
    )
    reported = previewed(bench, MoveForward(1.0))
    assert reported.path[0].pose.x_m == pytest.approx(2.0, abs=0.05)
    assert reported.end.x_m == pytest.approx(3.0, abs=0.05)
    after = (len(bench.received.reports), bench.executive.last_sequence, bench.executive.goal_count)
    assert after == before
    assert bench.executive.velocity != STANDING


def test_neither_a_stop_nor_the_queue_prevents_it(bench: Bench) -> None:
    bench.submit(Stop(), 1)
    bench.run(1.0)
    assert previewed(bench, MoveForward(1.0)).length_m == pytest.approx(1.0, abs=0.05)


@pytest.mark.at_length
def test_it_goes_by_the_speeds_that_are_set(bench: Bench) -> None:
    fast = previewed(bench, MoveForward(4.0))
    bench.submit(SetTravelSpeed(0.25), 1)
    slow = previewed(bench, MoveForward(4.0))
    assert slow.duration_s == pytest.approx(4.0 / 0.25 + 0.25, abs=0.3)
    assert slow.duration_s > 2 * fast.duration_s


@pytest.mark.at_length
def test_the_path_is_in_time_and_ends_at_the_end(bench: Bench) -> None:
    reported = previewed(
        bench, FollowPath(tuple(Waypoint(float(x % 2), 0.0) for x in range(1, 30)))
    )
    times_s = [each.time_s for each in reported.path]
    assert times_s == sorted(set(times_s))
    assert MAX_POSES / 2 < len(reported.path) <= MAX_POSES
    assert (times_s[0], times_s[-1]) == (0.0, reported.duration_s)


@pytest.mark.parametrize(
    "motion",
    [
        MoveForward(1000.0),
        MoveTo(Waypoint(float("nan"), 0.0)),
        RotateBy(float("inf")),
        FollowPath(()),
        MoveTo(Waypoint(3.0, 0.5)),
        FollowPath((Waypoint(0.0, 1.0), Waypoint(6.0, -1.0))),
        DriveFor(1.0, 0.0, 5.0),
    ],
)
def test_a_refusal_of_a_command_refuses_the_preview(tmp_path: Path, motion: Motion) -> None:
    with Bench(tmp_path, replace(JACKAL, zones=Zones(rocks=(ROCK,)))) as bench:
        # as texts: a refusal may name a figure that is no number, which equals nothing
        assert repr(refused(bench, motion)) == repr(bench.refusal(motion, 1))


def test_without_odometry_there_is_none(bench: Bench) -> None:
    bench.odometry = False
    bench.run(3.0)
    assert refused(bench, MoveForward(1.0)) == bench.refusal(MoveForward(1.0), 1)
    assert refused(bench, plan(AHEAD)).reason is Reason.NO_ODOMETRY


def test_a_refusal_for_an_uncertain_pose_refuses_the_preview(bench: Bench) -> None:
    there = MoveTo(Waypoint(1.0, 0.0))
    bench.execute(ConfirmPose(0.5, 0.0), 1)
    assert refused(bench, there) == bench.refusal(there, 2)
    steps = '<Sequence>{}<moveTo x="1" y="0" deadline_s="60"/></Sequence>'
    found = refused(bench, plan(steps.format('<moveForward distance="1" deadline_s="60"/>')))
    assert found.reason is Reason.POSE_UNCERTAIN
    assert previewed(bench, MoveForward(1.0)).path
    bench.execute(ConfirmPose(0.0, 0.0), 3)
    assert previewed(bench, there).path


def test_what_takes_too_long_is_refused(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preview, "MAX_PREVIEW_S", 5.0)
    found = refused(bench, MoveForward(9.0))
    assert found.reason is Reason.NOT_SUPPORTED
    assert "duration exceeds 5 s" in found.text


def test_the_clearance_is_that_of_the_nearest_along_the_path(tmp_path: Path) -> None:
    bed = KeepOut("bed", ((0.0, 3.0), (1.0, 3.0), (1.0, 4.0), (0.0, 4.0)))
    with Bench(tmp_path, replace(JACKAL, zones=Zones(keep_out=(bed,), rocks=(ROCK,)))) as bench:
        found = previewed(bench, MoveForward(1.5)).clearance
        assert found is not None
        assert found.obstacle == "rock 'boulder'"
        assert found.least_m == pytest.approx(3.0 - 1.5 - 0.5 - 0.3335, abs=0.02)


def test_a_detour_is_previewed(tmp_path: Path) -> None:
    with Bench(tmp_path, replace(JACKAL, zones=Zones(rocks=(ROCK,)))) as bench:
        found = previewed(bench, MoveTo(Waypoint(6.0, 0.0)))
        assert found.clearance is not None
        assert found.clearance.least_m >= 0.1 - 0.01
        assert 6.0 < found.length_m < 7.0


def test_without_zones_there_is_no_clearance(bench: Bench) -> None:
    assert previewed(bench, MoveForward(1.0)).clearance is None


def test_a_plan_is_taken_step_by_step(bench: Bench) -> None:
    body = (
        '<Sequence><setTravelSpeed speed="0.5" deadline_s="5"/>'
        f"<Fallback>{AHEAD}{BACK}</Fallback>"
        f'<Repeat num_cycles="2">{BACK}</Repeat>'
        '<Timeout msec="20000"><rotateBy angle="1.0"/></Timeout>'
        f'<RetryUntilSuccessful num_attempts="3">{BACK}</RetryUntilSuccessful>'
        '<takePicture deadline_s="9"/></Sequence>'
    )
    reported = previewed(bench, plan(body))
    assert reported.length_m == pytest.approx(4.0 + 2.0 + 1.0, abs=0.2)
    assert reported.turned_rad == pytest.approx(1.0, abs=0.1)
    assert reported.duration_s > 7.0 / 0.5
    assert bench.executive.plans() == []
    assert bench.executive.status.travel_speed_mps == JACKAL.drive.travel_speed_mps


@pytest.mark.parametrize(
    ("body", "reason", "message"),
    [
        ('<moveForward distance="4" deadline_s="2"/>', Reason.PLAN_DEADLINE, "exceeds 2 s"),
        (
            '<Timeout msec="3000"><moveForward distance="4"/></Timeout>',
            Reason.PLAN_DEADLINE,
            "Timeout: duration",
        ),
        (
            f"<Sequence>{AHEAD}{AHEAD}</Sequence>",
            Reason.PATH_BLOCKED,
            "moveForward 2: path blocked by rock",
        ),
        ('<moveForward distance="4000" deadline_s="2"/>', Reason.PLAN_BAD_ARGUMENT, "4000"),
    ],
)
def test_a_plan_that_would_not_do_is_refused_by_its_step(
    tmp_path: Path, body: str, reason: Reason, message: str
) -> None:
    rock = replace(ROCK, x_m=6.0)
    with Bench(tmp_path, replace(JACKAL, zones=Zones(rocks=(rock,)))) as bench:
        found = refused(bench, plan(body))
        assert found.reason is reason
        assert message in found.text


def test_the_steps_of_a_plan_are_previewed(tmp_path: Path) -> None:
    def at(step: str) -> str:
        return f'<moveForward name="{step}" distance="{{}}" deadline_s="60"/>'

    body = at("near").format(1.5) + "<takePicture deadline_s='9'/>" + at("away").format(-1)
    with Bench(tmp_path, replace(JACKAL, zones=Zones(rocks=(ROCK,)))) as bench:
        run = bench.executive.preview(plan(f"<Sequence>{body}{at('far').format(60)}</Sequence>"))
        assert isinstance(run, PreviewRun)
        run.set_up()
        while not run.advance(100):
            pass
        near, picture, away, far = run.steps
        assert (near.length_m, away.length_m) == pytest.approx((1.5, 1.0), abs=0.05)
        assert (picture.duration_s, picture.length_m, picture.clearance) == (0.0, 0.0, None)
        assert near.end.pose.x_m == pytest.approx(1.5, abs=0.05)
        assert near.clearance is not None
        assert away.clearance is not None
        assert near.clearance.least_m == pytest.approx(3.0 - 1.5 - 0.5 - 0.3335, abs=0.02)
        assert away.clearance.least_m == pytest.approx(near.clearance.least_m, abs=0.05)
        assert far.refusal is not None
        assert isinstance(run.result, Refusal)
        assert run.result.text == f"{far.node}: {far.refusal.text}"
        whole = previewed(bench, plan(f"<Sequence>{body}</Sequence>"))
        each = [near, picture, away]
        assert whole.duration_s == pytest.approx(sum(step.duration_s for step in each))
        assert whole.energy_j == pytest.approx(sum(step.energy_j or 0.0 for step in each))
        assert whole.clearance is not None
        assert whole.clearance.least_m == min(near.clearance.least_m, away.clearance.least_m)


def test_an_impossible_preview_is_reported(bench: Bench) -> None:
    assert "does not offer it" in refused(bench, MoveTo(ASIDE, Controller.MPC)).text


@pytest.mark.parametrize(
    "motion",
    [
        MoveForward(-0.4),
        RotateBy(2.0),
        DriveFor(0.15, 0.3, 3.0),
        MoveTo(Waypoint(0.5, 0.4, 1.0)),
        FollowPath((Waypoint(0.4, 0.0), Waypoint(0.4, 0.4))),
    ],
)
def test_a_delegated_motion_of_mocup_takes_its_previewed_time(
    tmp_path: Path, motion: Motion
) -> None:
    settings = load_settings("mocup")
    lockstep = LockStep(settings, World(), tmp_path)
    lockstep.run(0.5)
    reported = worked_out(lockstep.executive, motion)
    assert isinstance(reported, Preview)
    lockstep.submit(Command(Identity("MOE", 1), motion, "direct"))
    lockstep.run_until(lambda: lockstep.executive.active_command is not None, 1.0)
    lockstep.run_until(lambda: lockstep.executive.active_command is None, 60.0)
    last = lockstep.downlink_record.reports[-1]
    assert last.stage is Stage.EXECUTED
    ended = {figure.name: figure.value for figure in last.figures}
    assert ended["predicted duration"] == pytest.approx(reported.duration_s)
    assert ended["duration"] == pytest.approx(reported.duration_s, rel=0.07)
    seen = lockstep.executive.status.pose
    assert seen.point.distance_m(reported.end.point) < 0.03
    assert abs(wrap_rad(seen.heading_rad - reported.end.heading_rad)) < 0.05
    lockstep.executive.simulate_crash()


SMOOTH = replace(JACKAL, mpc=replace(JACKAL.mpc, selectable=True))
BY_MPC = '<moveTo x="1" y="0" controller="mpc" deadline_s="{}"/>'


@pytest.fixture(scope="module")
def solver() -> SharedSolver:
    return make_solver(SMOOTH)


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("own", "motion"),
    [
        (Controller.MPC, MoveTo(Waypoint(-1.0, 2.0, 2.5))),
        (Controller.TURN_DRIVE, MoveTo(ASIDE, Controller.MPC)),
        (Controller.MPC, FollowPath((Waypoint(2.0, 1.0), Waypoint(3.0, -1.0), ASIDE))),
        (Controller.MPC, MoveTo(Waypoint(2.0, 1.0, tolerance_m=0.01))),
    ],
)
def test_a_motion_by_mpc_takes_its_previewed_time(
    own: Controller, motion: MoveTo | FollowPath, tmp_path: Path, solver: SharedSolver
) -> None:
    settings = replace(SMOOTH, controller=own)
    lockstep = LockStep(settings, World(), tmp_path, solver=solver)
    lockstep.run(0.5)
    run = lockstep.executive.preview(motion)
    assert isinstance(run, PreviewRun)
    run.set_up()
    while run.result is None:
        run.advance(7)
    found, last = run.result, lockstep.downlink_record.reports
    assert isinstance(found, Preview), found
    began_s = lockstep.time_s
    lockstep.submit(Command(Identity("test", 1), motion, "direct"))
    assert lockstep.run_until(lambda: last[-1].stage is Stage.EXECUTED, 60.0)
    assert lockstep.time_s - began_s == pytest.approx(found.duration_s, rel=0.05, abs=0.1)
    assert lockstep.executive.status.pose.point.distance_m(found.end.point) < found.within_m + 0.01
    reported = [each for each in last if "predicted:" in each.text]
    assert [f"{found.duration_s:.1f} s" in each.text for each in reported] == [True]
    lockstep.executive.simulate_crash()


def test_a_plan_with_steps_that_mpc_drives_is_previewed(
    tmp_path: Path, solver: SharedSolver
) -> None:
    with Bench(tmp_path, SMOOTH, solver=solver) as bench:
        assert 1.5 < previewed(bench, plan(BY_MPC.format(9))).duration_s < 3.0
        assert refused(bench, plan(BY_MPC.format(1))).reason is Reason.PLAN_DEADLINE


class Slow:
    """A solver that is at each question for as long as a test says."""

    lead_ticks = 1

    def __init__(self, solver: SharedSolver) -> None:
        self._solver = solver
        self.busy = False

    def request(self, problem: TrajectoryProblem) -> None:
        self.busy = True
        self._solver.request(problem)

    def take_result(self) -> Trajectory | None:
        return self._solver.take_result()

    def fork(self, apart: bool = False) -> "Slow":
        return self


def test_a_preview_waits_for_its_plans(tmp_path: Path, solver: SharedSolver) -> None:
    slow = Slow(solver)
    with Bench(tmp_path, SMOOTH, solver=slow) as bench:
        run = bench.executive.preview(MoveTo(ASIDE, Controller.MPC))
        assert isinstance(run, PreviewRun)
        run.set_up()
        waited = 0
        while not run.advance(1000):
            assert run.waiting_for_solver
            slow.busy = False
            waited += 1
        assert isinstance(run.result, Preview)
        assert 2 <= waited < 12
        assert run.result.duration_s < 6.0


def test_the_base_turns_about_its_control_point() -> None:
    clock = ManualClock()
    base = KinematicBase(clock, JACKAL, Pose())
    base.drive(Velocity(0.0, 1.0))
    for _ in range(40):
        clock.advance(JACKAL.tick_s)
        base.advance()
    ahead_m = JACKAL.turn_drive.control_point_m
    assert base.pose.heading_rad == pytest.approx(2.0, abs=0.06)
    assert base.pose.ahead(ahead_m).x_m == pytest.approx(ahead_m)


def test_energy_is_predicted_if_the_settings_have_the_power_of_motion(tmp_path: Path) -> None:
    takes = PredictionSettings(standing_w=20.0, travel_j_per_m=40.0, rotate_j_per_rad=30.0)
    with Bench(tmp_path, replace(JACKAL, prediction=takes)) as bench:
        reported = previewed(bench, MoveForward(2.0))
        assert reported.energy_j == pytest.approx(20.0 * reported.duration_s + 40.0 * 2.0, rel=0.05)
    with Bench(tmp_path, replace(JACKAL, prediction=PredictionSettings(), battery=None)) as bench:
        assert previewed(bench, MoveForward(2.0)).energy_j is None


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("position_m", 0.0),
        ("position_m_per_m", -0.1),
        ("standing_w", -3.0),
        ("travel_j_per_m", 1e12),
    ],
)
def test_a_figure_that_cannot_be_is_refused(key: str, value: float) -> None:
    with pytest.raises(SettingsError, match=key):
        structure({key: value}, PredictionSettings, "rover.yaml")


CROWDS = 4
COMPARISONS = 1_500
"""Of a point with a line, in one slice; each takes about half a microsecond."""


@pytest.fixture
def comparisons(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the comparisons of points with lines of obstacles, in the one element."""
    count, find = [0], zones._to_line_m

    def counting(point: Point, start: Point, end: Point) -> float:
        count[0] += 1
        return find(point, start, end)

    monkeypatch.setattr(zones, "_to_line_m", counting)
    return count


def test_slices_are_short_by_the_number_of_their_comparisons(
    tmp_path: Path, comparisons: list[int]
) -> None:
    maximum, detours = 0, 0
    for seed in range(CROWDS):
        around, target = crowd(seed)
        with Bench(tmp_path / str(seed), replace(JACKAL, zones=around)) as bench:
            run = bench.executive.preview(MoveTo(target))
            assert isinstance(run, PreviewRun)
            comparisons[0] = 0
            run.set_up()
            while run.result is None:
                maximum, comparisons[0] = max(maximum, comparisons[0]), 0
                run.advance(SLICE_TICKS)
            maximum = max(maximum, comparisons[0])
            detours += isinstance(run.result, Preview)
    assert detours > 1
    assert maximum < COMPARISONS


@pytest.mark.at_length
def test_the_clearance_is_that_of_all_obstacles_though_distant_ones_are_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    around, _ = crowd(2)
    path = FollowPath((Waypoint(0.5, 0.2), Waypoint(0.0, -0.4), Waypoint(-0.5, 0.0)))
    with Bench(tmp_path, replace(JACKAL, zones=around)) as bench:
        found = previewed(bench, path).clearance
        monkeypatch.setattr(preview, "ROUNDING_M", inf)  # passes over none
        assert found is not None
        assert previewed(bench, path).clearance == found


def test_a_line_that_ends_deep_in_a_zone_is_near_to_it() -> None:
    strip = KeepOut("strip", ((-2.0, -0.2), (2.0, -0.2), (2.0, 0.2), (-2.0, 0.2)))
    square = KeepOut("square", ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)))
    jackal = replace(JACKAL, zones=Zones((), (strip, square)))
    assert jackal.footprint is not None
    trace = preview._PathTrace(jackal, [TimedPose(0.0, Pose(-1.5))])
    for x_m in (-0.5, -0.4):  # of the first line the edge of the square is the nearest
        trace.add(0.0, Pose(x_m))
    assert trace.clearance is not None
    assert trace.clearance.least_m == pytest.approx(-0.5 - jackal.footprint.radius_m)
    assert trace.clearance.obstacle == square.label
