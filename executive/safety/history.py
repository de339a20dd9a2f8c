"""The last seconds of what was commanded and sensed, on one time base.

Facts are placed by their stamps. Each source has a channel of running sums, from which what
happened between any two times is two look-ups.
"""

from collections import deque
from dataclasses import dataclass
from math import cos, hypot, inf, sin
from typing import Final, NamedTuple

from executive.faults import FaultTable
from executive.safety.channel import GRID_S, SLOTS, Channel, StampClock
from executive.safety.inertial_velocity import InertialVelocity
from executive.safety.other_drivers import Driver, OtherDrivers
from executive.safety.sensor_history import (
    REST_RADPS,
    REST_S,
    ImuHistory,
    InertialSums,
    SecondOdometrySample,
    SecondOdometryTrack,
    WheelHistory,
    WheelSums,
)
from executive.safety.surroundings import LaserSurroundings
from executive.settings import Sensors
from executive.state import Rejections
from executive.values.clock import Clock
from executive.values.facts import (
    Battery,
    Fact,
    ForeignPublishers,
    Frame,
    Imu,
    Joints,
    LaserScan,
    Odometry,
    OtherInput,
    RejectedData,
    SecondOdometry,
)
from executive.values.geometry import STANDING, Pose, Velocity, wrap_rad

STALL_S: Final = 0.25
"""A base that is commanded more seldom may have stopped by itself in between."""
SEEN_S: Final = 0.4
"""Shortest window in which a second odometry shows the rover standing."""


