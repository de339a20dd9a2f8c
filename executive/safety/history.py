"""The last seconds of what was commanded and sensed, on one time base.

Facts are placed by their stamps. The clock of a publisher may be another one than the core's: its
offset is learnt as the smallest difference of arrival and stamp, so that late is what comes later
than usual. Each source has a channel of running sums, from which what happened between any two
times is two look-ups.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, floor, hypot, inf, isfinite, sin
from typing import Final, NamedTuple

from executive.clock import Clock
from executive.fault_table import FaultTable
from executive.geometry import STANDING, Pose, Velocity, wrap_rad
from executive.state import Battery, Fact, Odometry

GRID_S: Final = 0.02
SLOTS: Final = 512
"""Of a channel: about ten seconds."""
USUAL_LATENCY_S: Final = 0.05
"""At most taken for usual of the first message, where its stamp is of the core's own clocks."""
OWN_CLOCK_S: Final = 0.5
"""A first message that is no older by a clock of the core was stamped by that clock."""
SAME_CLOCK_S: Final = 1.0
"""Publishers whose offsets differ by less share a clock."""
DRIFT_RATIO: Final = 1e-3
"""By how much a publisher's clock may lose on the core's."""


class StampClock:
    """Puts stamps of all sources on the core's time.

    Sources of one clock share one offset, so that what takes longer to arrive is not taken for
    newer.
    """

    def __init__(self) -> None:
        self._offsets_s: dict[type, float] = {}
        self._last: dict[type, tuple[float, float]] = {}

    def time_s(self, source: type, stamp_s: float, now_s: float, utc_s: float) -> float:
        """Return when something was measured, on the core's time.

        Args:
            source: the kind of fact.
            stamp_s: on the clock of its publisher.
            now_s: when it arrived.
            utc_s: the same, in UTC.
        """
        offset_s = now_s - stamp_s
        last_stamp_s, last_now_s = self._last.get(source, (inf, now_s))
        self._last[source] = (stamp_s, now_s)
        if stamp_s < last_stamp_s - SAME_CLOCK_S:
            own_age_s = next((a for a in (offset_s, utc_s - stamp_s) if 0 <= a < OWN_CLOCK_S), 0.0)
            known_s = offset_s - max(0.0, own_age_s - USUAL_LATENCY_S)
        else:
            known_s = self._offsets_s[source] + DRIFT_RATIO * (now_s - last_now_s)
        self._offsets_s[source] = own_s = min(offset_s, known_s)
        shared_s = min(
            each for each in self._offsets_s.values() if abs(each - own_s) < SAME_CLOCK_S
        )
        return stamp_s + shared_s


class Channel:
    """Running sums of one source over time, on a grid, interpolated in between.

    Attributes:
        time_s: of the newest; before the first it is minus infinity.
        sums: the newest.
    """

    def __init__(self, width: int) -> None:
        self._slots: list[Sequence[float]] = [(0.0,) * width] * SLOTS
        self._filled = self._first = 0
        self.time_s = -inf
        self.sums: Sequence[float] = (0.0,) * width

    def add(self, time_s: float, sums: Sequence[float]) -> None:
        """Take the sums up to a time; what is not newer is left out."""
        if time_s <= self.time_s:
            return
        last, since_s = floor(time_s / GRID_S), time_s - self.time_s
        if since_s > GRID_S * SLOTS:
            self._first = self._filled = last
            self._slots[last % SLOTS] = sums
        for index in range(self._filled + 1, last + 1):
            part = (index * GRID_S - self.time_s) / since_s
            self._slots[index % SLOTS] = [
                old + part * (new - old) for old, new in zip(self.sums, sums, strict=True)
            ]
        self._filled = last
        self.time_s, self.sums = time_s, sums

    def covers(self, time_s: float) -> bool:
        """Whether the sums at a time are known."""
        oldest = max(self._first, self._filled - SLOTS + 2)
        return oldest * GRID_S <= time_s <= self.time_s

    def at(self, time_s: float) -> Sequence[float]:
        """Return the sums at a time that is covered."""
        index = floor(time_s / GRID_S)
        low = self._slots[index % SLOTS]
        if index >= self._filled:
            begun_s, high, span_s = index * GRID_S, self.sums, self.time_s - index * GRID_S
            if span_s <= 0.0:
                return high
        else:
            begun_s, high, span_s = index * GRID_S, self._slots[(index + 1) % SLOTS], GRID_S
        part = (time_s - begun_s) / span_s
        return [old + part * (new - old) for old, new in zip(low, high, strict=True)]

    def between(self, from_s: float, to_s: float) -> list[float] | None:
        """Return what was added between two times; None where that is not known."""
        if not (self.covers(from_s) and self.covers(to_s)):
            return None
        return [new - old for old, new in zip(self.at(from_s), self.at(to_s), strict=True)]


