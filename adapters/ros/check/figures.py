"""`figures` of a robot's sensors, from facts with their times of arrival; without ROS."""

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import acos, atan2, cos, hypot, inf, isfinite, sin, sqrt
from operator import mul
from statistics import fmean, median, pvariance, quantiles
from typing import Any, Final, Generic, NamedTuple, TypeVar

from executive.safety import TWIST_KINDS
from executive.settings import JointsSettings
from executive.values.facts import Imu, Joints, Odometry
from executive.values.geometry import (
    GRAVITY_MPS2,
    Rotation,
    Vector,
    inclination,
    up_of,
    wrap_rad,
)

MIN_MESSAGES: Final = 5
REST_MPS, REST_RADPS = 0.005, 0.01
"""Maximum twist at rest."""
REST_S: Final = 1.0
"""Part of a rest that is left out at both ends: the pose moves while a late twist is zero."""
IMU_REST_RADPS: Final = 0.06
GRAVITY_TOLERANCE_MPS2: Final = 0.5
WINDOW_S: Final = 0.5
"""Window of the comparison between two sources."""
MIN_GAIN_MPS, MIN_SIGNIFICANCE = 0.5, 3.5
"""Minimum sum of changes of speed, and of their correlation with the accelerations, times the root
of the number of windows: a real Husky has 0.3 in 395 s, which shows its yaw to 2 degrees."""
MIN_TURN_RAD, MIN_TRAVEL_M = 0.5, 0.3
"""Minimum turn and travel of a comparison."""
TURN_M: Final = 0.2
"""Weight of a yaw rate relative to a speed."""
DISTINCT_MPS: Final = 0.01
"""Minimum difference of errors that distinguishes twists: at steady speed all are alike."""
MOMENTARY_RATIO: Final = 0.05
"""Maximum error (mean square) of another twist relative to a momentary one, to be reported."""
RETAINED_RATIO: Final = 0.98
"""Share of the differences that count; those of a single jump of the pose do not."""

F = TypeVar("F", bound=Odometry | Imu | Joints)


class Arrived(NamedTuple, Generic[F]):
    """A fact with the time of its arrival, s."""

    at_s: float
    fact: F


@dataclass(frozen=True, slots=True)
class Timing:
    """Times of a topic.

    Attributes:
        rate_hz, gap_s: rate and maximum interval by stamps; by arrivals, if they do not advance.
        age_s: median of arrival minus stamp; NaN without stamps.
        jitter_s: range of the middle 98 % of that difference.
    """

    rate_hz: float
    gap_s: float
    age_s: float
    jitter_s: float


@dataclass(frozen=True, slots=True)
class Twist:
    """The twist of the odometry relative to its pose.

    Attributes:
        mean_s: averaging time or delay; 0: momentary.
        behind: whether it is delayed, and not a mean up to now.
        error_mps: root mean square of the residual, and `momentary_mps` of a momentary twist.
    """

    mean_s: float
    behind: bool
    error_mps: float
    momentary_mps: float


