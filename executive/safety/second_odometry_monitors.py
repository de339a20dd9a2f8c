"""Fault monitors by an odometry independent of the wheels: slip, slides, a silent sensor.

The two odometries have frames of their own. So their steps between two samples are compared, each
in the axes of base_link at the first one. If the second odometry corrects the pose, only a gross
disagreement is a fault.
"""

from math import inf
from typing import Final

from executive.faults import Window
from executive.safety.evidence import Evidence, silent_sensor, speed_evidence, turn_evidence
from executive.safety.motion_history import MotionHistory
from executive.safety.sensor_history import OdometryDisagreement

FUSED: Final = frozenset({"quick_fused", "slow_fused"})
"""Windows of the distance if the second odometry corrects the pose."""
SLIDE_M_PER_RAD: Final = 0.08
"""Displacement by a turn on the spot that odometry may miss, per radian."""
STATIONARY_M: Final = 0.02
STATIONARY_RAD: Final = 0.03
"""Maximum motion of odometry at standstill."""
STOPPED_S: Final = 0.3
"""Time from a command of zero velocity until odometry shows standstill."""
MAX_SAMPLE_AGE_S: Final = 1.5
"""Maximum age of a sample."""


def travel_slip(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a distance by second odometry that disagrees, in the windows for its kind."""
    second = history.second
    if second is None or second.settings.fused is not (window.name in FUSED):
        return None
    found = _window_disagreement(history, window, now_s)
    if found is None:
        return None
    bound_m = window.allowed(found.driven_m) + SLIDE_M_PER_RAD * found.turned_rad
    if found.off_m <= bound_m:
        return None
    span_s = found.span_s
    distances_m = {
        "odometry": found.believed_m,
        "second odometry": found.seen_m,
        "apart": found.off_m,
    }
    turned = history.wheels_in(span_s, found.to_s)
    if turned is not None:
        distances_m = {"wheels": abs(turned.distance_m), **distances_m}
    return speed_evidence("the rover slips", history, span_s, found.to_s, distances_m, bound_m)


def turn_slip(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect a turn by second odometry that disagrees."""
    found = _window_disagreement(history, window, now_s)
    if found is None:
        return None
    bound_rad = window.allowed(found.turned_rad)
    if found.off_rad <= bound_rad:
        return None
    what = "the odometries disagree on the turn"
    turns = {"odometry": found.believed_rad, "second odometry": found.seen_rad}
    return turn_evidence(what, history, found.span_s, found.to_s, turns, bound_rad)


def slide_at_rest(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect motion at commanded standstill that odometry does not show."""
    found = _window_disagreement(history, window, now_s)
    if found is None or found.from_s < history.standing_since_s + STOPPED_S:
        return None
    is_standing = found.driven_m <= STATIONARY_M and found.turned_rad <= STATIONARY_RAD
    if not is_standing or found.off_m <= window.bound:
        return None
    distances_m = {"odometry": found.believed_m, "second odometry": found.seen_m}
    what, span_s = "the rover slides at standstill", found.span_s
    return speed_evidence(what, history, span_s, found.to_s, distances_m, window.bound)


def second_odometry_silent(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """Detect that the second odometry no longer reports."""
    if history.second is None:
        return None
    sightings = history.second.samples
    last_s = sightings[-1].time_s if sightings else -inf
    return silent_sensor(history, "second odometry", "slip is", last_s, window, now_s)


def _window_disagreement(
    history: MotionHistory, window: Window, now_s: float
) -> OdometryDisagreement | None:
    """Return the disagreement over a window, if it is recent."""
    second = history.second
    if second is None or now_s - second.at_s > MAX_SAMPLE_AGE_S:
        return None
    return second.disagreement(window.length_s, history.begun_s)