class Moved(NamedTuple):
    """What the odometry says of a window; what was commanded has the first four figures.

    Attributes:
        way_m, turn_rad: by its velocities.
        driven_m, turned_rad: the same without signs.
        ahead_m, left_m, heading_rad: by how much its pose moved beyond its velocities.
        pose_m: length of the path of its pose.
        pose_rad: by how much its heading changed.
    """

    way_m: float
    turn_rad: float
    driven_m: float
    turned_rad: float
    ahead_m: float = 0.0
    left_m: float = 0.0
    heading_rad: float = 0.0
    pose_m: float = 0.0
    pose_rad: float = 0.0


class Commanded(NamedTuple):
    """The least and the greatest velocities that were commanded in a window."""

    travel_low_mps: float
    travel_high_mps: float
    rotate_low_radps: float
    rotate_high_radps: float


@dataclass(frozen=True, slots=True)
class Jump:
    """A step of the odometry that no motion of the rover explains, beside what it may be.

    Attributes:
        at_s: when it arrived.
    """

    at_s: float
    step_m: float
    bound_m: float
    turn_rad: float
    bound_rad: float


class History:
    """What was commanded and sensed.

    Attributes:
        odometry: the newest that is finite, and `odometry_time_s`, when it was measured.
        moved: the channel of the odometry, by its stamps.
        arrivals: how many messages of odometry came, and the sum of their ages, by arrival.
        commands: the channel of what was commanded.
        standing_since_s: since when nothing but to stand is commanded; infinite while it is not.
        begun_s: no window reaches back beyond this time.
        jump: the last step of the odometry that nothing explains.
        battery: the newest voltage, as it came, and `battery_at_s`, when.
    """

    def __init__(self, clock: Clock, faults: FaultTable) -> None:
        self._clock = clock
        self._faults = faults
        self._stamps = StampClock()
        self.odometry: Odometry | None = None
        self.odometry_time_s = -inf
        self.odometry_at_s = -inf
        self.not_finite_at_s = -inf
        self.moved = Channel(len(Moved._fields))
        self.arrivals = Channel(2)
        self.commands = Channel(4)
        self._velocities: deque[tuple[float, Velocity]] = deque([(-inf, STANDING)])
        self.standing_since_s = -inf
        self.begun_s = -inf
        self.jump: Jump | None = None
        self.battery: Battery | None = None
        self.battery_at_s = -inf

    def observe(self, fact: Fact) -> None:
        """Take in a fact."""
        now_s = self._clock.now_s()
        match fact:
            case Odometry():
                self._observe_odometry(fact, now_s)
            case Battery(voltage_v):
                if isfinite(voltage_v):
                    self.battery, self.battery_at_s = fact, now_s
            case _:
                pass

    def command(self, velocity: Velocity) -> None:
        """Note the velocity that is commanded from now on."""
        now_s, channel = self._clock.now_s(), self.commands
        last = self._velocities[-1][1]
        since_s = max(now_s - channel.time_s, 0.0) if channel.time_s > -inf else 0.0
        way_m, turn_rad = last.travel_mps * since_s, last.rotate_radps * since_s
        steps = (way_m, turn_rad, abs(way_m), abs(turn_rad))
        channel.add(now_s, [old + step for old, step in zip(channel.sums, steps, strict=True)])
        self._velocities.append((now_s, velocity))
        while self._velocities[1][0] <= now_s - GRID_S * SLOTS:
            self._velocities.popleft()
        if velocity != STANDING:
            self.standing_since_s = inf
        elif self.standing_since_s == inf:
            self.standing_since_s = now_s

    def accept(self) -> None:
        """Take what odometry says now as good, and look at nothing that was before."""
        self.jump = None
        self.begun_s = self._clock.now_s()

    @property
    def commanding(self) -> bool:
        """Whether another velocity than to stand is commanded."""
        return self.standing_since_s == inf

    def window(self, channel: Channel, window_s: float, to_s: float) -> list[float] | None:
        """Return what a channel added in the seconds before a time; None where it is not known."""
        from_s = to_s - window_s
        return None if from_s < self.begun_s else channel.between(from_s, to_s)

    def moved_in(self, window_s: float, to_s: float) -> Moved | None:
        """Return what the odometry says of the seconds before a time."""
        sums = self.window(self.moved, window_s, to_s)
        return None if sums is None else Moved(*sums)

    def commanded_in(self, window_s: float, to_s: float) -> Moved | None:
        """Return which way and turn were commanded in the seconds before a time."""
        sums = self.window(self.commands, window_s, min(to_s, self.commands.time_s))
        return None if sums is None else Moved(*sums)

    def commands_in(self, window_s: float, to_s: float) -> Commanded:
        """Return between which velocities the commands were, in the seconds before a time."""
        found: list[Velocity] = []
        for since_s, velocity in reversed(self._velocities):
            if since_s < to_s:
                found.append(velocity)
            if since_s <= to_s - window_s:
                break
        travel = [each.travel_mps for each in found] or [0.0]
        rotate = [each.rotate_radps for each in found] or [0.0]
        return Commanded(min(travel), max(travel), min(rotate), max(rotate))

    def _observe_odometry(self, fact: Odometry, now_s: float) -> None:
        if not (fact.pose.finite and fact.velocity.finite):
            self.not_finite_at_s = now_s
            return
        time_s = self._stamps.time_s(Odometry, fact.stamp_s, now_s, self._clock.utc_s())
        count, age_s = self.arrivals.sums
        self.arrivals.add(now_s, (count + 1, age_s + max(now_s - time_s, 0.0)))
        if self.odometry is not None:
            self._step(self.odometry, fact, time_s, now_s)
        else:
            self.moved.add(time_s, self.moved.sums)
        self.odometry, self.odometry_time_s, self.odometry_at_s = fact, time_s, now_s

    def _step(self, before: Odometry, after: Odometry, time_s: float, now_s: float) -> None:
        step_s = time_s - self.moved.time_s
        travel_mps = (before.velocity.travel_mps + after.velocity.travel_mps) / 2
        rotate_radps = (before.velocity.rotate_radps + after.velocity.rotate_radps) / 2
        way_m, turn_rad = travel_mps * step_s, rotate_radps * step_s
        ahead_m, left_m, turned_rad = step_between(before.pose, after.pose)
        if step_s > 0.0:
            steps = (
                way_m,
                turn_rad,
                abs(way_m),
                abs(turn_rad),
                ahead_m - way_m * cos(after.pose.pitch_rad),
                left_m,
                turned_rad - turn_rad,
                hypot(ahead_m, left_m),
                turned_rad,
            )
            sums = [old + step for old, step in zip(self.moved.sums, steps, strict=True)]
            self.moved.add(time_s, sums)
        since_s = now_s - self.odometry_at_s
        if since_s <= self._faults.odometry_stale.bound:
            self.jump = self._unexplained(before, after, since_s) or self.jump

    def _unexplained(self, before: Odometry, after: Odometry, since_s: float) -> Jump | None:
        """Return the step between two messages, if it is longer than their speeds explain."""
        first, second = before.velocity, after.velocity
        found = Jump(
            self._clock.now_s(),
            hypot(after.pose.x_m - before.pose.x_m, after.pose.y_m - before.pose.y_m),
            self._faults.odometry_jumped.bound
            + since_s * max(abs(first.travel_mps), abs(second.travel_mps)),
            abs(wrap_rad(after.pose.heading_rad - before.pose.heading_rad)),
            self._faults.odometry_turned.bound
            + since_s * max(abs(first.rotate_radps), abs(second.rotate_radps)),
        )
        near = found.step_m <= found.bound_m and found.turn_rad <= found.bound_rad
        return None if near else found


def step_between(before: Pose, after: Pose) -> tuple[float, float, float]:
    """Return how far a pose moved ahead, to the left, and turned, seen along the mean heading."""
    turned_rad = wrap_rad(after.heading_rad - before.heading_rad)
    along_rad = before.heading_rad + turned_rad / 2
    dx_m, dy_m = after.x_m - before.x_m, after.y_m - before.y_m
    cosine, sine = cos(along_rad), sin(along_rad)
    return dx_m * cosine + dy_m * sine, dy_m * cosine - dx_m * sine, turned_rad
