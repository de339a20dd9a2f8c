"""Fault monitors by the IMU: false turns and speeds of other sensors, blocked wheels, tilt.

A gyro shared with the odometry is checked only by the wheels and by a second odometry.
"""

from math import copysign
from typing import Final

from executive.faults import Window
from executive.safety.evidence import Evidence, disagreement_evidence, silent_sensor, turn_evidence
from executive.safety.gyro_heading import BY_GYRO
from executive.safety.motion_history import MotionHistory
from executive.values.quantities import angle_text
from executive.values.reasons import Figure

SPEED_OVER_S: Final = 0.06
"""Averaging time of the wheel speeds at both ends of a window."""
SLIDES_S: Final = 0.2
"""Disagreement of wheels and accelerometer beyond that of a gap: gaps that repeat hide no slip."""
ROLLING_NM_PER_RADPS: Final = 0.02
"""Rolling resistance of a wheel: torque per wheel rate."""

UNLEVELLED: Final = 0.1
"""Share of a turn that a gyro misses if its tilt is unknown: 1 - cos 25 deg."""


def odometry_off_gyro(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a disagreement of odometry, by twist or heading, with the turn by the gyro.

    If the heading is that of the gyro, the windows are others, and the odometry's own turn may be
    up to `turn_scale` times the gyro's.
    """
    inertia = history.inertia
    if inertia is None or not inertia.fresh(now_s):
        return None
    if (history.by_gyro is not None) is not (window.name in BY_GYRO):
        return None
    window_s, to_s = window.length_s, min(inertia.sums.time_s, history.moved.time_s)
    felt, moved = history.inertia_in(window_s, to_s), history.odometry_in(window_s, to_s)
    if felt is None or moved is None:
        return None
    turns_rad = (
        (moved.pose_rad,) if history.twist.delay_s else (moved.twist_turn_rad, moved.pose_rad)
    )
    reported_rad = max(turns_rad, key=lambda turn: abs(turn - felt.turn_rad))
    other_rad = 0.0 if history.by_gyro is not None else moved.turned_rad
    bound_rad = window.allowed(max(abs(felt.turn_rad), other_rad))
    bound_rad += inertia.bias_error_radps * window_s
    bound_rad += sum(each.gaps.missed_rad(to_s - window_s) for each in (inertia, history))
    if not inertia.leans:
        bound_rad += UNLEVELLED * abs(felt.turn_rad)
    low_rad, high_rad = sorted((felt.turn_rad, history.turn_scale * felt.turn_rad))
    if low_rad - bound_rad <= reported_rad <= high_rad + bound_rad:
        return None
    turns = {"gyro": felt.turn_rad, "odometry": reported_rad}
    return turn_evidence("odometry and gyro disagree", history, window_s, to_s, turns, bound_rad)


def wheels_off_gyro(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a disagreement of the turn by the wheels with the gyro."""
    wheels, inertia = history.wheels, history.inertia
    if wheels is None or inertia is None or not (wheels.fresh(now_s) and inertia.fresh(now_s)):
        return None
    window_s, to_s = window.length_s, min(wheels.sums.time_s, inertia.sums.time_s)
    turned, felt = history.wheels_in(window_s, to_s), history.inertia_in(window_s, to_s)
    if turned is None or felt is None:
        return None
    wheels_rad = (turned.right_m - turned.left_m) / wheels.settings.track_m
    bound_rad = window.allowed(max(abs(wheels_rad), abs(felt.turn_rad)))
    bound_rad += inertia.gaps.missed_rad(to_s - window_s)
    bound_rad += 2 * wheels.gaps.missed_m(to_s - window_s) / wheels.settings.track_m
    if abs(wheels_rad - felt.turn_rad) <= bound_rad:
        return None
    what = "the rover does not turn as its wheels do"
    turns = {"wheels": wheels_rad, "gyro": felt.turn_rad}
    return turn_evidence(what, history, window_s, to_s, turns, bound_rad)


def wheel_slip(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a speed change of the wheels that the IMU does not measure; requires its tilt.

    A change of speed during a gap is unknown.
    """
    wheels, inertia = history.wheels, history.inertia
    if wheels is None or inertia is None or not (inertia.leans and inertia.feels):
        return None
    if not (wheels.fresh(now_s) and inertia.fresh(now_s)):
        return None
    window_s, to_s = window.length_s, min(wheels.sums.time_s, inertia.sums.time_s)
    last = history.wheels_in(SPEED_OVER_S, to_s)
    first = history.wheels_in(SPEED_OVER_S, to_s - window_s)
    felt = history.inertia_in(window_s, to_s - SPEED_OVER_S / 2)
    if first is None or last is None or felt is None:
        return None
    over_ground = history.over_ground
    slides = over_ground is not None and over_ground.apart_s > SLIDES_S
    if inertia.gaps.missed_m(to_s - window_s) and not slides:
        return None
    gained_mps = (last.distance_m - first.distance_m) / SPEED_OVER_S
    if abs(gained_mps - felt.gained_mps) <= window.bound:
        return None
    figures = (
        Figure("speed gained by the wheels", gained_mps, "m/s"),
        Figure("felt", felt.gained_mps, "m/s"),
    )
    return disagreement_evidence("the wheels slip", figures, window.bound, window_s)


def motion_blocked(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a motor force without the acceleration of the rover that it should cause.

    An unknown load and the inertia of the motors add to the force in the direction of the measured
    one. The ratio of the window allows for that.
    """
    wheels, inertia, mass_kg = history.wheels, history.inertia, history.mass_kg
    if wheels is None or inertia is None or mass_kg is None or not inertia.feels:
        return None
    if not (wheels.torques and wheels.fresh(now_s) and inertia.fresh(now_s)):
        return None
    window_s, to_s = window.length_s, min(wheels.sums.time_s, inertia.sums.time_s)
    turned, felt = history.wheels_in(window_s, to_s), history.inertia_in(window_s, to_s)
    if turned is None or felt is None:
        return None
    radius_m = wheels.settings.wheel_radius_m
    rolling_nms = ROLLING_NM_PER_RADPS * wheels.count * turned.distance_m / radius_m
    pushed_n = (turned.left_nms + turned.right_nms - rolling_nms) / radius_m / window_s
    felt_n = mass_kg * felt.force_mps / window_s
    bound_n = window.allowed(max(0.0, copysign(felt_n, felt_n * pushed_n)))
    if abs(pushed_n - felt_n) <= bound_n:
        return None
    figures = Figure("force of the wheels", pushed_n, "N"), Figure("felt", felt_n, "N")
    return disagreement_evidence("the rover is blocked", figures, bound_n, window_s)


def tilt_limit_imu(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect an excessive tilt, by the inertial sensors."""
    inertia = history.inertia
    if inertia is None or inertia.newest is None or not inertia.fresh(now_s):
        return None
    tilt_rad = max(abs(inertia.newest.roll_rad), abs(inertia.newest.pitch_rad))
    if not tilt_rad > window.bound:  # also false if it is not measured
        return None
    figures = Figure("tilt", tilt_rad, "rad"), Figure("bound", window.bound, "rad")
    return Evidence(f"tilt {angle_text(tilt_rad)} exceeds {angle_text(window.bound)}", figures)


def imu_silent(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect that the inertial sensors no longer report."""
    inertia = history.inertia
    if inertia is None:
        return None
    return silent_sensor(history, "IMU", "slip is", inertia.sums.time_s, window, now_s)