class OdometryWindow(NamedTuple):
    """What the odometry says of a window; what was commanded has the first four figures.

    Attributes:
        way_m, turn_rad: by its velocities.
        driven_m, turned_rad: the same without signs.
        ahead_m, left_m, heading_rad: by how much its pose moved beyond its velocities.
        pose_m: length of the path of its pose.
        pose_ahead_m: the same along its heading, signed.
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
    pose_ahead_m: float = 0.0
    pose_rad: float = 0.0


class CommandedRange(NamedTuple):
    """The least and the greatest velocities that were commanded in a window."""

    travel_low_mps: float
    travel_high_mps: float
    rotate_low_radps: float
    rotate_high_radps: float


@dataclass(frozen=True, slots=True)
class PoseJump:
    """A step of the odometry that no motion of the rover explains, beside what it may be.

    Attributes:
        at_s: when it arrived.
    """

    at_s: float
    step_m: float
    bound_m: float
    turn_rad: float
    bound_rad: float


class MotionHistory:
    """What was commanded and sensed.

    Attributes:
        odometry: the newest that is finite, and `odometry_time_s`, when it was measured.
        odometry_late_s: how old it was when it came first.
        moved: the channel of the odometry, by its stamps.
        arrivals: how many messages of odometry came, and the sum of their ages, by arrival.
        commands: the channel of what was commanded.
        standing_since_s: since when nothing but to stand is commanded; infinite while it is not.
            At first since now: an executive before this one may have left the rover moving.
        motion_since_s: when the motion under way began; infinite where none is.
        unchanged_since_s: since when the odometry is the same to the last bit.
        frame_time_s: when the newest camera frame was taken; None where its clock is not known.
        others: who else may move the rover.
        other_drivers: publishers whose velocities were received.
        lower_may_drive: whether inputs below the executive's may drive the rover while it is idle.
        begun_s: no window reaches back beyond this time.
        jump: the last step of the odometry that nothing explains.
        battery: the newest voltage that can be, and `battery_at_s`, when it came.
        invalid_v: one that came since and cannot be.
        charge_ratio: the newest charge, where one is reported.
        wheels, inertia, second: of the sensors that the asset has; None of those that it has not.
        over_ground: the velocity by the inertial sensors; None where there are none.
        mass_kg: of the asset, where that is known.
        pose: where the rover is taken to be, in the frame of commands.
        surroundings: what stands around it; None where nothing is watched for.
        start_s: when this began.
        rejections: which sources send data that cannot be used.
    """

    def __init__(
        self,
        clock: Clock,
        faults: FaultTable,
        sensors: Sensors | None = None,
        mass_kg: float | None = None,
        surroundings: LaserSurroundings | None = None,
    ) -> None:
        self._clock = clock
        self._faults = faults
        self.mass_kg = mass_kg
        self.start_s = clock.now_s()
        sensors = sensors or Sensors()
        imu, joints, second = sensors.imu, sensors.joints, sensors.second_odometry
        self.inertia = None if imu is None else ImuHistory()
        self.over_ground = None if imu is None else InertialVelocity()
        self.wheels = None if joints is None else WheelHistory(joints)
        self.second = None if second is None else SecondOdometryTrack(second)
        self._track = Channel(3)
        self._stamps = StampClock()
        self.odometry: Odometry | None = None
        self.odometry_time_s = -inf
        self.odometry_at_s = -inf
        self.odometry_late_s = 0.0
        self.not_finite_at_s = -inf
        self.unchanged_since_s = -inf
        self.frame_time_s: float | None = None
        self.others: tuple[str, ...] = ()
        self.moved = Channel(len(OdometryWindow._fields))
        self.arrivals = Channel(2)
        self.commands = Channel(4)
        self._velocities: deque[tuple[float, Velocity, Velocity]] = deque()
        self._velocities.append((-inf, STANDING, STANDING))
        self.standing_since_s = clock.now_s()
        self.motion_since_s = inf
        self.begun_s = -inf
        self.jump: PoseJump | None = None
        self.battery: Battery | None = None
        self.battery_at_s = -inf
        self.other_drivers = OtherDrivers()
        self.lower_may_drive = True
        self.rejections = Rejections(clock)
        self.pose = Pose()
        self.surroundings = surroundings
        self.invalid_v: float | None = None
        self.charge_ratio: float | None = None

    def observe(self, fact: Fact) -> None:
        """Take in a fact."""
        now_s = self._clock.now_s()
        match fact:
            case Odometry():
                self._observe_odometry(fact, now_s)
            case Battery(voltage_v):
                self.charge_ratio = fact.charge_ratio
                bound_v = self._faults.battery_not_finite.bound
                self.invalid_v = None if -inf < voltage_v <= bound_v else voltage_v
                if self.invalid_v is None:
                    self.battery, self.battery_at_s = fact, now_s
            case Joints() if self.wheels is not None:
                self.wheels.observe(fact, self._time_s(fact, now_s))
            case Imu() if self.inertia is not None:
                time_s = self._time_s(fact, now_s)
                self.inertia.observe(fact, time_s, self._travel_mps, self._resting(time_s))
                if self.over_ground is not None:
                    self.over_ground.feel(fact, time_s, self.standing_since_s <= time_s - REST_S)
            case SecondOdometry() if self.second is not None:
                sighting = self._sighting(fact, self._time_s(fact, now_s))
                self.second.observe(fact, sighting, now_s)
                seen = self.second.disagreement(SEEN_S, self.standing_since_s)
                if self.over_ground is not None and seen is not None and seen.stands:
                    self.over_ground.rest(seen.to_s)
            case OtherInput():
                self.other_drivers.observe(fact, now_s)
                if fact.above or (self.lower_may_drive and not self.commanding):
                    self.begun_s = now_s
                    self.standing_since_s = max(self.standing_since_s, now_s)
            case RejectedData():
                self.rejections.observe(fact)
            case LaserScan() if self.surroundings is not None:
                self.surroundings.see(fact, now_s)
            case Frame(stamp_s):
                self.frame_time_s = self._stamps.seen_s(
                    Odometry, stamp_s, now_s, self._clock.utc_s()
                )
            case ForeignPublishers(names):
                self.others = names
            case _:
                pass

    @property
    def drivers(self) -> list[Driver]:
        """The other publishers that command the base now."""
        return self.other_drivers.active(self._clock.now_s())

    @property
    def inputs(self) -> tuple[OtherInput, ...]:
        """The inputs that they use."""
        return tuple(each.input for each in self.drivers)

    def command(self, velocity: Velocity, at_least: Velocity | None = None) -> None:
        """Note what is commanded from now on; after a stall it is not known what came before.

        Args:
            velocity: of the rover; to stand where it should.
            at_least: where the rover gains or loses the velocity by itself, the other end of what
                it may have.
        """
        now_s = self._clock.now_s()
        if now_s - self.commands.time_s > STALL_S:
            self.commands = Channel(4)
        channel = self.commands
        _, least, last = self._velocities[-1]
        last = last if least == last else STANDING
        at_least = velocity if at_least is None else at_least
        since_s = max(now_s - channel.time_s, 0.0) if channel.time_s > -inf else 0.0
        way_m, turn_rad = last.travel_mps * since_s, last.rotate_radps * since_s
        steps = (way_m, turn_rad, abs(way_m), abs(turn_rad))
        channel.add(now_s, [old + step for old, step in zip(channel.sums, steps, strict=True)])
        self._velocities.append((now_s, at_least, velocity))
        while self._velocities[1][0] <= now_s - GRID_S * SLOTS:
            self._velocities.popleft()
        if velocity != STANDING:
            self.standing_since_s = inf
        elif self.standing_since_s == inf:
            self.standing_since_s = now_s

    @property
    def driven(self) -> tuple[float, float]:
        """The way and the turn that odometry has shown since it first came, signed."""
        moved = OdometryWindow(*self.moved.sums)
        return moved.pose_ahead_m, moved.pose_rad

    @property
    def fastest(self) -> Velocity:
        """What is commanded or what odometry says, whichever is faster; none, once to stand is.

        Where the rover gains or loses its velocity by itself, what odometry says.
        """
        _, at_least, commanded = self._velocities[-1]
        if commanded == STANDING or self.odometry is None:
            return commanded
        measured = self.odometry.velocity
        if at_least != commanded:
            return measured
        return Velocity(
            max(commanded.travel_mps, measured.travel_mps, key=abs),
            max(commanded.rotate_radps, measured.rotate_radps, key=abs),
        )

    def accept(self) -> None:
        """Take what odometry says now as good, and look at nothing that was before."""
        self.jump = None
        self.begun_s = self._clock.now_s()

    @property
    def commanding(self) -> bool:
        """Whether another velocity than to stand is commanded."""
        return self.standing_since_s == inf

    @property
    def waiting(self) -> bool:
        """Whether a motion is under way that has not moved the rover yet."""
        return self.standing_since_s <= self.motion_since_s < inf

    def window(self, channel: Channel, window_s: float, to_s: float) -> list[float] | None:
        """Return what a channel added in the seconds before a time; None where it is not known."""
        from_s = to_s - window_s
        return None if from_s < self.begun_s else channel.between(from_s, to_s)

    def lately(self, channel: Channel, window_s: float, to_s: float) -> list[float] | None:
        """Return the same of as much of the seconds before a time as is known."""
        from_s = max(to_s - window_s, self.begun_s, channel.first_s)
        return None if from_s >= to_s else channel.between(from_s, to_s)

    def moved_in(self, window_s: float, to_s: float) -> OdometryWindow | None:
        """Return what the odometry says of the seconds before a time."""
        sums = self.window(self.moved, window_s, to_s)
        return None if sums is None else OdometryWindow(*sums)

    def commanded_in(self, window_s: float, to_s: float) -> OdometryWindow | None:
        """Return which way and turn were commanded in the seconds before a time."""
        sums = self.window(self.commands, window_s, min(to_s, self.commands.time_s))
        return None if sums is None else OdometryWindow(*sums)

    def commands_in(self, window_s: float, to_s: float) -> CommandedRange:
        """Return between which velocities the commands were, in the seconds before a time."""
        found: list[Velocity] = []
        for since_s, at_least, velocity in reversed(self._velocities):
            if since_s < to_s:
                found += (at_least, velocity)
            if since_s <= to_s - window_s:
                break
        travel = [each.travel_mps for each in found] or [0.0]
        rotate = [each.rotate_radps for each in found] or [0.0]
        return CommandedRange(min(travel), max(travel), min(rotate), max(rotate))

    def wheels_in(self, window_s: float, to_s: float) -> WheelSums | None:
        """Return what the wheels turned in the seconds before a time."""
        if self.wheels is None:
            return None
        sums = self.window(self.wheels.sums, window_s, to_s)
        return None if sums is None else WheelSums(*sums)

    def inertia_in(self, window_s: float, to_s: float) -> InertialSums | None:
        """Return what the inertial sensors felt in the seconds before a time, less their bias."""
        if self.inertia is None:
            return None
        sums = self.window(self.inertia.sums, window_s, to_s)
        if sums is None:
            return None
        turn_rad, gained_mps, force_mps = sums
        return InertialSums(turn_rad - self.inertia.bias_radps * window_s, gained_mps, force_mps)

    @property
    def _travel_mps(self) -> float:
        """How fast the rover goes ahead, by its wheels, or by its odometry."""
        if self.wheels is not None:
            return self.wheels.travel_mps
        return 0.0 if self.odometry is None else self.odometry.velocity.travel_mps

    def _resting(self, time_s: float) -> bool:
        """Whether nothing but to stand is commanded, and the wheels stand, for a while."""
        if self.standing_since_s > time_s - REST_S:
            return False
        if self.wheels is None:
            return True
        turned = self.wheels_in(REST_S, self.wheels.sums.time_s)
        most_m = REST_RADPS * self.wheels.settings.wheel_radius_m * REST_S
        return turned is not None and max(abs(turned.left_m), abs(turned.right_m)) <= most_m

    def _time_s(self, fact: Odometry | Joints | Imu | SecondOdometry, now_s: float) -> float:
        return self._stamps.time_s(type(fact), fact.stamp_s, now_s, self._clock.utc_s())

    def _sighting(self, fact: SecondOdometry, time_s: float) -> SecondOdometrySample | None:
        if not (self._track.covers(time_s) and self.moved.covers(time_s)):
            return None
        x_m, y_m, heading_rad = self._track.at(time_s)
        moved = OdometryWindow(*self.moved.at(time_s))
        believed = Pose(x_m, y_m, heading_rad=heading_rad)
        return SecondOdometrySample(time_s, fact.pose, believed, moved.driven_m, moved.turned_rad)

    def _observe_odometry(self, fact: Odometry, now_s: float) -> None:
        if not (fact.pose.finite and fact.velocity.finite):
            self.not_finite_at_s = now_s
            return
        time_s = self._time_s(fact, now_s)
        count, age_s = self.arrivals.sums
        self.arrivals.add(now_s, (count + 1, age_s + max(now_s - time_s, 0.0)))
        if self.odometry is not None:
            self._step(self.odometry, fact, time_s, now_s)
            if (fact.pose, fact.velocity) != (self.odometry.pose, self.odometry.velocity):
                self.unchanged_since_s = now_s
        else:
            self.moved.add(time_s, self.moved.sums)
        pose, heading_rad = fact.pose, self._track.sums[2]
        heading_rad += wrap_rad(pose.heading_rad - heading_rad)
        self._track.add(time_s, (pose.x_m, pose.y_m, heading_rad))
        if self.odometry is None or fact.stamp_s != self.odometry.stamp_s:
            self.odometry_late_s = now_s - time_s
        if self.over_ground is not None:
            self.over_ground.roll(fact.velocity, time_s)
        self.odometry, self.odometry_time_s, self.odometry_at_s = fact, time_s, now_s

    def _step(self, before: Odometry, after: Odometry, time_s: float, now_s: float) -> None:
        step_s = time_s - self.moved.time_s
        travel_mps = (before.velocity.travel_mps + after.velocity.travel_mps) / 2
        rotate_radps = (before.velocity.rotate_radps + after.velocity.rotate_radps) / 2
        way_m, turn_rad = travel_mps * step_s, rotate_radps * step_s
        ahead_m, left_m, turned_rad = step_between(before.pose, after.pose)
        level = cos(after.pose.pitch_rad)
        if step_s > 0.0:
            steps = (
                way_m,
                turn_rad,
                abs(way_m),
                abs(turn_rad),
                _beyond(
                    ahead_m,
                    before.velocity.travel_mps * step_s * level,
                    after.velocity.travel_mps * step_s * level,
                ),
                left_m,
                _beyond(
                    turned_rad,
                    before.velocity.rotate_radps * step_s,
                    after.velocity.rotate_radps * step_s,
                ),
                hypot(ahead_m, left_m),
                ahead_m,
                turned_rad,
            )
            sums = [old + step for old, step in zip(self.moved.sums, steps, strict=True)]
            self.moved.add(time_s, sums)
        since_s = now_s - self.odometry_at_s
        if since_s <= self._faults.odometry_stale.bound:
            self.jump = self._unexplained(before, after, since_s) or self.jump

    def _unexplained(self, before: Odometry, after: Odometry, since_s: float) -> PoseJump | None:
        """Return the step between two messages, if it is longer than their speeds explain."""
        first, second = before.velocity, after.velocity
        found = PoseJump(
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


def _beyond(step: float, one: float, other: float) -> float:
    """Return what a step is beyond all between two, since a velocity changes between messages."""
    return step - max(min(step, max(one, other)), min(one, other))


def step_between(before: Pose, after: Pose) -> tuple[float, float, float]:
    """Return how far a pose moved ahead, to the left, and turned, seen along the mean heading."""
    turned_rad = wrap_rad(after.heading_rad - before.heading_rad)
    along_rad = before.heading_rad + turned_rad / 2
    dx_m, dy_m = after.x_m - before.x_m, after.y_m - before.y_m
    cosine, sine = cos(along_rad), sin(along_rad)
    return dx_m * cosine + dy_m * sine, dy_m * cosine - dx_m * sine, turned_rad
