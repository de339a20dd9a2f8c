"""Fault monitors of the rover's path: zones, known rocks and laser points ahead; a silent laser."""

from math import degrees, isfinite

from executive.faults import Window
from executive.safety.evidence import Evidence
from executive.safety.motion_history import MotionHistory
from executive.safety.surroundings import STANDSTILL_MPS
from executive.values.geometry import arc
from executive.values.quantities import rate_text
from executive.values.reasons import Figure


def zone_ahead(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect that the rover can no longer stop before a zone or a known rock."""
    del now_s
    around, velocity = history.surroundings, history.fastest_velocity
    if around.footprint is None or not around.settings.zones.not_empty:
        return None
    if abs(velocity.travel_mps) < STANDSTILL_MPS:
        return None
    path = arc(history.pose, velocity, around.braking_s(velocity, window.length_s))[0]
    met = around.settings.zones.encounter(path, around.footprint.radius_m, 0.0)
    if met is None:
        return None
    speed_mps = abs(velocity.travel_mps)
    braking_m = speed_mps * around.braking_s(velocity, window.length_s)
    return Evidence(
        f"{met.obstacle.label} is {met.distance_m:.2f} m ahead; from {speed_mps:.2f} m/s the rover"
        f" stops within {braking_m:.2f} m",
        (
            Figure("distance", met.distance_m, "m"),
            Figure("speed", speed_mps, "m/s"),
            Figure("bound", braking_m, "m"),
        ),
    )


def obstacle_ahead(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect that the rover can no longer stop before a scanned obstacle."""
    del now_s
    around, velocity = history.surroundings, history.fastest_velocity
    if not around.laser:
        return None
    held_s = around.braking_s(velocity, window.length_s)
    met = around.predicted_contact(velocity, held_s, window.bound)
    if met is None:
        return None
    speed_mps, rate_radps = abs(velocity.travel_mps), abs(velocity.rotate_radps)
    if speed_mps < STANDSTILL_MPS:
        return Evidence(
            f"obstacle {met.gap_m:.2f} m from the rover turning at {rate_text(rate_radps)}",
            (
                Figure("distance", met.gap_m, "m"),
                Figure("rate", rate_radps, "rad/s"),
                Figure("bound", window.bound, "m"),
            ),
        )
    needed_m = speed_mps * held_s + window.bound
    return Evidence(
        f"obstacle {met.gap_m:.2f} m {_side(velocity.travel_mps)}; from"
        f" {speed_mps:.2f} m/s {needed_m:.2f} m must be free",
        (
            Figure("distance", met.gap_m, "m"),
            Figure("speed", speed_mps, "m/s"),
            Figure("bound", needed_m, "m"),
        ),
    )


def obstacle_near(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect an obstacle near the rover in its direction of travel."""
    del now_s
    around, velocity = history.surroundings, history.fastest_velocity
    if not around.laser:
        return None
    found = around.nearest_ahead(velocity, window.bound)
    if found is None:
        return None
    figures = Figure("distance", found.gap_m, "m"), Figure("bound", window.bound, "m")
    side = _side(velocity.travel_mps)
    return Evidence(f"obstacle {found.gap_m:.2f} m {side}: reduced speed", figures)


def laser_silent(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect that no new scan is received."""
    around = history.surroundings
    if not around.laser or now_s - around.scanned_s <= window.bound:
        return None
    age_s, bound = now_s - around.scanned_s, Figure("bound", window.bound, "s")
    if not isfinite(age_s):
        return Evidence("no laser scan yet: obstacles are not detected", (bound,))
    figures = Figure("age", age_s, "s"), bound
    text = f"no laser scan for {age_s:.2f} s: obstacles are not detected"
    return Evidence(text, figures)


def laser_blind(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a sector in the direction of motion without usable laser rays.

    A scan without any usable ray is the widest case. A stationary rover is not judged.
    """
    around, velocity = history.surroundings, history.fastest_velocity
    if not around.laser:
        return None
    found = around.blind(velocity, window.bound, now_s - window.length_s)
    if found is None:
        return None
    figures = Figure("share", found.share), Figure("bound", window.bound)
    return Evidence(
        f"laser blind towards {degrees(found.bearing_rad):+.0f}°: {found.share:.0%} of its"
        f" rays there are unusable, {window.bound:.0%} allowed",
        (*figures, Figure("bearing", found.bearing_rad, "rad")),
    )


def _side(travel_mps: float) -> str:
    return "ahead" if travel_mps > 0 else "behind"
