"""The odometry of a rover that obeys, as drivers of real robots publish it, and its monitors."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, sin
from random import Random

from executive.safety import FaultMonitor
from executive.settings import OdometrySettings, Sensors, Settings, load_settings
from executive.values.clock import ManualClock
from executive.values.facts import Fact, Odometry
from executive.values.geometry import STANDING, Pose, Velocity, wrap_rad

STEP_S = 0.005
TICK_S = 0.05
LATE_S = 0.01
LATENCY_S = 0.06
LAG_S = 0.05
TRAVEL_MPS2, ROTATE_RADPS2 = 1.0, 3.0

Leg = tuple[float, float, float]
LEGS: Sequence[Leg] = (
    (4.0, 0.0, 0.0),
    (4.0, 0.8, 0.0),
    (3.0, 0.8, 0.6),
    (3.0, 0.0, 1.2),
    (3.0, 0.0, 0.0),
    (4.0, 0.5, -0.8),
    (3.0, -0.6, 0.0),
    (3.0, 0.0, -1.2),
    (4.0, 1.0, 0.0),
    (3.0, 0.0, 0.0),
)
"""Duration, travel and rotation of each leg."""


def asset(odometry: OdometrySettings | None = None) -> Settings:
    """Return a Jackal with nothing but its odometry, of which nothing is declared by default."""
    jackal = replace(load_settings("jackal"), sensors=Sensors())
    return replace(jackal, odometry=odometry or OdometrySettings())


@dataclass(frozen=True)
class Motion:
    """The truth at one time: the command, and the pose and velocity that follow it."""

    time_s: float
    commanded: Velocity
    pose: Pose
    heading_rad: float
    velocity: Velocity


def motion(legs: Iterable[Leg] = LEGS) -> list[Motion]:
    """Return the motion along legs, with the latency and the lag of a base."""
    made = [Motion(0.0, STANDING, Pose(), 0.0, STANDING)]
    delay = round(LATENCY_S / STEP_S)
    for duration_s, travel_mps, rotate_radps in legs:
        for _ in range(round(duration_s / STEP_S)):
            last = made[-1]
            commanded = Velocity(
                _toward(last.commanded.travel_mps, travel_mps, TRAVEL_MPS2 * STEP_S),
                _toward(last.commanded.rotate_radps, rotate_radps, ROTATE_RADPS2 * STEP_S),
            )
            obeyed, part = made[max(0, len(made) - delay)].commanded, STEP_S / LAG_S
            v, w = last.velocity.travel_mps, last.velocity.rotate_radps
            v, w = v + part * (obeyed.travel_mps - v), w + part * (obeyed.rotate_radps - w)
            heading_rad = last.heading_rad + w * STEP_S
            along_rad, ahead_m = (heading_rad + last.heading_rad) / 2, v * STEP_S
            pose = Pose(
                last.pose.x_m + ahead_m * cos(along_rad),
                last.pose.y_m + ahead_m * sin(along_rad),
                heading_rad=wrap_rad(heading_rad),
            )
            time_s = len(made) * STEP_S
            made.append(Motion(time_s, commanded, pose, heading_rad, Velocity(v, w)))
    return made


@dataclass(frozen=True)
class Driver:
    """How a driver publishes odometry.

    Attributes:
        rate_hz: rate; each step differs by up to `jitter_ratio` of it.
        lost_ratio: share of the messages that are lost.
        mean_of: number of steps of which the twist is the mean; 0: momentary.
        behind_s: by how much the twist is older than the pose.
        noise_m, noise_rad: standard deviation of a coordinate and of the heading.
        unwrapped: whether its rate is the difference of two headings, not wrapped.
        stall_s: every five seconds nothing arrives for so long.
        stamped_on_arrival: whether a message of the stall arrives after it, stamped then.
    """

    rate_hz: float = 50.0
    jitter_ratio: float = 0.0
    lost_ratio: float = 0.0
    mean_of: int = 0
    behind_s: float = 0.0
    noise_m: float = 0.0
    noise_rad: float = 0.0
    unwrapped: bool = False
    stall_s: float = 0.0
    stamped_on_arrival: bool = False

    def publish(self, driven: Sequence[Motion]) -> list[tuple[float, Odometry]]:
        """Return the messages of a motion with their times of arrival, in order."""
        random, sent, seen = Random(1), [], [driven[0]]
        time_s = STEP_S
        while time_s < driven[-1].time_s:
            now = driven[int(time_s / STEP_S)]
            seen.append(now)
            fact = Odometry(time_s, self._noisy(now.pose, random), self._twist(seen, driven))
            stalled_s = time_s % 5.0 if time_s > 5.0 else self.stall_s
            if stalled_s < self.stall_s:
                if self.stamped_on_arrival:
                    at_s = time_s - stalled_s + self.stall_s + 0.01 * stalled_s
                    sent.append((at_s, replace(fact, stamp_s=at_s)))
            elif random.random() >= self.lost_ratio:
                sent.append((time_s, fact))
            time_s += (1.0 + random.uniform(-1.0, 1.0) * self.jitter_ratio) / self.rate_hz
        return sorted(((at_s + LATE_S, fact) for at_s, fact in sent), key=lambda each: each[0])

    def _noisy(self, pose: Pose, random: Random) -> Pose:
        return Pose(
            pose.x_m + random.gauss(0.0, self.noise_m),
            pose.y_m + random.gauss(0.0, self.noise_m),
            heading_rad=wrap_rad(pose.heading_rad + random.gauss(0.0, self.noise_rad)),
        )

    def _twist(self, seen: Sequence[Motion], driven: Sequence[Motion]) -> Velocity:
        now = seen[-1]
        if not self.mean_of and not self.unwrapped:
            return driven[max(0, int((now.time_s - self.behind_s) / STEP_S))].velocity
        steps = list(pairwise(seen[-1 - max(self.mean_of, 1) :]))
        first, span_s = steps[0][0], now.time_s - steps[0][0].time_s
        during = driven[int(first.time_s / STEP_S) : int(now.time_s / STEP_S)] or [now]
        turned_rad = sum(b.heading_rad - a.heading_rad for a, b in steps)
        if self.unwrapped:
            turned_rad = sum(b.pose.heading_rad - a.pose.heading_rad for a, b in steps)
        travel_mps = sum(each.velocity.travel_mps for each in during) / len(during)
        return Velocity(travel_mps, turned_rad / span_s if span_s > 0.0 else 0.0)


Fault = tuple[float, str]
Change = Callable[[Odometry], Odometry | None]


def begun(
    settings: Settings,
    driver: Driver,
    legs: Iterable[Leg] = LEGS,
    *,
    from_s: float = 0.0,
    wrong: Change = lambda fact: fact,
) -> list[Fault]:
    """Return the faults of a drive, with their times; each is ended at once, as by a resume.

    Args:
        settings: of the asset.
        driver: its odometry.
        legs: the commanded motion.
        from_s: when the odometry goes wrong.
        wrong: what becomes of a message then; None if it is lost.
    """
    driven = motion(legs)
    facts = [
        (at_s, changed)
        for at_s, fact in driver.publish(driven)
        if (changed := fact if at_s < from_s else wrong(fact)) is not None
    ]
    commanded = [each.commanded for each in driven[:: round(TICK_S / STEP_S)]]
    return watched(settings, facts, commanded)


def watched(
    settings: Settings, facts: Sequence[tuple[float, Fact]], commanded: Sequence[Velocity]
) -> list[Fault]:
    """Return the faults by facts with their times of arrival, and by the command of each tick."""
    clock, left, found = ManualClock(), list(reversed(facts)), []
    safety = FaultMonitor(clock, settings)
    start_s, moving = clock.now_s(), False
    for tick, velocity in enumerate(commanded):
        now_s = tick * TICK_S
        while left and left[-1][0] <= now_s:
            at_s, fact = left.pop()
            clock.set(start_s + at_s)
            safety.observe(fact)
        clock.set(start_s + now_s)
        moving = moving or (velocity != STANDING and len(left) < len(facts))
        changes = safety.check(moving)
        found += [(now_s, fault.name) for fault in changes.begun]
        if changes.begun:
            safety.active.clear()
        safety.history.command(velocity)
    return found


def _toward(value: float, wanted: float, step: float) -> float:
    return max(value - step, min(value + step, wanted))