@dataclass(frozen=True, slots=True)
class Mounting:
    """Mounting of the IMU, by gravity at rest and by its accelerations ahead.

    Attributes:
        up: the vertical in the axes of the IMU; (0, 0, 1) if it is parallel to base_link.
        oriented: whether the IMU gives its orientation.
        bias_radps: mean yaw rate at rest, about the vertical.
        yaw_rad: its turn about the vertical; None if the speed changed too little.
        off_rad: angle between the verticals by orientation and by gravity; None without the first.
    """

    up: Vector
    oriented: bool
    bias_radps: float
    yaw_rad: float | None = None
    off_rad: float | None = None

    @property
    def lean_rad(self) -> float:
        """The angle between the axes z of the IMU and of base_link."""
        return _angle((0.0, 0.0, 1.0), self.up)


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of the sensors; None where the data do not determine one.

    Attributes:
        noise_m, noise_rad: standard deviation of the pose at rest.
        gyro_turn: turn by the odometry per turn by the gyro.
        wheels_turn: turn by the wheels per turn by the gyro, else by the odometry.
        wheels_travel: travel by the wheels per travel by the odometry.
    """

    twist: Twist | None = None
    noise_m: float | None = None
    noise_rad: float | None = None
    mounting: Mounting | None = None
    gyro_turn: float | None = None
    wheels_turn: float | None = None
    wheels_travel: float | None = None


Track = list[tuple[float, float]]
"""A sum over time."""


def timing(times: Sequence[tuple[float, float]]) -> Timing | None:
    """Return the times of a topic by arrivals and stamps (NaN without); None for few messages."""
    if len(times) < MIN_MESSAGES or times[-1][0] <= times[0][0]:
        return None
    stamped = all(isfinite(stamp_s) for _, stamp_s in times)
    ages_s = [at_s - stamp_s for at_s, stamp_s in times]
    points = sorted(stamp_s if stamped else at_s for at_s, stamp_s in times)
    if points[0] == points[-1]:
        points = [at_s for at_s, _ in times]
    rate_hz = (len(times) - 1) / (points[-1] - points[0])
    gap_s = max(after - before for before, after in pairwise(points))
    if not stamped:
        return Timing(rate_hz, gap_s, median(ages_s), median(ages_s))
    parts = quantiles(ages_s, n=100, method="inclusive")
    return Timing(rate_hz, gap_s, median(ages_s), parts[-1] - parts[0])


def figures(facts: Iterable[Arrived[Any]], wheels: JointsSettings | None) -> Figures:
    """Return the figures of the facts of a robot, in order of arrival."""
    facts = list(facts)
    odometry, imu = _of(facts, Odometry), _of(facts, Imu)
    heading, travel = _tracks(odometry)
    noise_m, noise_rad = _noise(odometry)
    mounting = _mounting(imu, travel)
    up, bias_radps = (mounting.up, mounting.bias_radps) if mounting else ((0.0, 0.0, 1.0), 0.0)
    gyro = _sum([(at_s, _about(up, fact) - bias_radps) for at_s, fact in imu])
    turn, distance = _wheels(_of(facts, Joints), wheels) if wheels is not None else ([], [])
    return Figures(
        _twist(odometry, heading, travel, noise_m or 0.0),
        noise_m,
        noise_rad,
        mounting,
        _ratio(heading, gyro, MIN_TURN_RAD),
        _ratio(turn, gyro, MIN_TURN_RAD) or _ratio(turn, heading, MIN_TURN_RAD),
        _ratio(distance, travel, MIN_TRAVEL_M),
    )


def _of(facts: Sequence[Arrived[Any]], kind: type[F]) -> list[tuple[float, F]]:
    """Return the facts of a kind, with stamps in the time of arrival (by their median age)."""
    found = [(at_s, fact) for at_s, fact in facts if isinstance(fact, kind)]
    if len(found) < MIN_MESSAGES:
        return []
    age_s = median(at_s - fact.stamp_s for at_s, fact in found)
    placed = sorted({fact.stamp_s + age_s: fact for _, fact in found}.items())
    return placed if len(placed) > len(found) / 2 else found


def _noise(odometry: Sequence[tuple[float, Odometry]]) -> tuple[float | None, float | None]:
    """Return the standard deviations of a coordinate and of the heading at rest."""
    moving_s = [at_s for at_s, fact in odometry if _moves(fact)]
    variances_m2, variances_rad2 = [], []
    for from_s, to_s in pairwise([-inf, *moving_s, inf]):
        if to_s - from_s <= 2 * REST_S:
            continue
        rest = [fact.pose for at_s, fact in odometry if from_s + REST_S <= at_s <= to_s - REST_S]
        if len(rest) >= MIN_MESSAGES:
            x_m2, y_m2 = pvariance([each.x_m for each in rest]), pvariance([p.y_m for p in rest])
            turns = [wrap_rad(each.heading_rad - rest[0].heading_rad) for each in rest]
            variances_m2.append((x_m2 + y_m2) / 2)
            variances_rad2.append(pvariance(turns))
    if not variances_m2:
        return None, None
    return sqrt(fmean(variances_m2)), sqrt(fmean(variances_rad2))


def _moves(fact: Odometry) -> bool:
    velocity = fact.velocity
    return abs(velocity.travel_mps) > REST_MPS or abs(velocity.rotate_radps) > REST_RADPS


def _tracks(odometry: Sequence[tuple[float, Odometry]]) -> tuple[Track, Track]:
    """Return the turn of the pose, and its travel along its heading."""
    turn, travel = ([(at_s, 0.0) for at_s, _ in odometry[:1]] for _ in range(2))
    for (_, a), (at_s, b) in pairwise(odometry):
        turned_rad = wrap_rad(b.pose.heading_rad - a.pose.heading_rad)
        along_rad = a.pose.heading_rad + turned_rad / 2
        ahead_m = (b.pose.x_m - a.pose.x_m) * cos(along_rad)
        ahead_m += (b.pose.y_m - a.pose.y_m) * sin(along_rad)
        turn.append((at_s, turn[-1][1] + turned_rad))
        travel.append((at_s, travel[-1][1] + ahead_m))
    return turn, travel


def _twist(
    odometry: Sequence[tuple[float, Odometry]], heading: Track, travel: Track, noise_m: float
) -> Twist | None:
    """Return the candidate with the least error; None if the motion does not distinguish them."""
    first = 1 + max(steps + behind for steps, behind in TWIST_KINDS)
    moves = [_moves(fact) for _, fact in odometry]
    # Without the rests: all candidates fit there.
    compared = [
        index for index in range(first, len(odometry)) if any(moves[index - first : index + first])
    ]
    if len(compared) <= MIN_MESSAGES:
        return None
    period_s = (odometry[-1][0] - odometry[0][0]) / (len(odometry) - 1)

    def error(steps: int, behind: int) -> float:
        squares = []
        for index in compared:
            last, begin = index - behind, index - behind - steps
            span_s = travel[last][0] - travel[begin][0]
            velocity = odometry[index][1].velocity
            off_mps = velocity.travel_mps - (travel[last][1] - travel[begin][1]) / span_s
            off_radps = velocity.rotate_radps - (heading[last][1] - heading[begin][1]) / span_s
            squares.append(off_mps * off_mps + (TURN_M * off_radps) ** 2)
        retained = sorted(squares)[: round(RETAINED_RATIO * len(squares))]
        # Less that of the noise, which a longer mean reduces.
        return max(0.0, fmean(retained) - noise_m2ps2 / (steps * steps))

    noise_m2ps2 = 2 * (noise_m / period_s) ** 2
    errors = [error(*each) for each in TWIST_KINDS]
    least, momentary_mps = min(errors), sqrt(errors[0])
    if sqrt(max(errors)) - sqrt(least) < DISTINCT_MPS:
        return None
    noisy = errors[0] < max(DISTINCT_MPS**2, noise_m2ps2 / 2)
    if noisy or least > MOMENTARY_RATIO * errors[0]:
        return Twist(0.0, False, momentary_mps, momentary_mps)
    steps, behind = TWIST_KINDS[errors.index(least)]
    covered = steps - 1 + behind if behind else steps
    return Twist(covered * period_s, behind > 0, sqrt(least), momentary_mps)


def _mounting(imu: Sequence[tuple[float, Imu]], travel: Track) -> Mounting | None:
    rests = [
        each
        for _, each in imu
        if hypot(*each.rates) < IMU_REST_RADPS and isfinite(each.acceleration_x_mps2)
    ]
    if len(rests) < MIN_MESSAGES:
        return None
    x, y, z = map(fmean, zip(*(each.acceleration for each in rests), strict=True))
    size = hypot(x, y, z)
    if abs(size - GRAVITY_MPS2) > GRAVITY_TOLERANCE_MPS2:
        return None
    up = (x / size, y / size, z / size)
    leans = [up_of(each.roll_rad, each.pitch_rad) for each in rests if isfinite(each.roll_rad)]
    off_rad = _angle(up, leans[len(leans) // 2]) if leans else None
    bias_radps = fmean(_about(up, each) for each in rests)
    return Mounting(up, bool(leans), bias_radps, _yaw(imu, travel, up), off_rad)


def _yaw(imu: Sequence[tuple[float, Imu]], travel: Track, up: Vector) -> float | None:
    """Return the yaw, by the level accelerations while the speed of the pose changes."""
    if len(travel) < MIN_MESSAGES:
        return None
    lean = Rotation(*inclination(up))
    level = [(at_s, lean.apply(each.acceleration)) for at_s, each in imu]
    from_s, to_s = max(travel[0][0], imu[0][0]), min(travel[-1][0], imu[-1][0])
    windows = range(int(max(0.0, to_s - from_s) / WINDOW_S - 0.5))
    times_s = [from_s + WINDOW_S * each for each in windows]
    # The change of the mean speed of two windows is the acceleration between their middles.
    gained_mps = [(b - a) / WINDOW_S for a, b in pairwise(_steps(travel, times_s))]
    between_s = [each + WINDOW_S / 2 for each in times_s[:-1]]
    ahead, left = (
        _steps(_sum([(at_s, each[axis]) for at_s, each in level]), between_s) for axis in (0, 1)
    )
    along, aside = (sum(map(mul, gained_mps, felt)) for felt in (ahead, left))
    spread = sqrt(sum(map(mul, gained_mps, gained_mps)) * sum(x * x for x in (*ahead, *left)))
    known = hypot(along, aside) * sqrt(len(gained_mps)) >= MIN_SIGNIFICANCE * spread
    if sum(map(abs, gained_mps)) < MIN_GAIN_MPS or not known:
        return None
    return -atan2(aside, along)


def _angle(one: Vector, other: Vector) -> float:
    return acos(max(-1.0, min(1.0, sum(map(mul, one, other)))))


def _about(up: Vector, imu: Imu) -> float:
    """Return the rate of an IMU about the vertical."""
    return sum(a * b for a, b in zip(up, imu.rates, strict=True))


def _sum(rates: Sequence[tuple[float, float]]) -> Track:
    """Return the integral of a rate."""
    track: Track = [(at_s, 0.0) for at_s, _ in rates[:1]]
    for (before_s, before), (at_s, rate) in pairwise(rates):
        track.append((at_s, track[-1][1] + (at_s - before_s) * (before + rate) / 2))
    return track


def _wheels(joints: Sequence[tuple[float, Joints]], wheels: JointsSettings) -> tuple[Track, Track]:
    """Return turn and travel by the wheels."""
    sides = [(at_s, fmean(each.left_radps), fmean(each.right_radps)) for at_s, each in joints]
    radius_m, track_m = wheels.wheel_radius_m, wheels.track_m
    turn = _sum([(at_s, (right - left) * radius_m / track_m) for at_s, left, right in sides])
    return turn, _sum([(at_s, (right + left) * radius_m / 2) for at_s, left, right in sides])


def _ratio(track: Track, other: Track, minimum: float) -> float | None:
    """Return the slope of one track over another, by windows; None for too little motion."""
    if min(len(track), len(other)) < MIN_MESSAGES:
        return None
    from_s, to_s = max(track[0][0], other[0][0]), min(track[-1][0], other[-1][0])
    windows = range(int(max(0.0, to_s - from_s) / WINDOW_S))
    times_s = [from_s + WINDOW_S * each for each in windows]
    steps, others = _steps(track, times_s), _steps(other, times_s)
    if min(sum(map(abs, steps)), sum(map(abs, others))) < minimum:
        return None
    products = (a * b for a, b in zip(steps, others, strict=True))
    return sum(products) / sum(each * each for each in others)


def _steps(track: Track, times_s: Sequence[float]) -> list[float]:
    stamps_s, sums = [at_s for at_s, _ in track], []
    for at_s in times_s:
        index = max(1, bisect_left(stamps_s, at_s))
        (a_s, a), (b_s, b) = track[index - 1], track[index]
        sums.append(a + (b - a) * (at_s - a_s) / (b_s - a_s))
    return [after - before for before, after in pairwise(sums)]
