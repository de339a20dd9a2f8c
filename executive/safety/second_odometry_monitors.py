"""Monitors by an odometry that does not come from the wheels: slip, and all that others share.

The two odometries are in frames of their own, so their steps between two sightings are compared,
each in the axes of base_link at the first one. Where the second odometry corrects the pose, only
gross disagreement is a fault.
"""

from math import inf
from typing import Final

from executive.faults import Window
from executive.safety.comparison import compared, silent, speeds, turns
from executive.safety.evidence import Evidence
from executive.safety.history import MotionHistory
from executive.safety.sensor_history import OdometryDisagreement

FUSED: Final = frozenset({"quick_fused", "slow_fused"})
"""Windows of a way where the second odometry corrects the pose."""
SLIDE_M_PER_RAD: Final = 0.08
"""By how much a turn on the spot may move the rover that its odometry does not see."""
STILL_M: Final = 0.02
STILL_RAD: Final = 0.03
"""Of odometry that stands."""
STOPPED_S: Final = 0.3
"""From the command to stand until the rover does, where its odometry says so."""
FRESH_S: Final = 1.5
"""So long a message tells of now."""


def slips(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """See a second odometry that tells of another way, by the windows that are for its kind."""
    second = history.second
    if second is None or second.settings.fused is not (window.name in FUSED):
        return None
    found = _found(history, window, now_s)
    if found is None:
        return None
    bound_m = window.allowed(found.driven_m) + SLIDE_M_PER_RAD * found.turned_rad
    if found.off_m <= bound_m:
        return None
    span_s = found.span_s
    ways_m = {"odometry": found.believed_m, "second odometry": found.seen_m, "apart": found.off_m}
    turned = history.wheels_in(span_s, found.to_s)
    if turned is not None:
        ways_m = {"wheels": abs(turned.way_m), **ways_m}
    figures = speeds(history, span_s, found.to_s, ways_m)
    return compared("the rover slips", figures, bound_m / span_s, span_s)


def turn_slips(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """See a second odometry that tells of another turn."""
    found = _found(history, window, now_s)
    if found is None:
        return None
    bound_rad = window.allowed(found.turned_rad)
    if found.off_rad <= bound_rad:
        return None
    figures = turns(
        history,
        found.span_s,
        found.to_s,
        {"odometry": found.believed_rad, "second odometry": found.seen_rad},
    )
    return compared("the odometries disagree on the turn", figures, bound_rad, found.span_s)


def slides(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """See that the rover moves although it is to stand, and its odometry says that it does."""
    found = _found(history, window, now_s)
    if found is None or found.from_s < history.standing_since_s + STOPPED_S:
        return None
    stands = found.driven_m <= STILL_M and found.turned_rad <= STILL_RAD
    if not stands or found.off_m <= window.bound:
        return None
    ways_m = {"odometry": found.believed_m, "second odometry": found.seen_m}
    figures = speeds(history, found.span_s, found.to_s, ways_m)
    bound_mps = window.bound / found.span_s
    return compared("the rover slides while it is to stand", figures, bound_mps, found.span_s)


def second_odometry_silent(history: MotionHistory, window: Window, now_s: float) -> Evidence | None:
    """See that the second odometry no longer tells anything."""
    if history.second is None:
        return None
    sightings = history.second.sightings
    last_s = sightings[-1].time_s if sightings else -inf
    return silent(history, "the second odometry", "slip is", last_s, window, now_s)


def _found(history: MotionHistory, window: Window, now_s: float) -> OdometryDisagreement | None:
    """Return what the odometries say of a window, where it is of now."""
    second = history.second
    if second is None or now_s - second.at_s > FRESH_S:
        return None
    return second.disagreement(window.length_s, history.begun_s)
