"""Fault monitors of the driven wheels: their encoders, and the torques of their motors.

The wheels are compared with commands and odometry, over windows that end with the older of the two.
Errors that encoders and odometry share, such as a wrong wheel radius, are not detected here.
"""

from typing import Final

from executive.faults import Window
from executive.safety.evidence import Evidence, disagreement_evidence, silent_sensor, speed_evidence
from executive.safety.motion_history import CommandedRange, MotionHistory
from executive.safety.odometry_monitors import COMMAND_LATENCY_S
from executive.safety.sensor_history import WheelHistory
from executive.values.reasons import Figure

SPEED_OVER_S: Final = 0.04
"""Averaging time of the present wheel speed."""
MIN_UNPOWERED_ERROR_MPS: Final = 0.06
"""Minimum error of wheels without torque from their command, for a fault."""


def wheels_off_command(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a side that is slower or faster than all its commands in the window."""
    wheels = history.wheels
    if wheels is None or not wheels.fresh(now_s):
        return None
    to_s = wheels.sums.time_s
    turned = history.wheels_in(SPEED_OVER_S, to_s)
    if turned is None:
        return None
    wanted = _commands(history, wheels, window.length_s)
    half_m = wheels.settings.track_m / 2
    low_mps, high_mps = wanted.rotate_low_radps * half_m, wanted.rotate_high_radps * half_m
    sides = (
        ("left", turned.left_m, -high_mps, -low_mps),
        ("right", turned.right_m, low_mps, high_mps),
    )
    for side, distance_m, across_low_mps, across_high_mps in sides:
        speed_mps = distance_m / SPEED_OVER_S
        least_mps = wanted.travel_low_mps + across_low_mps
        max_mps = wanted.travel_high_mps + across_high_mps
        nearest_mps = min(max(speed_mps, least_mps), max_mps)
        bound_mps = window.allowed(max(abs(least_mps), abs(max_mps)))
        if abs(speed_mps - nearest_mps) > bound_mps:
            figures = Figure("commanded", nearest_mps, "m/s"), Figure("wheels", speed_mps, "m/s")
            what = f"the {side} wheels do not follow"
            return disagreement_evidence(what, figures, bound_mps, window.length_s)
    return None


def wheel_travel_off_command(
    history: MotionHistory, window: Window, now_s: float
) -> Evidence | None:
    """Detect a side with a shorter or longer distance than commanded."""
    wheels = history.wheels
    if wheels is None or not wheels.fresh(now_s):
        return None
    window_s, to_s = window.length_s, wheels.sums.time_s
    turned = history.wheels_in(window_s, to_s)
    wanted = history.commanded_in(window_s, to_s - COMMAND_LATENCY_S)
    if turned is None or wanted is None:
        return None
    across_m = wanted.twist_turn_rad * wheels.settings.track_m / 2
    delayed_m = _delayed_m(history, wheels, window_s)
    sides = (
        ("left", turned.left_m, wanted.twist_travel_m - across_m),
        ("right", turned.right_m, wanted.twist_travel_m + across_m),
    )
    for side, distance_m, wanted_m in sides:
        bound_m = window.allowed(wanted_m) + wheels.gaps.missed_m(to_s - window_s) + delayed_m
        if abs(distance_m - wanted_m) > bound_m:
            figures = (
                Figure("commanded", wanted_m / window_s, "m/s"),
                Figure("wheels", distance_m / window_s, "m/s"),
            )
            what = f"the {side} wheels do not follow"
            return disagreement_evidence(what, figures, bound_m / window_s, window_s)
    return None


def _commands(history: MotionHistory, wheels: WheelHistory, window_s: float) -> CommandedRange:
    """Return the range of the commands that the wheels may follow.

    A base without processor time follows old commands, then new ones at old times.
    """
    to_s = wheels.sums.time_s
    delay_s = wheels.delay_s(to_s - window_s)
    return history.commands_in(window_s + 2 * delay_s, to_s + delay_s)


def _delayed_m(history: MotionHistory, wheels: WheelHistory, window_s: float) -> float:
    """Return the distance that such a base may be ahead or behind."""
    delay_s = wheels.delay_s(wheels.sums.time_s - window_s)
    if not delay_s:
        return 0.0
    wanted = _commands(history, wheels, window_s)
    across_radps = wanted.rotate_high_radps - wanted.rotate_low_radps
    across_mps = across_radps * wheels.settings.track_m / 2
    return delay_s * (wanted.travel_high_mps - wanted.travel_low_mps + across_mps)


def wheels_unpowered(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a side that deviates from its command without motor torque."""
    wheels = history.wheels
    if wheels is None or not (wheels.fresh(now_s) and wheels.torques):
        return None
    window_s, to_s = window.length_s, wheels.sums.time_s
    turned, wanted = history.wheels_in(window_s, to_s), history.commanded_in(window_s, to_s)
    if turned is None or wanted is None:
        return None
    across_m = wanted.twist_turn_rad * wheels.settings.track_m / 2
    bound_mps = MIN_UNPOWERED_ERROR_MPS + _delayed_m(history, wheels, window_s) / window_s
    sides = (
        ("left", turned.left_m, turned.left_nms, wanted.twist_travel_m - across_m),
        ("right", turned.right_m, turned.right_nms, wanted.twist_travel_m + across_m),
    )
    for side, distance_m, torque_nms, wanted_m in sides:
        off_mps, torque_nm = (distance_m - wanted_m) / window_s, torque_nms / window_s
        if abs(torque_nm) < window.bound and abs(off_mps) > bound_mps:
            figures = (
                Figure("commanded", wanted_m / window_s, "m/s"),
                Figure("wheels", distance_m / window_s, "m/s"),
                Figure("torque", torque_nm, "Nm"),
            )
            return disagreement_evidence(
                f"the {side} motors give no torque", figures, window.bound, window_s
            )
    return None


def odometry_off_wheels(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a disagreement of the distance by odometry with the wheels."""
    wheels = history.wheels
    if wheels is None or not wheels.fresh(now_s):
        return None
    window_s, to_s = window.length_s, min(wheels.sums.time_s, history.moved.time_s)
    turned, moved = history.wheels_in(window_s, to_s), history.odometry_in(window_s, to_s)
    if turned is None or moved is None:
        return None
    bound_m = window.allowed(max(abs(turned.distance_m), moved.driven_m))
    bound_m += sum(each.gaps.missed_m(to_s - window_s) for each in (wheels, history))
    by_odometry_m = moved.twist_travel_m
    if history.twist.delay_s:  # between twist and pose, which are of different times
        low_m, high_m = sorted((moved.twist_travel_m, moved.pose_ahead_m))
        by_odometry_m = min(max(turned.distance_m, low_m), high_m)
    if abs(turned.distance_m - by_odometry_m) <= bound_m:
        return None
    by_source_m = {"wheels": turned.distance_m, "odometry": by_odometry_m}
    what = "odometry and wheels disagree"
    return speed_evidence(what, history, window_s, to_s, by_source_m, bound_m)


def joints_silent(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect that the wheel sensors no longer report."""
    if history.wheels is None:
        return None
    last_s = history.wheels.sums.time_s
    return silent_sensor(history, "wheel sensor", "the wheels are", last_s, window, now_s)
