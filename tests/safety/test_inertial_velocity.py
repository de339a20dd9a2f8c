"""What accelerometer and gyro tell of a rover whose wheels stand, or do not hold it."""

from math import inf, nan, radians, sin

import pytest

from executive.safety.inertial_velocity import InertialVelocity
from executive.settings import SlipSettings
from executive.state import SourceMotion
from executive.values.facts import Imu
from executive.values.geometry import GRAVITY_MPS2, STANDING, Velocity

STEP_S = 0.01


class Rover:
    """Moves ahead with a true speed, its wheels with another; the IMU has a bias.

    Attributes:
        pitch_rad: nose down is positive, as the ground is below it.
        is_received: whether the IMU is received.
        received, cycle: the steps of a cycle with a message, and its length.
        burst: number of messages that arrive at once.
        rolls: number of steps between two velocities of the wheels.
    """

    def __init__(self, pitch_rad: float = 0.0, bias_mps2: float = 0.08) -> None:
        self.felt = InertialVelocity(SlipSettings())
        self.now_s = 10.0
        self.true_mps = self.wheels_mps = 0.0
        self.pitch_rad, self.bias_mps2 = pitch_rad, bias_mps2
        self.aside_mps2 = 0.0
        self.is_received = True
        self.received, self.cycle, self._steps = {0}, 1, 0
        self.rolls, self._felt_s = 2, 10.0
        self.burst, self._delayed = 1, list[tuple[Imu, bool]]()
        self.go(1.0)

    def go(
        self, duration_s: float, true_mps2: float = 0.0, wheels_mps2: float | None = None
    ) -> None:
        """Accelerate for a while: the wheels as the rover, unless given."""
        wheels_mps2 = true_mps2 if wheels_mps2 is None else wheels_mps2
        for step in range(round(duration_s / STEP_S)):
            self.now_s += STEP_S
            before_mps = self.true_mps
            self.true_mps += true_mps2 * STEP_S
            self.wheels_mps += wheels_mps2 * STEP_S
            gained_mps2 = (self.true_mps - before_mps) / STEP_S
            ahead_mps2 = gained_mps2 - GRAVITY_MPS2 * sin(self.pitch_rad) + self.bias_mps2
            fact = Imu(
                self.now_s, 0.0, self.pitch_rad, 0.0, 0.0, 0.0, ahead_mps2, self.aside_mps2, 9.81
            )
            self._steps += 1
            if self.is_received and self._steps % self.cycle in self.received:
                self._delayed.append((fact, abs(self.wheels_mps) < 1e-9))
            if len(self._delayed) >= self.burst:
                for fact, resting in self._delayed:
                    lost = fact.stamp_s - self._felt_s > 0.06
                    self.felt.feel(fact, fact.stamp_s, resting, lost=lost and self.cycle == 1)
                    self._felt_s = fact.stamp_s
                self._delayed.clear()
            if step % self.rolls == self.rolls - 1:
                self.felt.roll(Velocity(self.wheels_mps, 0.0), self.now_s)

    def lock(self) -> None:
        """Lock the wheels."""
        self.wheels_mps = 0.0

    def brake(self, friction: float, most_s: float = 60.0) -> None:
        """Slide until friction and slope have taken the speed."""
        downhill_mps2 = GRAVITY_MPS2 * (sin(self.pitch_rad) - friction)
        self.go(min(most_s, self.true_mps / -downhill_mps2), downhill_mps2, 0.0)

    @property
    def motion(self) -> SourceMotion:
        """What is told of its motion."""
        found = self.felt.motion(self.now_s)
        assert found is not None
        return found


def test_a_rover_at_rest_stands_whatever_the_bias() -> None:
    assert Rover(bias_mps2=0.2).motion.is_standing
    assert Rover(radians(-8), bias_mps2=-0.2).motion.is_standing


def test_nothing_is_told_before_the_first_message_and_once_it_is_silent() -> None:
    assert InertialVelocity(SlipSettings()).motion(1.0) is None
    rover = Rover()
    rover.is_received = False
    rover.go(0.5)
    assert rover.felt.motion(rover.now_s) is None


