"""Fault monitors of the odometry: jumps, age, rate, and disagreement with its twist or commands.

Windows end with the newest odometry, at its stamp, so that latency is no evidence. It is compared
with all velocities in force in the window, since a base needs time to respond.
"""

from collections.abc import Callable
from math import isfinite
from typing import Final, TypeGuard

from executive.faults import Window
from executive.safety.evidence import Evidence, speed_evidence, turn_evidence
from executive.safety.motion_history import MotionHistory, OdometryWindow, PoseJump
from executive.safety.rest_track import FIRST_RATIO
from executive.values.quantities import angle_text, quantity_text
from executive.values.reasons import Figure

EVIDENCE_HOLD_S: Final = 0.1
"""Duration of the evidence of a single message."""
COMMAND_LATENCY_S: Final = 0.06
"""Latency of a base from a command to its motion."""
ODOMETRY_WAIT_S: Final = 2.0
"""Additional age of odometry that is allowed before a motion starts, as that waits for it."""
SIDE_SLIP_M: Final = 0.15
"""Maximum side slip of base_link per radian turned, not in the twist. Chosen, not measured."""
SETTLE_S: Final = 1.4
"""Maximum stopping time of a base after a command of zero velocity."""
COMPARED_RATIO: Final = 1.0 - FIRST_RATIO
"""Minimum part of a window over which a pose at rest is compared; a shorter path is no motion."""
MIN_MPS, MIN_RADPS = 0.05, 0.1
"""Minimum command that any base follows."""


def odometry_jumped(history: MotionHistory, _: Window, now_s: float) -> Evidence | None:
    """Detect a step of the pose that exceeds the speed."""
    jump = history.jump
    return _jump_evidence(jump) if _recent(jump, now_s) and jump.step_m > jump.bound_m else None


def odometry_heading_jumped(history: MotionHistory, _: Window, now_s: float) -> Evidence | None:
    """Detect a turn in one step of the pose that exceeds the yaw rate."""
    jump = history.jump
    return _jump_evidence(jump) if _recent(jump, now_s) and jump.step_m <= jump.bound_m else None


def _recent(jump: PoseJump | None, now_s: float) -> TypeGuard[PoseJump]:
    return jump is not None and now_s - jump.at_s <= EVIDENCE_HOLD_S


def _jump_evidence(jump: PoseJump) -> Evidence:
    return Evidence(
        f"odometry jumped by {jump.step_m:.2f} m and {angle_text(jump.turn_rad)}",
        (
            Figure("jump", jump.step_m, "m"),
            Figure("bound", jump.bound_m, "m"),
            Figure("turn", jump.turn_rad, "rad"),
            Figure("turn bound", jump.bound_rad, "rad"),
        ),
    )


def odometry_not_finite(history: MotionHistory, _: Window, now_s: float) -> Evidence | None:
    """Detect odometry with figures that are not finite."""
    if now_s - history.not_finite_at_s > EVIDENCE_HOLD_S:
        return None
    return Evidence("odometry has values that are not finite")


