from math import hypot

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.safety import Channel, MotionHistory
from executive.settings import load_settings
from executive.values.clock import ManualClock
from executive.values.facts import Odometry
from executive.values.geometry import STANDING, Pose, Velocity

SETTINGS = load_settings("jackal")


class Drive:
    """A history of a rover that drives straight on at 1 m/s, told 20 ms late at 50 Hz."""

    def __init__(self, offset_s: float = 0.0) -> None:
        self.clock = ManualClock()
        self.history = MotionHistory(self.clock, SETTINGS)
        self.offset_s = offset_s
        self.late_s = 0.02

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.02)):
            self.clock.advance(0.02)
            measured_s = self.clock.now_s() - self.late_s
            self.history.observe(
                Odometry(measured_s + self.offset_s, Pose(x_m=measured_s), Velocity(1.0))
            )
            self.history.command(Velocity(1.0))

    def stall(self, seconds: float) -> None:
        """Receive the messages of a time at once."""
        begun_s = self.clock.now_s()
        self.clock.advance(seconds)
        for step in range(round(seconds / 0.02)):
            stamp_s = begun_s + step * 0.02 + self.offset_s
            self.history.observe(Odometry(stamp_s, Pose(x_m=stamp_s), Velocity(1.0)))


@given(
    st.lists(st.floats(0.004, 0.4), min_size=3, max_size=200),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
def test_a_channel_tells_what_was_added_between_any_two_times(
    steps_s: list[float], first: float, second: float
) -> None:
    channel, time_s = Channel(2), 5.0
    channel.add(time_s, (0.0, 10.0))
    for step_s in steps_s:
        time_s += step_s
        channel.add(time_s, (3.0 * (time_s - 5.0), 10.0 - (time_s - 5.0)))
    span_s = min(max(time_s - 5.03, 0.0), 9.0)
    from_s, to_s = sorted((time_s - span_s * first, time_s - span_s * second))
    added = channel.increase_between(from_s, to_s)
    assert added == pytest.approx([3.0 * (to_s - from_s), from_s - to_s], abs=1e-6)


@pytest.mark.at_length
def test_what_is_older_or_newer_than_all_is_not_known() -> None:
    drive = Drive()
    drive.go(15.0)
    moved, now_s = drive.history.moved, drive.clock.now_s()
    assert moved.increase_between(now_s - 9.5, now_s - 9.0) is not None
    assert moved.increase_between(now_s - 14.0, now_s - 9.0) is None
    assert moved.increase_between(now_s - 1.0, now_s + 1.0) is None


@pytest.mark.parametrize("offset_s", [0.0, 1000.0, -1e6, 1.8e9])
def test_odometry_is_as_old_as_it_comes_later_than_usual(offset_s: float) -> None:
    drive = Drive(offset_s)
    drive.go(2.0)
    history = drive.history
    assert drive.clock.now_s() - history.odometry_time_s == pytest.approx(0.0, abs=0.025)
    drive.late_s = 0.3
    drive.go(0.5)
    assert drive.clock.now_s() - history.odometry_time_s == pytest.approx(0.28, abs=0.025)


def test_stamps_of_the_own_clock_tell_lateness_from_the_first_message_on() -> None:
    drive = Drive()
    drive.late_s = 0.3
    drive.go(1.0)
    assert drive.clock.now_s() - drive.history.odometry_time_s == pytest.approx(0.25, abs=0.002)


def test_simulated_time_that_is_received_late_makes_no_odometry_old() -> None:
    drive = Drive()
    drive.go(1.0)
    drive.late_s = -0.3
    drive.go(0.1)
    drive.late_s = 0.02
    drive.go(0.5)
    assert drive.clock.now_s() - drive.history.odometry_time_s == pytest.approx(0.02, abs=0.005)


def test_a_clock_that_was_set_forward_does_not_hide_late_odometry() -> None:
    drive = Drive()
    drive.go(1.0)
    drive.late_s = -0.3
    drive.go(2.0)
    drive.late_s = 0.1
    drive.go(0.5)
    assert drive.clock.now_s() - drive.history.odometry_time_s == pytest.approx(0.4, abs=0.03)


def test_all_messages_of_a_burst_count_for_the_rate() -> None:
    drive = Drive()
    drive.go(2.0)
    drive.stall(1.5)
    drive.go(0.1)
    arrivals = drive.history.arrivals
    found = arrivals.increase_between(arrivals.time_s - 1.0, arrivals.time_s)
    assert found is not None
    assert found[0] == pytest.approx(75 + 5, abs=2)


def test_a_base_may_stop_during_a_stall_of_the_commands() -> None:
    clock = ManualClock()
    history = MotionHistory(clock, SETTINGS)
    hold(clock, history, Velocity(1.0))
    stalled_s = clock.now_s()
    clock.advance(0.5)
    assert history.commands_in(0.2, clock.now_s()).travel_low_mps == 0.0
    hold(clock, history, Velocity(1.0))
    assert history.commands_in(0.2, stalled_s).travel_low_mps == 1.0
    assert history.commands_in(0.2, clock.now_s()).travel_low_mps == 1.0


def test_a_publisher_that_starts_again_is_followed() -> None:
    drive = Drive()
    drive.go(2.0)
    drive.offset_s = -100.0
    drive.go(0.5)
    history = drive.history
    assert drive.clock.now_s() - history.odometry_time_s == pytest.approx(0.0, abs=0.025)
    moved = history.odometry_in(1.0, history.odometry_time_s)
    assert moved is not None
    assert moved.twist_travel_m == pytest.approx(1.0)


def test_nothing_is_looked_at_that_was_before_it_was_accepted() -> None:
    drive = Drive()
    drive.go(2.0)
    drive.history.reset_reference()
    drive.go(0.4)
    time_s = drive.history.odometry_time_s
    assert drive.history.odometry_in(1.0, time_s) is None
    assert drive.history.odometry_in(0.3, time_s) is not None


def hold(
    clock: ManualClock, history: MotionHistory, velocity: Velocity, at_least: Velocity | None = None
) -> None:
    """Command a velocity for a second, in each tick."""
    for _ in range(10):
        history.command(velocity, at_least)
        clock.advance(0.1)


def test_a_velocity_that_is_being_gained_is_any_up_to_it_and_no_way() -> None:
    clock = ManualClock()
    history = MotionHistory(clock, SETTINGS)
    hold(clock, history, Velocity(-0.5), STANDING)
    hold(clock, history, Velocity(-0.5))
    history.command(STANDING)
    found = history.commands_in(1.5, clock.now_s())
    assert (found.travel_low_mps, found.travel_high_mps) == (-0.5, 0.0)
    found = history.commands_in(0.5, clock.now_s())
    assert (found.travel_low_mps, found.travel_high_mps) == (-0.5, -0.5)
    way = history.commanded_in(2.0, clock.now_s())
    assert way is not None
    assert way.twist_travel_m == pytest.approx(-0.5)


def test_commands_of_a_window_are_those_in_force_within_it() -> None:
    clock = ManualClock()
    history = MotionHistory(clock, SETTINGS)
    for velocity in (STANDING, Velocity(1.0), Velocity(0.5, 0.2), STANDING):
        hold(clock, history, velocity)
    found = history.commands_in(1.5, clock.now_s())
    assert (found.travel_low_mps, found.travel_high_mps) == (0.0, 0.5)
    assert found.rotate_high_radps == 0.2
    way = history.commanded_in(2.0, clock.now_s() - 1.0)
    assert way is not None
    assert hypot(way.twist_travel_m, way.twist_turn_rad) == pytest.approx(hypot(1.5, 0.2))


def test_which_way_was_commanded_is_not_known_over_a_stall() -> None:
    clock = ManualClock()
    history = MotionHistory(clock, SETTINGS)
    hold(clock, history, Velocity(1.0))
    clock.advance(0.3)
    hold(clock, history, Velocity(1.0))
    history.command(Velocity(1.0))
    assert history.commanded_in(1.2, clock.now_s()) is None
    way = history.commanded_in(0.8, clock.now_s())
    assert way is not None
    assert way.twist_travel_m == pytest.approx(0.8)