@pytest.mark.parametrize("pitch_deg", [-5, 0, 5])
@pytest.mark.parametrize("friction", [0.1, 0.2])
@pytest.mark.parametrize("speed_mps", [0.3, 1.0])
def test_wheels_that_lock_on_ice_are_not_believed_until_the_speed_is_felt_lost(
    pitch_deg: float, friction: float, speed_mps: float
) -> None:
    rover = Rover(radians(pitch_deg))
    rover.go(speed_mps, 1.0)
    rover.go(1.0)
    rover.lock()
    while rover.true_mps > 0.05:
        rover.brake(friction, 0.05)
        assert not rover.motion.is_standing
        assert rover.motion.figures[0].value == pytest.approx(rover.true_mps, abs=0.03)
    rover.brake(friction)
    rover.go(0.4)
    assert rover.motion.is_standing


def test_an_imu_of_20_hz_with_lost_messages_shows_no_slide() -> None:
    rover = Rover()
    rover.received, rover.cycle = {0, 5, 20}, 30
    for _ in range(20):
        rover.go(0.33, 1.0)
        rover.go(0.41)
        rover.go(0.33, -1.0)
        rover.go(0.37)
    assert rover.felt.slid_m == 0.0


@pytest.mark.parametrize(("burst", "rolls"), [(5, 2), (12, 7), (25, 12)])
def test_measurements_after_the_odometry_are_no_slide(burst: int, rolls: int) -> None:
    rover = Rover()
    rover.burst, rover.rolls = burst, rolls
    for _ in range(20):
        rover.go(0.33, 1.0)
        rover.go(0.41)
        rover.go(0.33, -1.0)
        rover.go(0.37)
    assert rover.felt.slid_m == 0.0
    rover.go(1.0, 1.0)
    rover.lock()
    rover.brake(0.05, 1.0)
    assert not rover.motion.is_standing
    assert rover.felt.slid_m > 0.5


@pytest.mark.parametrize("lost_s", [0.1, 0.25, 0.4])
def test_a_start_during_lost_measurements_is_no_slide(lost_s: float) -> None:
    rover = Rover()
    rover.received = set()
    rover.go(lost_s, 1.0)
    rover.received = {0}
    rover.go(1.0)
    assert rover.felt.slid_m == 0.0
    assert rover.motion.figures[0].value == pytest.approx(lost_s, abs=0.02)


def test_gaps_that_repeat_hide_no_spin_of_the_wheels() -> None:
    rover = Rover()
    for _ in range(20):
        rover.is_received = False
        rover.go(0.07, 0.0, 0.5)
        rover.is_received = True
        rover.go(0.03, 0.0, 0.5)
    assert rover.felt.slid_m > 0.5
    assert rover.felt.apart_s > 1.0


@pytest.mark.parametrize("before_s", [0.0, 0.04, 0.08])
def test_a_slide_that_begins_in_a_gap_counts(before_s: float) -> None:
    rover = Rover()
    rover.go(1.0, 1.0)
    rover.go(1.0)
    rover.is_received = False
    rover.go(before_s)
    rover.lock()
    rover.brake(0.05, 0.1 - before_s)
    rover.is_received = True
    rover.brake(0.05)
    assert rover.felt.slid_m == pytest.approx(1.0, abs=0.2)


def test_an_imu_of_20_hz_shows_a_slide() -> None:
    rover = Rover()
    rover.received, rover.cycle = {0}, 5
    rover.go(1.0, 1.0)
    rover.go(1.0)
    rover.lock()
    rover.brake(0.05, 1.0)
    assert not rover.motion.is_standing
    assert rover.felt.slid_m > 0.5


def test_it_tells_what_the_wheels_lost_and_what_was_felt() -> None:
    rover = Rover()
    rover.go(1.0, 1.0)
    rover.lock()
    rover.brake(0.05, 0.5)
    wheels, felt = rover.felt.lost_speeds
    assert (wheels.value, felt.value) == pytest.approx((1.0, 0.245), abs=0.03)
    assert rover.motion.figures[0].value == pytest.approx(0.755, abs=0.03)


def test_a_stop_that_the_ground_holds_is_told_within_its_window() -> None:
    rover = Rover(radians(10))
    rover.go(1.0, 1.0)
    rover.lock()
    rover.go(0.2, -5.0, 0.0)
    rover.go(0.22)
    assert rover.motion.is_standing


