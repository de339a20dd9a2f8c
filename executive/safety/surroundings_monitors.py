"""Monitors of what stands in the rover's way: zones and known rocks, and what the laser sees."""

from math import degrees, isfinite

from executive.faults import Window
from executive.safety.evidence import Evidence
from executive.safety.history import MotionHistory
from executive.safety.surroundings import SLOWEST_MPS
from executive.values.geometry import arc
from executive.values.reasons import Figure


def zone_ahead(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """See that the rover could not stand before a zone or a known rock if it went on."""
    del now_s
    around, velocity = history.surroundings, history.fastest
    if around is None or around.footprint is None or not around.settings.zones.any:
        return None
    if abs(velocity.travel_mps) < SLOWEST_MPS:
        return None
    path = arc(history.pose, velocity, around.braking_s(velocity, window.length_s))[0]
    met = around.settings.zones.encounter(path, around.footprint.radius_m, 0.0)
    if met is None:
        return None
    speed_mps = abs(velocity.travel_mps)
    braking_m = speed_mps * around.braking_s(velocity, window.length_s)
    return Evidence(
        f"{met.obstacle.title} is {met.way_m:.2f} m on, and from {speed_mps:.2f} m/s the rover"
        f" stands after {braking_m:.2f} m",
        (
            Figure("distance", met.way_m, "m"),
            Figure("speed", speed_mps, "m/s"),
            Figure("bound", braking_m, "m"),
        ),
    )


def obstacle_ahead(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """See that the rover could not stand before what the laser sees if it went on."""
    del now_s
    around, velocity = history.surroundings, history.fastest
    if around is None or not around.laser:
        return None
    held_s = around.braking_s(velocity, window.length_s)
    met = around.met(velocity, held_s, window.bound)
    if met is None:
        return None
    speed_mps, rate_radps = abs(velocity.travel_mps), abs(velocity.rotate_radps)
    if speed_mps < SLOWEST_MPS:
        return Evidence(
            f"something stands {met.gap_m:.2f} m from the rover, where it turns to at"
            f" {rate_radps:.2f} rad/s",
            (
                Figure("distance", met.gap_m, "m"),
                Figure("rate", rate_radps, "rad/s"),
                Figure("bound", window.bound, "m"),
            ),
        )
    needed_m = speed_mps * held_s + window.bound
    return Evidence(
        f"something stands {met.gap_m:.2f} m {_side(velocity.travel_mps)}, and from"
        f" {speed_mps:.2f} m/s {needed_m:.2f} m must be free",
        (
            Figure("distance", met.gap_m, "m"),
            Figure("speed", speed_mps, "m/s"),
            Figure("bound", needed_m, "m"),
        ),
    )


def obstacle_near(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """See that something stands near in the direction in which the rover drives."""
    del now_s
    around, velocity = history.surroundings, history.fastest
    if around is None or not around.laser:
        return None
    found = around.near(velocity, window.bound)
    if found is None:
        return None
    figures = Figure("distance", found.gap_m, "m"), Figure("bound", window.bound, "m")
    side = _side(velocity.travel_mps)
    return Evidence(f"something stands {found.gap_m:.2f} m {side}: slower", figures)


def laser_silent(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """See that no new scan comes."""
    around = history.surroundings
    if around is None or not around.laser or now_s - around.scanned_s <= window.bound:
        return None
    age_s, bound = now_s - around.scanned_s, Figure("bound", window.bound, "s")
    if not isfinite(age_s):
        return Evidence("no scan of the laser yet: the rover does not see what is ahead", (bound,))
    figures = Figure("age", age_s, "s"), bound
    text = f"no scan of the laser for {age_s:.2f} s: the rover does not see what is ahead"
    return Evidence(text, figures)


def laser_blind(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """See a sector into which the rover drives or turns, and in which the laser measures nothing.

    A scan of which nothing is usable is the widest case; a rover that stands is not judged.
    """
    around, velocity = history.surroundings, history.fastest
    if around is None or not around.laser:
        return None
    found = around.blind(velocity, window.bound, now_s - window.length_s)
    if found is None:
        return None
    figures = Figure("share", found.share), Figure("bound", window.bound)
    return Evidence(
        f"the laser is blind towards {degrees(found.bearing_rad):+.0f}°: {found.share:.0%} of its"
        f" rays there measure nothing usable, {window.bound:.0%} are allowed",
        (*figures, Figure("bearing", found.bearing_rad, "rad")),
    )


def _side(travel_mps: float) -> str:
    return "ahead" if travel_mps > 0 else "behind"
