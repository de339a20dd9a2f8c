"""Fault monitors of the whole rover: tilt, battery, emergency stop (e-stop), other publishers."""

from math import isfinite

from executive.faults import Window
from executive.safety.evidence import Evidence
from executive.safety.motion_history import MotionHistory
from executive.values.facts import Source
from executive.values.quantities import angle_text, rate_text
from executive.values.reasons import Figure


def tilt_limit(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect an excessive tilt, by odometry."""
    if history.odometry is None:
        return None
    pose = history.odometry.pose
    tilt_rad = max(abs(pose.roll_rad), abs(pose.pitch_rad))
    if tilt_rad <= window.bound:
        return None
    figures = Figure("tilt", tilt_rad, "rad"), Figure("bound", window.bound, "rad")
    return Evidence(f"tilt {angle_text(tilt_rad)} exceeds {angle_text(window.bound)}", figures)


def emergency_stop(history: MotionHistory, _: Window, __: float) -> Evidence | None:
    """Detect that the robot's own emergency stop is active."""
    return Evidence("emergency stop of the robot is active") if history.emergency_stop else None


def battery_low(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect a battery that is nearly empty."""
    if history.battery is None or history.battery.voltage_v >= window.bound:
        return None
    voltage_v = history.battery.voltage_v
    figures = Figure("voltage", voltage_v, "V"), Figure("bound", window.bound, "V")
    return Evidence(f"battery voltage {voltage_v:.1f} V is below {window.bound:.1f} V", figures)


def other_publisher(history: MotionHistory, _: Window, __: float) -> Evidence | None:
    """Detect that another publisher drives the base."""
    drivers = ", ".join(str(each) for each in history.mux_inputs if each.overrides)
    return Evidence(f"{drivers} drives the rover") if drivers else None


def navigation_uncommanded_motion(
    history: MotionHistory, window: Window, _: float
) -> Evidence | None:
    """Detect that the navigation commands a velocity without a goal of the executive."""
    track = history.navigation
    if track is None or track.uncommanded_s <= window.bound:
        return None
    travel_mps, rotate_radps = track.velocity.travel_mps, track.velocity.rotate_radps
    text = (
        f"the navigation commands {travel_mps:+.2f} m/s, {rate_text(rotate_radps, '+.1f')},"
        " without a goal of the executive; its gate is shut"
    )
    figures = (
        Figure("speed", travel_mps, "m/s"),
        Figure("rate", rotate_radps, "rad/s"),
        Figure("without goal", track.uncommanded_s, "s"),
        Figure("bound", window.bound, "s"),
    )
    return Evidence(text, figures)


def battery_silent(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect that the battery no longer reports its voltage."""
    age_s = now_s - history.battery_at_s
    if history.battery is None or age_s <= window.bound:
        return None
    figures = Figure("age", age_s, "s"), Figure("bound", window.bound, "s")
    return Evidence(f"no battery voltage for {age_s:.0f} s (limit {window.bound:g} s)", figures)


def battery_not_finite(history: MotionHistory, window: Window, _: float) -> Evidence | None:
    """Detect a voltage that is not a number, or higher than this battery can have."""
    if (voltage_v := history.invalid_v) is None:
        return None
    if not isfinite(voltage_v):
        return Evidence("battery voltage is not a number")
    text = f"battery voltage {voltage_v:g} V exceeds {window.bound:g} V: it is not measured"
    return Evidence(text, (Figure("voltage", voltage_v, "V"), Figure("bound", window.bound, "V")))


def rejected(history: MotionHistory, _: Window, __: float, *, source: Source) -> Evidence | None:
    """Detect data of a source that are rejected, or not received."""
    found = history.rejections.of(source)
    if found is None:
        return None
    return Evidence(str(found), (Figure("rate", found.rate_hz or 0.0, "Hz"),))