def test_braking_that_was_under_way_counts_from_its_begin() -> None:
    rover = Rover(radians(4))
    rover.go(1.0, 1.0)
    rover.go(0.5, -0.2, -1.0)
    rover.lock()
    rover.go(0.4)
    assert not rover.motion.is_standing
    assert rover.motion.figures[0].value == pytest.approx(0.9, abs=0.05)


def test_a_rover_that_slides_sideways_does_not_stand() -> None:
    rover = Rover(radians(4))
    rover.aside_mps2 = 0.35
    rover.go(1.0)
    rover.aside_mps2 = 0.0
    rover.go(1.0)
    assert not rover.motion.is_standing
    assert rover.motion.figures[0].value == pytest.approx(0.35, abs=0.05)


def test_what_drives_off_after_the_stop_is_seen_again() -> None:
    rover = Rover(radians(5))
    rover.go(1.0, 0.36, 0.0)
    assert not rover.motion.is_standing
    rover.go(3.0)
    assert not rover.motion.is_standing, "it slides evenly"
    assert rover.motion.figures[0].value == pytest.approx(0.36, abs=0.08)


def test_on_level_ground_the_end_of_braking_is_enough() -> None:
    rover = Rover()
    rover.go(0.5, 1.0)
    rover.is_received = False
    rover.go(0.4)  # the wheels lose their speed while nothing is received
    rover.lock()
    rover.true_mps = 0.0
    rover.is_received = True
    rover.go(0.3)
    assert not rover.motion.is_standing
    rover.go(0.5)
    assert rover.motion.is_standing


def test_on_a_slope_it_takes_another_source() -> None:
    rover = Rover(radians(5))
    rover.go(0.5, 1.0)
    rover.is_received = False
    rover.go(0.4)
    rover.lock()
    rover.true_mps = 0.0
    rover.is_received = True
    rover.go(4.0)
    assert not rover.motion.is_standing
    rover.felt.reset_at_rest(rover.now_s - 0.4)
    assert rover.motion.is_standing


def test_another_source_does_not_overrule_that_friction_brakes_the_rover() -> None:
    rover = Rover()
    rover.go(1.0, 1.0)
    rover.lock()
    rover.brake(0.05, 1.0)
    rover.felt.reset_at_rest(rover.now_s - 0.4)
    assert not rover.motion.is_standing
    assert rover.motion.figures[0].value == pytest.approx(rover.true_mps, abs=0.03)


def test_the_bias_is_not_learnt_while_the_wheels_disagree() -> None:
    rover = Rover(radians(5), bias_mps2=0.0)
    rover.go(0.5, 1.0)
    rover.lock()
    rover.go(4.0, -0.08, 0.0)
    assert not rover.motion.is_standing
    assert rover.motion.figures[0].value == pytest.approx(rover.true_mps, abs=0.03)


def test_the_bias_is_not_learnt_from_a_rover_that_begins_to_slide() -> None:
    rover = Rover(radians(4))
    rover.go(3.0, 0.1, 0.0)
    assert not rover.motion.is_standing


def test_a_disagreement_of_long_ago_is_within_the_drift_once_the_wheels_turn() -> None:
    rover = Rover(radians(5))
    rover.go(0.2, 0.5, 0.0)
    assert not rover.motion.is_standing
    rover.true_mps = 0.0
    rover.go(0.5, 1.0)
    rover.go(4.0)
    rover.go(0.5, -1.0)
    rover.lock()
    rover.go(0.3)
    assert rover.motion.is_standing


def test_it_is_told_to_move_where_it_begins_in_motion() -> None:
    felt = InertialVelocity(SlipSettings())
    for step in range(100):
        now_s = step * STEP_S
        felt.feel(Imu(now_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.81), now_s, resting=False)
        felt.roll(Velocity(0.7, 0.0), now_s)
    found = felt.motion(0.99)
    assert found is not None
    assert found.figures[0].value == pytest.approx(0.7)
    assert not found.is_standing


@pytest.mark.parametrize("figure", [nan, inf])
def test_messages_that_are_not_finite_are_left_out(figure: float) -> None:
    rover = Rover()
    for _ in range(3):
        rover.now_s += STEP_S
        fact = Imu(rover.now_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, figure, 9.81)
        rover.felt.feel(fact, rover.now_s, resting=True)
        rover.felt.roll(STANDING, rover.now_s)
    rover.go(0.3)
    assert rover.motion.is_standing