def odometry_stale(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect that the newest odometry is too old to move."""
    age_s = now_s - min(history.odometry_time_s, history.odometry_at_s)
    return _stale_evidence("odometry is", age_s, history, history.period.stale_s(window.bound))


def odometry_lags_sensors(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect that the newest odometry is older than the data of all other fast sensors.

    A delay of all of them, as on a busy computer, does not count.
    """
    others = [each.sums.time_s for each in (history.wheels, history.inertia) if each is not None]
    if history.odometry is None or not others:
        return None
    behind_s = min(others) - history.odometry_time_s
    bound_s = history.period.lag_s(window.bound)
    return _stale_evidence("relative to other sensors odometry is", behind_s, history, bound_s)


def odometry_late(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect odometry that arrives too late for control."""
    age_s = history.odometry_late_s
    if age_s <= window.bound or now_s - history.odometry_at_s > window.bound:
        return None
    return _age_evidence("odometry arrives late: it is", age_s, window.bound)


def odometry_silent(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect that odometry is no longer received."""
    if history.odometry is None:
        return None
    age_s = now_s - history.odometry_at_s
    if age_s <= window.bound:
        return None
    return _age_evidence("the newest odometry is", age_s, window.bound)


def _stale_evidence(
    what: str, age_s: float, history: MotionHistory, bound_s: float
) -> Evidence | None:
    """Return evidence of odometry that is too old to move, or to wait for any longer."""
    bound_s += ODOMETRY_WAIT_S if history.start_pending else 0.0
    return _age_evidence(what, age_s, bound_s) if age_s > bound_s else None


def _age_evidence(what: str, age_s: float, bound_s: float) -> Evidence:
    figures = Figure("age", age_s, "s"), Figure("bound", bound_s, "s")
    return Evidence(f"{what} {age_s:.2f} s old", figures)


def odometry_rate_low(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect an odometry rate that is too low for control."""
    arrivals = history.window(history.arrivals, window.length_s, history.arrivals.time_s)
    bound_hz = history.period.low_rate_hz(window.bound)
    if arrivals is None or arrivals[0] / window.length_s >= bound_hz:
        return None
    rate_hz = arrivals[0] / window.length_s
    figures = Figure("rate", rate_hz, "Hz"), Figure("bound", bound_hz, "Hz")
    return Evidence(f"odometry arrives {rate_hz:.1f} times a second", figures)


def odometry_frozen(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect odometry that does not change although motion is commanded."""
    unchanged_s = now_s - history.unchanged_since_s
    window_s = history.period.frozen_s(window.length_s)
    wanted = history.commands_in(window_s, now_s)
    moves = not wanted.travel_low_mps < MIN_MPS or not wanted.travel_high_mps > -MIN_MPS
    turns = not wanted.rotate_low_radps < MIN_RADPS or not wanted.rotate_high_radps > -MIN_RADPS
    old = now_s - history.odometry_time_s > window_s / 2
    if unchanged_s < window_s or old or not (moves or turns):
        return None
    since = f"is unchanged for {unchanged_s:.2f} s" if isfinite(unchanged_s) else "never changed"
    return Evidence(
        f"odometry {since}",
        (Figure("unchanged", unchanged_s, "s"), Figure("bound", window_s, "s")),
    )


def odometry_off_twist(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect a pose that disagrees with the integral of its twist."""
    moved = _moved(history, window)
    if moved is None:
        return None
    from_s = history.odometry_time_s - window.length_s
    bound_m = window.allowed(moved.driven_m) + history.gaps.missed_m(from_s)
    aside_m = max(0.0, abs(moved.pose_minus_twist_left_m) - SIDE_SLIP_M * moved.turned_rad)
    ahead_m = abs(moved.pose_minus_twist_ahead_m)
    if ahead_m > bound_m and history.twist.delay_s:
        ahead_m = _beyond_delay(
            history, window, lambda each: each.twist_level_m, lambda each: each.pose_ahead_m
        )
    off_m = max(ahead_m, aside_m)
    if off_m <= bound_m:
        return None
    return Evidence(
        f"odometry pose and twist disagree by {off_m:.2f} m",
        (
            Figure("by velocity", moved.twist_travel_m, "m"),
            Figure("apart", off_m, "m"),
            Figure("bound", bound_m, "m"),
        ),
    )


def odometry_heading_off_twist(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect a heading that disagrees with the integral of its yaw rate."""
    moved = _moved(history, window)
    if moved is None:
        return None
    from_s = history.odometry_time_s - window.length_s
    bound_rad = window.allowed(moved.turned_rad) + history.gaps.missed_rad(from_s)
    off_rad = abs(moved.pose_minus_twist_heading_rad)
    if off_rad > bound_rad and history.twist.delay_s:
        off_rad = _beyond_delay(
            history, window, lambda each: each.twist_turn_rad, lambda each: each.pose_rad
        )
    if off_rad <= bound_rad:
        return None
    return Evidence(
        f"odometry heading and yaw rate disagree by {angle_text(off_rad)}",
        (
            Figure("by rate", moved.twist_turn_rad, "rad"),
            Figure("by heading", moved.pose_rad, "rad"),
            Figure("bound", bound_rad, "rad"),
        ),
    )


def _beyond_delay(
    history: MotionHistory,
    window: Window,
    twist: Callable[[OdometryWindow], float],
    pose: Callable[[OdometryWindow], float],
) -> float:
    """Return the excess of the integrated twist over the range that a delay explains.

    Over the window and the delay a mean of earlier motion cannot leave the range of the motion of
    the pose, in the same span shifted back by up to the delay.
    """
    to_s, delay_s, moved = history.odometry_time_s, history.twist.delay_s, history.moved
    from_s = max(to_s - window.length_s - delay_s, history.begun_s, moved.first_s + delay_s)
    spans = [moved.increase_between(from_s - s, to_s - s) for s in history.twist.shifts_s]
    motions = [OdometryWindow(*each) for each in spans if each is not None]
    if from_s >= to_s or not motions:
        return 0.0
    by_pose, by_twist = [pose(each) for each in motions], twist(motions[0])
    return max(0.0, min(by_pose) - by_twist, by_twist - max(by_pose))


def _moved(history: MotionHistory, window: Window) -> OdometryWindow | None:
    sums = history.recent(history.moved, window.length_s, history.odometry_time_s)
    return None if sums is None else OdometryWindow(*sums)


def off_command(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a speed outside of the range of recent commands."""
    if history.odometry is None or now_s - history.odometry_time_s > SETTLE_S:
        return None
    window_s = history.period.response_s(window.length_s) + history.twist.delay_s
    wanted = history.commands_in(window_s, history.odometry_time_s)
    speed_mps = history.odometry.velocity.travel_mps
    return _range_evidence(
        window, window_s, wanted.travel_low_mps, wanted.travel_high_mps, speed_mps, "go", "m/s"
    )


def turn_off_command(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a yaw rate outside of the range of recent commands."""
    if history.odometry is None or now_s - history.odometry_time_s > SETTLE_S:
        return None
    window_s = history.period.response_s(window.length_s) + history.twist.delay_s
    wanted = history.commands_in(window_s, history.odometry_time_s)
    low_radps, high_radps = wanted.rotate_low_radps, wanted.rotate_high_radps
    rate_radps = history.odometry.velocity.rotate_radps
    return _range_evidence(window, window_s, low_radps, high_radps, rate_radps, "turn", "rad/s")


def _range_evidence(
    window: Window,
    window_s: float,
    low: float,
    high: float,
    measured: float,
    verb: str,
    unit: str,
) -> Evidence | None:
    """Return evidence of a measurement outside of the commanded range, or None."""
    bound = max(window.bound, (window.ratio or 0.0) * max(abs(low), abs(high)))
    nearest = min(max(measured, low), high)
    if abs(measured - nearest) <= bound:
        return None
    return Evidence(
        f"the rover does not {verb} as commanded: {quantity_text(measured, unit, '+.2f')}"
        f" instead of {quantity_text(nearest, unit, '+.2f')}",
        (
            Figure("commanded", nearest, unit),
            Figure("odometry", measured, unit),
            Figure("window", window_s, "s"),
            Figure("bound", bound, unit),
        ),
    )


def steady_off_command(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect a mean speed that differs from a constant command.

    Both the pose and the speeds must show it: a delayed pose lags, and speeds by wheel encoders are
    coarse.
    """
    to_s = history.odometry_time_s
    moved = history.odometry_in(window.length_s, to_s)
    wanted = history.commands_in(window.length_s, to_s)
    steady = wanted.travel_low_mps == wanted.travel_high_mps
    if moved is None or not steady or abs(wanted.travel_low_mps) < MIN_MPS:
        return None
    wanted_m = wanted.travel_low_mps * window.length_s
    distance_m = _nearest_bound(wanted_m, moved.pose_ahead_m, moved.twist_travel_m)
    bound_m = window.allowed(wanted_m)
    if abs(distance_m - wanted_m) <= bound_m:
        return None
    what = "the rover does not drive as fast as commanded"
    by_source_m = {"odometry": distance_m}
    return speed_evidence(what, history, window.length_s, to_s, by_source_m, bound_m)


def steady_turn_off_command(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect a mean yaw rate that differs from a constant command, likewise."""
    to_s = history.odometry_time_s
    moved = history.odometry_in(window.length_s, to_s)
    wanted = history.commands_in(window.length_s, to_s)
    steady = wanted.rotate_low_radps == wanted.rotate_high_radps
    if moved is None or not steady or abs(wanted.rotate_low_radps) < MIN_RADPS:
        return None
    wanted_rad = wanted.rotate_low_radps * window.length_s
    turn_rad = _nearest_bound(wanted_rad, moved.pose_rad, moved.twist_turn_rad)
    bound_rad = window.allowed(wanted_rad)
    if abs(turn_rad - wanted_rad) <= bound_rad:
        return None
    what, by_source = "the rover does not turn as fast as commanded", {"odometry": turn_rad}
    return turn_evidence(what, history, window.length_s, to_s, by_source, bound_rad)


def _nearest_bound(wanted: float, one: float, other: float) -> float:
    return min(one, other, key=lambda value: abs(value - wanted))


def turn_angle_off_command(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect a turn larger or smaller than commanded."""
    to_s = history.odometry_time_s
    moved = history.odometry_in(window.length_s, to_s)
    wanted = history.commanded_in(window.length_s, to_s - COMMAND_LATENCY_S)
    if moved is None or wanted is None:
        return None
    off_rad, bound_rad = (
        abs(moved.pose_rad - wanted.twist_turn_rad),
        window.allowed(wanted.turned_rad) + history.gaps.missed_rad(to_s - window.length_s),
    )
    if off_rad <= bound_rad:
        return None
    return Evidence(
        f"the rover turned by {angle_text(moved.pose_rad, '+.1f')} instead of"
        f" {angle_text(wanted.twist_turn_rad, '+.1f')}",
        (
            Figure("commanded", wanted.twist_turn_rad, "rad"),
            Figure("odometry", moved.pose_rad, "rad"),
            Figure("window", window.length_s, "s"),
            Figure("bound", bound_rad, "rad"),
        ),
    )


def uncommanded_travel(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect driving while zero velocity is commanded."""
    moved = _moved_at_rest(history, window)
    if moved is None or moved.pose_path_m <= COMPARED_RATIO * window.bound * window.length_s:
        return None
    speed_mps = history.poses.speed_mps(window.length_s, window.bound)
    return _uncommanded_evidence(history, window, speed_mps, "drives", "m/s")


def uncommanded_turn(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect turning while zero velocity is commanded."""
    moved = _moved_at_rest(history, window)
    if moved is None:
        return None
    rate_radps = history.poses.rate_radps(window.length_s, window.bound)
    return _uncommanded_evidence(history, window, rate_radps, "turns", "rad/s")


def _moved_at_rest(history: MotionHistory, window: Window) -> OdometryWindow | None:
    """Return the motion in a window of commanded standstill."""
    to_s = history.odometry_time_s
    rests = to_s - window.length_s >= history.standing_since_s + SETTLE_S
    return history.odometry_in(window.length_s, to_s) if rests else None


def _uncommanded_evidence(
    history: MotionHistory, window: Window, rate: float | None, verb: str, unit: str
) -> Evidence | None:
    """Return evidence of motion in a window of commanded standstill.

    A publisher that sends nothing explains no motion: sent velocities are `ForeignMuxInput` facts.
    """
    if rate is None:
        return None
    names = ", ".join((*map(str, history.mux_inputs), *history.foreign_publishers))
    by = f" (velocity publishers: {names})" if names else ""
    figures = Figure("odometry", rate, unit), Figure("bound", window.bound, unit)
    shown = quantity_text(rate, unit, ".2f")
    return Evidence(f"the rover {verb} at {shown} without a command{by}", figures)


def no_progress(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect that the commanded motion has no effect."""
    to_s = history.odometry_time_s
    moved = history.odometry_in(window.length_s, to_s)
    wanted = history.commanded_in(window.length_s, to_s - COMMAND_LATENCY_S)
    if moved is None or wanted is None:
        return None
    drives = wanted.driven_m >= MIN_MPS * window.length_s
    turns = wanted.turned_rad >= 2 * MIN_RADPS * window.length_s
    share = max(
        moved.pose_path_m / wanted.driven_m if drives else 0.0,
        moved.turned_rad / wanted.turned_rad if turns else 0.0,
    )
    if not (drives or turns) or share >= window.bound:
        return None
    return Evidence(
        f"no progress in {window.length_s:g} s: {moved.pose_path_m:.2f} m and"
        f" {angle_text(moved.turned_rad)}, commanded {wanted.driven_m:.2f} m and"
        f" {angle_text(wanted.turned_rad)}",
        (
            Figure("commanded", wanted.driven_m, "m"),
            Figure("odometry", moved.pose_path_m, "m"),
            Figure("turn commanded", wanted.turned_rad, "rad"),
            Figure("turn", moved.turned_rad, "rad"),
            Figure("window", window.length_s, "s"),
        ),
    )
