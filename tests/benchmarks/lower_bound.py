"""A time that no motion from rest to rest between two poses is shorter than."""

from math import cos, pi
from typing import Final

from executive.motion.locomotion import Bounds, duration_s
from executive.values.geometry import Pose, wrap_rad

INTERVALS: Final = 400
EXACT_S: Final = 1e-4


def lower_bound_s(
    start: Pose,
    goal: Pose,
    travel: Bounds,
    rotate: Bounds,
    within_m: float = 0.0,
    within_rad: float = 0.0,
) -> float:
    """Return a lower bound on the duration of every motion from rest to rest.

    The motion is that of a unicycle: a point that moves along its heading only, forward or
    backward, its speeds and accelerations of travel and rotation within bounds. It ends within
    `within_m` and `within_rad` of the goal.

    Why it is one: let T be a duration, d the distance less `within_m`, and b the bearing of the
    goal from the start.

    1. The heading changes by the difference of the headings less `within_rad` at least. From rest
       to rest that takes `duration_s` of it: no profile of speed is faster than the trapezoid.
    2. The way along b is the integral of v(t) cos(h(t) - b) over 0..T, and is d at least. At each
       t, |v(t)| <= V(t) = min(A t, speed, A (T - t)), since it begins and ends at rest. The heading
       h(t) is within R(t) of the first, and within R(T - t) + `within_rad` of the last, where R(t)
       is how far one can turn from rest in t. So |cos(h(t) - b)| is at most its greatest value in
       each of both ranges, C(t) and E(T - t), and d <= integral of V(t) min(C(t), E(T - t)).
    3. That integral does not decrease with T, since for each t neither V(t) nor E(T - t) does.
       A T for which it is less than d is therefore less than every duration that is possible. What
       is returned is such a T, unless the least time of the rotation is greater.
    4. In each interval of the sum, what increases with t is taken at its end and what decreases
       at its begin, so the sum is no less than the integral.

    It holds for a rover that moves as commanded. One that turns faster than commanded, as skid
    steering does on curves, may rotate in less time.
    """
    distance_m = max(start.point.distance_m(goal.point) - within_m, 0.0)
    turn_rad = max(abs(wrap_rad(goal.heading_rad - start.heading_rad)) - within_rad, 0.0)
    low_s = max(duration_s(turn_rad, rotate), duration_s(distance_m, travel))
    bearing_rad = start.point.bearing_rad(goal.point)
    from_rad = start.heading_rad - bearing_rad
    to_rad = goal.heading_rad - bearing_rad

    def reach_m(whole_s: float) -> float:
        """Return more than any motion of that duration covers along the bearing."""
        step_s, total_m = whole_s / INTERVALS, 0.0
        for index in range(INTERVALS):
            begin_s, end_s = index * step_s, (index + 1) * step_s
            left_s = whole_s - begin_s
            speed = min(travel.acceleration * min(end_s, left_s), travel.speed)
            ahead = _best_cosine(from_rad, _reach_rad(end_s, rotate))
            behind = _best_cosine(to_rad, _reach_rad(left_s, rotate) + within_rad)
            total_m += speed * min(ahead, behind) * step_s
        return total_m

    if reach_m(low_s) >= distance_m:
        return low_s
    high_s = 2.0 * low_s + 1.0
    while reach_m(high_s) < distance_m:
        low_s, high_s = high_s, 2.0 * high_s
    while high_s - low_s > EXACT_S:
        middle_s = (low_s + high_s) / 2.0
        if reach_m(middle_s) < distance_m:
            low_s = middle_s
        else:
            high_s = middle_s
    return low_s


def _reach_rad(time_s: float, rotate: Bounds) -> float:
    """Return how far one can turn from rest, without coming to rest again."""
    ramp_s = rotate.speed / rotate.acceleration
    if time_s <= ramp_s:
        return rotate.acceleration * time_s**2 / 2.0
    return rotate.speed * (time_s - ramp_s / 2.0)


def _best_cosine(off_rad: float, reach_rad: float) -> float:
    """Return the greatest |cos| within a range about an angle: backward is as good as forward."""
    off_rad = abs(wrap_rad(off_rad))
    left_rad = min(off_rad, pi - off_rad) - reach_rad
    return 1.0 if left_rad <= 0.0 else cos(left_rad)
