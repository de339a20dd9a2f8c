"""What a second odometry says of the end of a motion, and how it corrects the pose."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from math import cos, hypot, nan, pi, radians, sin
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import DriveFor, FollowPath, MoveForward, MoveTo, RotateBy, Waypoint
from executive.settings import SecondOdometrySettings, Settings, load_settings
from executive.state.fusion import STEP_M, PoseFusion
from executive.values.facts import Odometry, SecondOdometry
from executive.values.geometry import STANDING, Point, Pose, Velocity, wrap_rad
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.support.kinematic import STEP_S, Bench, KinematicRover

pytestmark = pytest.mark.alike

LATE_S = 0.4
PERIOD_S = 0.5
TURNED_RAD = 0.7
"""The second odometry has a frame of its own."""


def with_second_odometry(fused: bool = False) -> Settings:
    jackal = load_settings("jackal")
    second = SecondOdometrySettings(2, fused)
    return replace(jackal, sensors=replace(jackal.sensors, second_odometry=second))


def seen_from_other_origin(pose: Pose) -> Pose:
    x_m, y_m = pose.x_m - 3.0, pose.y_m + 1.0
    return Pose(
        x_m * cos(TURNED_RAD) - y_m * sin(TURNED_RAD),
        x_m * sin(TURNED_RAD) + y_m * cos(TURNED_RAD),
        heading_rad=wrap_rad(pose.heading_rad + TURNED_RAD),
    )


def leaning(pose: Pose, rise_rad: float) -> Pose:
    """Return a pose on a slope that rises towards x."""
    heading_rad = pose.heading_rad
    pitch_rad, roll_rad = -rise_rad * cos(heading_rad), -rise_rad * sin(heading_rad)
    return replace(pose, pitch_rad=pitch_rad, roll_rad=roll_rad)


@dataclass
class SlidingRover(KinematicRover):
    """Slides down a slope wherever it turns, which its wheels do not show.

    Attributes:
        true: where it is.
    """

    rise_rad: float = radians(10)
    slide_m_per_rad: float = 0.02
    true: Pose = field(default_factory=Pose)

    def seen_truth(self, _: Pose) -> Pose:
        return self.true

    def advance(self, step_s: float) -> None:
        before = self.pose
        super().advance(step_s)
        slid_m = self.slide_m_per_rad * abs(self.velocity.rotate_radps) * step_s
        self.true = Pose(
            self.true.x_m + self.pose.x_m - before.x_m - slid_m,
            self.true.y_m + self.pose.y_m - before.y_m,
            heading_rad=self.pose.heading_rad,
        )
        self.pose = leaning(self.pose, self.rise_rad)


class SeeingBench(Bench):
    """A second odometry tells every half second of the pose, some time later.

    Attributes:
        seen: what it sees of a pose; None where it sees nothing.
        again: whether each frame comes once more, after the one that follows it.
    """

    def __init__(
        self, folder: Path, settings: Settings, rover: KinematicRover | None = None
    ) -> None:
        self.seen: Callable[[Pose], Pose | None] = lambda pose: pose
        self.again = False
        self._frames: list[SecondOdometry] = []
        self._last: list[SecondOdometry] = []
        super().__init__(folder, settings, rover=rover)

    def step(self) -> None:
        super().step()
        now_s = self.clock.now_s()
        ticks = round(now_s / STEP_S)
        if ticks % round(PERIOD_S / STEP_S) == 0:
            pose = self.seen(self.rover.pose)
            if pose is not None:
                self._frames.append(SecondOdometry(now_s, seen_from_other_origin(pose)))
        while self._frames and self._frames[0].stamp_s <= now_s - LATE_S + 1e-9:
            frame = self._frames.pop(0)
            for each in (frame, frame, *self._last) if self.again else (frame,):
                self.executive.observe(each)
            self._last = [frame]


@pytest.fixture
def seeing(tmp_path: Path) -> Iterator[SeeingBench]:
    with SeeingBench(tmp_path, with_second_odometry()) as bench:
        bench.run(1.5)
        yield bench


REQUESTS = [
    MoveTo(Waypoint(1.0, 0.5, 0.3)),
    MoveForward(-1.0),
    RotateBy(2.0),
    DriveFor(0.5, 0.2, 2.0),
    FollowPath((Waypoint(0.5, 0.0), Waypoint(1.0, 0.5))),
]


@pytest.mark.at_length
@pytest.mark.parametrize("request_", REQUESTS, ids=lambda request: type(request).__name__)
def test_a_motion_ends_executed_once_a_frame_taken_after_it_agrees(
    seeing: SeeingBench, request_: MoveTo
) -> None:
    seeing.submit(request_, 1)
    standstill_s = None
    while not seeing.stages(1)[-1].terminal:
        seeing.step()
        if seeing.rover.velocity != STANDING:
            standstill_s = seeing.clock.now_s()
    assert standstill_s is not None
    assert seeing.stages(1)[-1] is Stage.EXECUTED
    assert LATE_S <= seeing.clock.now_s() - standstill_s <= LATE_S + PERIOD_S + 0.3
    assert "by odometry and second odometry" in seeing.last(1).text
    figures = {figure.name: figure.value for figure in seeing.last(1).figures}
    assert figures["odometries apart"] < 0.02
    assert figures["headings apart"] < 0.01


@pytest.mark.at_length
@pytest.mark.parametrize(
    "request_",
    [MoveTo(Waypoint(3.0, 0.0)), MoveForward(-3.0), RotateBy(2.0), DriveFor(0.5, 0.0, 6.0)],
    ids=lambda request: type(request).__name__,
)
def test_a_motion_that_slipped_slowly_is_not_confirmed(
    seeing: SeeingBench, request_: MoveTo
) -> None:
    seeing.seen = lambda pose: Pose(0.9 * pose.x_m, heading_rad=0.94 * pose.heading_rad)
    seeing.submit(request_, 1)
    assert seeing.finish(1) is Stage.FAILED
    last = seeing.last(1)
    assert last.reason is Reason.NOT_CONFIRMED
    figures = {figure.name: figure.value for figure in last.figures}
    off = figures["odometries apart"] > figures["bound"]
    assert off or figures["headings apart"] > figures["heading bound"]


@pytest.mark.at_length
def test_a_motion_without_frames_is_not_verified(seeing: SeeingBench) -> None:
    seeing.submit(MoveForward(1.0), 1)
    seeing.run(1.0)
    seeing.seen = lambda _: None
    assert seeing.finish(1) is Stage.FAILED
    assert seeing.last(1).reason is Reason.UNVERIFIED
    assert "no second-odometry frame after the motion" in seeing.last(1).text


def test_a_motion_waits_for_a_first_frame_before_it_begins(tmp_path: Path) -> None:
    with SeeingBench(tmp_path, with_second_odometry()) as bench:
        bench.seen = lambda _: None
        bench.run(20.0)
        bench.submit(MoveForward(1.0), 1)
        bench.run(3.0)
        assert set(bench.rover.sent) <= {STANDING}
        bench.seen = lambda pose: pose
        assert bench.finish(1) is Stage.EXECUTED
        bench.seen = lambda _: None
        bench.run(20.0)
        bench.submit(MoveForward(1.0), 2)
        bench.run(8.0)
        bench.seen = lambda pose: pose
        assert bench.finish(2) is Stage.FAILED
        assert bench.last(2).reason is Reason.UNVERIFIED
        assert "no second-odometry frame before the motion" in bench.last(2).text


def test_on_a_slope_it_reaches_its_target_at_any_frame_rate(tmp_path: Path) -> None:
    ends = []
    for name, again in (("once", False), ("again", True)):
        (tmp_path / name).mkdir()
        rover = SlidingRover()
        settings = with_second_odometry(fused=True)
        with SeeingBench(tmp_path / name, settings, rover) as bench:
            bench.seen, bench.again = rover.seen_truth, again
            bench.run(1.5)
            bench.execute(RotateBy(2.0), 1)
            bench.execute(MoveForward(1.0), 2)
            bench.execute(RotateBy(-2.0), 3)
            bench.execute(MoveTo(Waypoint(1.0, 1.0, 0.0)), 4)
            bench.run(2.0)
            believed = bench.executive.status.pose
            ends.append((believed, rover.true))
        assert rover.pose.point.distance_m(rover.true.point) > 0.05
        assert believed.point.distance_m(rover.true.point) < 0.03
        assert rover.true.point.distance_m(Point(1.0, 1.0)) < 0.1
    assert ends[0] == ends[1]


@pytest.mark.parametrize("fused", [False, True])
def test_frames_before_a_reset_of_the_odometry_are_ignored(tmp_path: Path, fused: bool) -> None:
    with SeeingBench(tmp_path, with_second_odometry(fused)) as bench:
        bench.run(3.0)
        pose = bench.rover.pose
        bench.executive.observe(Odometry(bench.clock.now_s() - 2.5, pose, STANDING))
        bench.executive.observe(SecondOdometry(bench.clock.now_s(), Pose(nan, 0.0)))
        bench.run(1.5)
        bench.execute(MoveForward(1.0), 1)
        assert "by odometry and second odometry" in bench.last(1).text
        assert bench.executive.status.pose.x_m == pytest.approx(1.0, abs=0.02)


class Track:
    """A rover whose wheels show less than what truly happens, and a fusion that is told of both.

    Attributes:
        slide: m/s of the truth, which the wheels do not show.
    """

    def __init__(self, fused: bool = True, lean: Pose | None = None) -> None:
        self.fusion = PoseFusion(fused)
        self.lean = lean or Pose()
        self.wheels = self.true = Pose()
        self.steps = 0
        self.max_m = 0.0
        self.noise_m = 0.0
        self.frames: list[SecondOdometry] = []
        self.go(1.0, STANDING)

    def go(
        self,
        duration_s: float,
        velocity: Velocity,
        slide_mps: tuple[float, float] = (0.0, 0.0),
        slide_m_per_rad: float = 0.0,
    ) -> None:
        """Move for a while; down is -x."""
        for _ in range(round(duration_s / 0.02)):
            self.steps += 1
            stamp_s = self.steps * 0.02
            heading_rad = self.wheels.heading_rad + velocity.rotate_radps * 0.02
            distance_m = velocity.travel_mps * 0.02
            x_m, y_m = distance_m * cos(heading_rad), distance_m * sin(heading_rad)
            slid_m = slide_m_per_rad * abs(velocity.rotate_radps) * 0.02
            heading_rad = wrap_rad(heading_rad)
            wheels = Pose(self.wheels.x_m + x_m, self.wheels.y_m + y_m, heading_rad=heading_rad)
            self.wheels = leaning(wheels, self.lean.pitch_rad)
            self.true = Pose(
                self.true.x_m + x_m + slide_mps[0] * 0.02 - slid_m,
                self.true.y_m + y_m + slide_mps[1] * 0.02,
                heading_rad=heading_rad,
            )
            before = self.fusion.pose
            self.fusion.add_odometry(Odometry(stamp_s, self.wheels, velocity))
            moved_m = hypot(self.fusion.pose.x_m - before.x_m, self.fusion.pose.y_m - before.y_m)
            self.max_m = max(self.max_m, moved_m)
            if self.steps % 25 == 0:
                sign = 1 if self.steps % 50 else -1
                seen = replace(self.true, x_m=self.true.x_m + sign * self.noise_m)
                self.frames.append(SecondOdometry(stamp_s, seen_from_other_origin(seen)))
            if self.frames and self.frames[0].stamp_s <= stamp_s - LATE_S:
                self.fusion.add_second_odometry(self.frames.pop(0))

    @property
    def off_m(self) -> float:
        """How far the pose is from the truth."""
        return self.fusion.pose.point.distance_m(self.true.point)


@given(
    st.lists(
        st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-pi, pi)), min_size=1, max_size=40
    )
)
@settings(max_examples=30, deadline=None)
def test_without_fusion_it_is_the_odometry_bit_by_bit(
    poses: list[tuple[float, float, float]],
) -> None:
    fusion = PoseFusion(fused=False)
    for number, (x_m, y_m, heading_rad) in enumerate(poses):
        pose = Pose(x_m, y_m, heading_rad=heading_rad)
        fusion.add_odometry(Odometry(number * 0.1, pose, STANDING))
        fusion.add_second_odometry(SecondOdometry(number * 0.1, Pose(y_m, x_m)))
        assert fusion.pose == pose


def test_on_level_ground_noise_corrects_nothing() -> None:
    track = Track()
    track.noise_m = 0.01
    track.go(20.0, Velocity(0.5, 0.1))
    assert track.off_m < 0.004


def test_a_slide_on_a_slope_is_corrected_in_small_steps() -> None:
    track = Track(lean=Pose(pitch_rad=radians(10)))
    track.go(4.0, Velocity(0.5, 0.0), slide_mps=(0.0, -0.08))
    track.go(1.5, STANDING)
    assert track.wheels.point.distance_m(track.true.point) > 0.3
    assert track.off_m < 0.03
    assert track.max_m <= STEP_M + 0.5 * 0.02 + 1e-9


def test_a_slow_creep_while_standing_adds_up() -> None:
    track = Track(lean=Pose(pitch_rad=radians(15)))
    track.go(60.0, STANDING, slide_mps=(-0.006, 0.0))
    assert track.off_m < 0.03


def test_an_unexplained_difference_is_corrected_on_level_ground_too() -> None:
    track = Track()
    track.go(3.0, Velocity(0.2, 0.0))
    track.go(1.0, STANDING, slide_mps=(0.0, 0.5))
    track.go(2.0, STANDING)
    assert track.off_m < 0.08


def test_the_slide_of_turns_is_learnt_and_then_foreseen() -> None:
    track = Track(lean=Pose(pitch_rad=radians(10)))
    assert track.fusion.turn_slide(1.0).x_m == 0.0
    for _ in range(4):
        track.go(2.0, Velocity(0.0, 1.0), slide_m_per_rad=0.09)
        track.go(1.0, STANDING)
    slide = track.fusion.turn_slide(-2.0)
    assert slide.x_m == pytest.approx(-0.18, abs=0.03)
    assert slide.y_m == pytest.approx(0.0, abs=0.02)
    before_m = track.true.x_m
    track.go(0.4, Velocity(0.0, 1.0), slide_m_per_rad=0.09)
    assert track.true.x_m < before_m
    assert track.off_m < 0.03
