"""`MotionHistory`: the last seconds of commands and sensor data, on one time base, for monitors.

Facts are placed in time by their stamps. Each source has a channel of running sums; the motion
between any two times is the difference of two look-ups.
"""

from collections import deque
from dataclasses import dataclass, replace
from math import cos, hypot, inf
from typing import Final, NamedTuple

from executive.safety.channel import GRID_S, SLOTS, Channel, StampClock
from executive.safety.gyro_heading import GyroHeading
from executive.safety.inertial_velocity import InertialVelocity
from executive.safety.other_drivers import Driver, OtherDrivers
from executive.safety.rate_wrap import RateWrap
from executive.safety.rest_track import RestTrack
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
from executive.safety.stamp_period import Gaps, OdometryPeriod
from executive.safety.surroundings import LaserSurroundings
from executive.safety.twist_delay import TwistDelay
from executive.settings import Settings, TurnSource
from executive.state import NavigationTrack, Rejections
from executive.values.clock import Clock
from executive.values.facts import (
    Battery,
    EmergencyStop,
    Fact,
    ForeignMuxInput,
    ForeignPublishers,
    Frame,
    Imu,
    Joints,
    LaserScan,
    Odometry,
    RejectedData,
    SecondOdometry,
)
from executive.values.geometry import STANDING, Pose, Velocity, step_between, wrap_rad

COMMAND_STALL_S: Final = 0.25
"""Maximum interval of commands: a base may stop by itself after 0.25 s without one."""
MAX_COMPARED_DELAY_S: Final = 0.3
"""Maximum delay of a twist that is compared with the velocity by inertial sensors: as long as their
correction takes. A recorded robot with the mean of 1 s would have slid by 5 m in 40 s."""
BURST_STEP_S: Final = 1e-4
"""Minimum time between two arrivals: the clock may not advance during a burst."""
SEEN_S: Final = 0.4
"""Minimum window of a second odometry to show standstill."""


class OdometryWindow(NamedTuple):
    """The motion by odometry in a window; commanded motion has the first four figures.

    Attributes:
        twist_travel_m, twist_turn_rad: integrals of its velocity.
        driven_m, turned_rad: the same without signs.
        pose_minus_twist_ahead_m, pose_minus_twist_left_m, pose_minus_twist_heading_rad: pose change
            minus the integrals of the velocity.
        pose_path_m: length of the path of its pose.
        pose_ahead_m: the same along its heading, signed.
        pose_rad: change of its heading.
        twist_level_m: integral of its speed along the ground.
    """

    twist_travel_m: float
    twist_turn_rad: float
    driven_m: float
    turned_rad: float
    pose_minus_twist_ahead_m: float = 0.0
    pose_minus_twist_left_m: float = 0.0
    pose_minus_twist_heading_rad: float = 0.0
    pose_path_m: float = 0.0
    pose_ahead_m: float = 0.0
    pose_rad: float = 0.0
    twist_level_m: float = 0.0


class CommandedRange(NamedTuple):
    """Minimum and maximum of the velocities commanded in a window."""

    travel_low_mps: float
    travel_high_mps: float
    rotate_low_radps: float
    rotate_high_radps: float


@dataclass(frozen=True, slots=True)
class PoseJump:
    """A step of the odometry pose beyond the bound for the speed of the rover.

    Attributes:
        at_s: time of arrival.
    """

    at_s: float
    step_m: float
    bound_m: float
    turn_rad: float
    bound_rad: float


class MotionHistory:
    """The recent commands and sensor data.

    Attributes:
        odometry: the newest finite one, and `odometry_time_s`, when it was measured.
        odometry_late_s: its age at its first arrival.
        period: its period.
        poses: its last poses, as corrected.
        gaps: its gaps.
        twist: the delay of its twist.
        by_gyro: the pose with the heading of the gyro; None if that of the odometry is used.
        turn_scale: turn by the odometry per turn of the rover.
        moved: the channel of the odometry, by its stamps.
        arrivals: number of odometry messages and the sum of their ages, by arrival.
        commands: the channel of the commands.
        standing_since_s: since when zero velocity is commanded; infinite while it is not. Begins
            at the start: an earlier executive may have left the rover moving.
        motion_since_s: start of the motion in execution; infinite without one.
        unchanged_since_s: since when the odometry is identical to the last bit.
        frame_time_s: exposure time of the newest camera frame; None if its clock is unknown.
        foreign_publishers: other publishers that may move the rover.
        other_drivers: publishers of received velocities.
        lower_may_drive: whether inputs below the executive's may drive the rover while it is idle.
        begun_s: start of the evidence; no window extends before it.
        jump: the last pose jump of the odometry.
        battery: the newest valid voltage, and `battery_at_s`, when it arrived.
        invalid_v: a later voltage that is invalid.
        emergency_stop: whether the robot's own emergency stop is active; None until it is reported.
        charge_ratio: the newest charge, if one is reported.
        wheels, inertia, second: of the sensors that the asset has; else None.
        mass_kg: of the asset, if known.
        pose: estimated pose of the rover, in the frame of commands.
        surroundings: the obstacles around it.
        start_s: time of the start.
        rejections: the sources with rejected data.
    """

    def __init__(self, clock: Clock, settings: Settings) -> None:
        self._clock = clock
        self._faults = settings.faults
        self.mass_kg = settings.mass_kg
        self.start_s = clock.now_s()
        imu, slip = settings.sensors.imu, settings.mpc.measured_slip
        joints, second = settings.sensors.joints, settings.sensors.second_odometry
        self.inertia = None if imu is None else ImuHistory(slip)
        self._over_ground = None if imu is None else InertialVelocity(slip)
        self.wheels = None if joints is None else WheelHistory(joints)
        self.second = None if second is None else SecondOdometryTrack(second)
        self.by_gyro: GyroHeading | None = None
        if settings.odometry.turn is TurnSource.GYRO and self.inertia is not None:
            self.by_gyro = GyroHeading(self.inertia)
        self.turn_scale = settings.odometry.turn_scale
        self._track = Channel(3)
        self._stamps = StampClock()
        self.poses = RestTrack()
        self.gaps = Gaps()
        self.twist = TwistDelay(settings.odometry.twist_mean_s)
        self._rate_wrap = RateWrap()
        self.period = OdometryPeriod(settings.odometry.rate_hz)
        self.odometry: Odometry | None = None
        self.odometry_time_s = -inf
        self.odometry_at_s = -inf
        self.odometry_late_s = 0.0
        self.not_finite_at_s = -inf
        self.unchanged_since_s = -inf
        self.frame_time_s: float | None = None
        self.foreign_publishers: tuple[str, ...] = ()
        self.moved = Channel(len(OdometryWindow._fields))
        self.arrivals = Channel(2)
        self.commands = Channel(4)
        self._velocities: deque[tuple[float, Velocity, Velocity]] = deque()
        self._velocities.append((-inf, STANDING, STANDING))
        self.standing_since_s = clock.now_s()
        self.motion_since_s = inf
        self.begun_s = -inf
        self._rest_known = (-inf, -inf)
        self._wheels_rest = False
        self.jump: PoseJump | None = None
        self.emergency_stop: bool | None = None
        self.battery: Battery | None = None
        self.battery_at_s = -inf
        self.other_drivers = OtherDrivers()
        self.lower_may_drive = settings.mux is None or settings.mux.lower_may_drive
        self.navigation: NavigationTrack | None = None
        self.rejections = Rejections(clock)
        self.pose = Pose()
        self.surroundings = LaserSurroundings(settings)
        self.invalid_v: float | None = None
        self.charge_ratio: float | None = None

    def observe(self, fact: Fact) -> None:
        """Add a fact."""
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
                time_s = self._time_s(fact, now_s)
                self.wheels.observe(fact, time_s, now_s - time_s)
            case Imu() if self.inertia is not None:
                time_s = self._time_s(fact, now_s)
                self.inertia.observe(fact, time_s, self._travel_mps, self._resting(time_s))
                if self.over_ground is not None:
                    resting = self.standing_since_s <= time_s - REST_S
                    self.over_ground.feel(fact, time_s, resting, lost=self.inertia.lost)
            case SecondOdometry() if self.second is not None:
                sighting = self._sighting(fact, self._time_s(fact, now_s))
                self.second.observe(fact, sighting, now_s)
                seen = self.second.disagreement(SEEN_S, self.standing_since_s)
                if self.over_ground is not None and seen is not None and seen.is_standing:
                    self.over_ground.reset_at_rest(seen.to_s)
            case EmergencyStop(active):
                self.emergency_stop = active
            case ForeignMuxInput():
                if self._by_navigation:  # its input has the lowest priority
                    fact = replace(fact, overrides=True)
                self.other_drivers.observe(fact, now_s)
                if fact.overrides or (self.lower_may_drive and not self.commanding):
                    self.begun_s = now_s
                    self.standing_since_s = max(self.standing_since_s, now_s)
            case RejectedData():
                self.rejections.observe(fact)
            case LaserScan():
                self.surroundings.add_scan(fact, now_s)
            case Frame(stamp_s):
                self.frame_time_s = self._stamps.sparse_time_s(
                    Odometry, stamp_s, now_s, self._clock.utc_s()
                )
            case ForeignPublishers(names):
                self.foreign_publishers = names
            case _:
                pass

    @property
    def over_ground(self) -> InertialVelocity | None:
        """The velocity by the inertial sensors; None without them, and if the twist is too late."""
        return self._over_ground if self.twist.delay_s <= MAX_COMPARED_DELAY_S else None

    @property
    def drivers(self) -> list[Driver]:
        """The other publishers that command the base now."""
        return self.other_drivers.active(self._clock.now_s())

    @property
    def mux_inputs(self) -> tuple[ForeignMuxInput, ...]:
        """The mux inputs of these publishers."""
        return tuple(each.input for each in self.drivers)

    def command(self, velocity: Velocity, at_least: Velocity | None = None) -> None:
        """Record the commanded velocity.

        After a gap longer than `COMMAND_STALL_S` the history restarts.

        Args:
            velocity: of the rover; zero for standstill.
            at_least: while the rover accelerates or brakes on its own, the other bound of its
                expected velocity. Infinite bounds if the command is unknown.
        """
        now_s = self._clock.now_s()
        if now_s - self.commands.time_s > COMMAND_STALL_S or velocity.travel_mps == inf:
            self.commands = Channel(4)
        channel = self.commands
        _, least, last = self._velocities[-1]
        last = last if least == last else STANDING
        at_least = velocity if at_least is None else at_least
        if now_s > channel.time_s:  # it is called twice a tick
            since_s = now_s - channel.time_s if channel.time_s > -inf else 0.0
            distance_m, turn_rad = last.travel_mps * since_s, last.rotate_radps * since_s
            steps = (distance_m, turn_rad, abs(distance_m), abs(turn_rad))
            channel.add(now_s, [old + step for old, step in zip(channel.sums, steps, strict=True)])
        if self._velocities[-1] != (now_s, at_least, velocity):
            self._velocities.append((now_s, at_least, velocity))
        while self._velocities[1][0] <= now_s - GRID_S * SLOTS:
            self._velocities.popleft()
        if velocity != STANDING:
            self.standing_since_s = inf
        elif self.standing_since_s == inf:
            self.standing_since_s = now_s

    @property
    def _by_navigation(self) -> bool:
        """Whether the navigation drives the base by its input of the mux."""
        return self._velocities[-1][2].travel_mps == inf

    @property
    def total_motion(self) -> tuple[float, float]:
        """The signed distance and turn by odometry since its first message."""
        moved = OdometryWindow(*self.moved.sums)
        return moved.pose_ahead_m, moved.pose_rad

    @property
    def fastest_velocity(self) -> Velocity:
        """The commanded or the measured velocity, if that is higher; zero once zero is commanded.

        While the rover accelerates or brakes on its own, the measured one.
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

    def corrected(self, fact: Odometry) -> Odometry:
        """Return the newest odometry, with the heading that the asset chooses."""
        return fact if self.by_gyro is None else self.by_gyro.newest or fact

    def reset_reference(self) -> None:
        """Accept the present odometry as the new reference and discard earlier evidence."""
        self.jump = None
        self.begun_s = self._clock.now_s()

    @property
    def commanding(self) -> bool:
        """Whether a velocity other than zero is commanded."""
        return self.standing_since_s == inf

    @property
    def start_pending(self) -> bool:
        """Whether a motion in execution has not moved the rover yet."""
        return self.standing_since_s <= self.motion_since_s < inf

    def window(self, channel: Channel, window_s: float, to_s: float) -> list[float] | None:
        """Return the increase of a channel in the seconds before a time; None if it is unknown."""
        from_s = to_s - window_s
        return None if from_s < self.begun_s else channel.increase_between(from_s, to_s)

    def recent(self, channel: Channel, window_s: float, to_s: float) -> list[float] | None:
        """Return the same for the known part of the seconds before a time."""
        from_s = max(to_s - window_s, self.begun_s, channel.first_s)
        return None if from_s >= to_s else channel.increase_between(from_s, to_s)

    def odometry_in(self, window_s: float, to_s: float) -> OdometryWindow | None:
        """Return the motion by odometry in the seconds before a time."""
        sums = self.window(self.moved, window_s, to_s)
        return None if sums is None else OdometryWindow(*sums)

    def commanded_in(self, window_s: float, to_s: float) -> OdometryWindow | None:
        """Return the commanded distance and turn in the seconds before a time."""
        sums = self.window(self.commands, window_s, min(to_s, self.commands.time_s))
        return None if sums is None else OdometryWindow(*sums)

    def commands_in(self, window_s: float, to_s: float) -> CommandedRange:
        """Return the range of the commands in force in the seconds before a time.

        Includes standstill, where a base may have stopped by itself without a new command.
        """
        found: list[Velocity] = []
        until_s = min(to_s, self._clock.now_s())
        for since_s, at_least, velocity in reversed(self._velocities):
            if since_s < to_s:
                found += (at_least, velocity)
                if until_s - since_s > COMMAND_STALL_S:
                    found.append(STANDING)
            until_s = min(until_s, since_s)
            if since_s <= to_s - window_s:
                break
        travel = [each.travel_mps for each in found] or [0.0]
        rotate = [each.rotate_radps for each in found] or [0.0]
        return CommandedRange(min(travel), max(travel), min(rotate), max(rotate))

    def wheels_in(self, window_s: float, to_s: float) -> WheelSums | None:
        """Return the distances and torques of the wheels in the seconds before a time."""
        if self.wheels is None:
            return None
        sums = self.window(self.wheels.sums, window_s, to_s)
        return None if sums is None else WheelSums(*sums)

    def inertia_in(self, window_s: float, to_s: float) -> InertialSums | None:
        """Return the inertial measurements in the seconds before a time, minus their bias."""
        if self.inertia is None:
            return None
        sums = self.window(self.inertia.sums, window_s, to_s)
        if sums is None:
            return None
        turn_rad, gained_mps, force_mps = sums
        return InertialSums(turn_rad - self.inertia.bias_radps * window_s, gained_mps, force_mps)

    @property
    def _travel_mps(self) -> float:
        """The speed ahead, by wheels if present, else by odometry."""
        if self.wheels is not None:
            return self.wheels.travel_mps
        return 0.0 if self.odometry is None else self.odometry.velocity.travel_mps

    def _resting(self, time_s: float) -> bool:
        """Whether zero velocity is commanded and the wheels are stationary, for `REST_S`."""
        if self.standing_since_s > time_s - REST_S:
            return False
        if self.wheels is None:
            return True
        known = self.wheels.sums.time_s, self.begun_s
        if self._rest_known != known:  # inertial measurements are more frequent
            turned = self.wheels_in(REST_S, self.wheels.sums.time_s)
            max_m = REST_RADPS * self.wheels.settings.wheel_radius_m * REST_S
            self._rest_known = known
            self._wheels_rest = (
                turned is not None and max(abs(turned.left_m), abs(turned.right_m)) <= max_m
            )
        return self._wheels_rest

    def _time_s(self, fact: Odometry | Joints | Imu | SecondOdometry, now_s: float) -> float:
        return self._stamps.time_s(type(fact), fact.stamp_s, now_s, self._clock.utc_s())

    def _sighting(self, fact: SecondOdometry, time_s: float) -> SecondOdometrySample | None:
        if not (self._track.covers(time_s) and self.moved.covers(time_s)):
            return None
        x_m, y_m, heading_rad = self._track.sums_at(time_s)
        moved = OdometryWindow(*self.moved.sums_at(time_s))
        corrected = Pose(x_m, y_m, heading_rad=heading_rad)
        return SecondOdometrySample(time_s, fact.pose, corrected, moved.driven_m, moved.turned_rad)

    def _observe_odometry(self, fact: Odometry, now_s: float) -> None:
        if not (fact.pose.finite and fact.velocity.finite):
            self.not_finite_at_s = now_s
            return
        time_s = self._time_s(fact, now_s)
        count, age_s = self.arrivals.sums
        at_s = max(now_s, self.arrivals.time_s + BURST_STEP_S)
        self.arrivals.add(at_s, (count + 1, age_s + max(now_s - time_s, 0.0)))
        if self.odometry is not None:
            step_s = time_s - self.moved.time_s
            fact = self._rate_wrap.corrected(self.odometry, fact, step_s)
            self._step(self.odometry, fact, time_s, now_s)
            if (fact.pose, fact.velocity) != (self.odometry.pose, self.odometry.velocity):
                self.unchanged_since_s = now_s
        else:
            self.moved.add(time_s, self.moved.sums)
        if self.by_gyro is not None:
            self.by_gyro.observe(fact, time_s)
        corrected = self.corrected(fact)
        pose, heading_rad = corrected.pose, self._track.sums[2]
        heading_rad += wrap_rad(pose.heading_rad - heading_rad)
        self._track.add(time_s, (pose.x_m, pose.y_m, heading_rad))
        self.poses.observe(time_s, pose.point, heading_rad)
        if self.odometry is None or fact.stamp_s != self.odometry.stamp_s:
            self.odometry_late_s = now_s - time_s
        if self.over_ground is not None:
            self.over_ground.roll(corrected.velocity, time_s)
        self.odometry, self.odometry_time_s, self.odometry_at_s = fact, time_s, now_s

    def _step(self, before: Odometry, after: Odometry, time_s: float, now_s: float) -> None:
        step_s = time_s - self.moved.time_s
        travel_mps = (before.velocity.travel_mps + after.velocity.travel_mps) / 2
        rotate_radps = (before.velocity.rotate_radps + after.velocity.rotate_radps) / 2
        distance_m, turn_rad = travel_mps * step_s, rotate_radps * step_s
        ahead_m, left_m, turned_rad = step_between(before.pose, after.pose)
        level = cos(after.pose.pitch_rad)
        self.period.observe(step_s, may_lengthen=not self.commanding)
        fastest_mps = max(abs(before.velocity.travel_mps), abs(after.velocity.travel_mps))
        fastest_radps = max(abs(before.velocity.rotate_radps), abs(after.velocity.rotate_radps))
        self.gaps.observe(time_s, self.period.gap_s(step_s), fastest_mps, fastest_radps)
        if step_s > 0.0:
            steps = (
                distance_m,
                turn_rad,
                abs(distance_m),
                abs(turn_rad),
                _excess(
                    ahead_m,
                    before.velocity.travel_mps * step_s * level,
                    after.velocity.travel_mps * step_s * level,
                ),
                left_m,
                _excess(
                    turned_rad,
                    before.velocity.rotate_radps * step_s,
                    after.velocity.rotate_radps * step_s,
                ),
                hypot(ahead_m, left_m),
                ahead_m,
                turned_rad,
                distance_m * level,
            )
            sums = [old + step for old, step in zip(self.moved.sums, steps, strict=True)]
            self.moved.add(time_s, sums)
            total_m, total_rad = self.total_motion
            self.twist.observe(time_s, total_m, total_rad, after.velocity, self.period.period_s)
        since_s = now_s - self.odometry_at_s
        stale_s = self.period.stale_s(self._faults.odometry_stale.bound)
        if since_s <= stale_s:  # messages that arrive in a burst are as far apart as their stamps
            since_s = max(since_s, min(step_s, stale_s))
            self.jump = self._pose_jump(before, after, since_s) or self.jump

    def _pose_jump(self, before: Odometry, after: Odometry, since_s: float) -> PoseJump | None:
        """Return the step between two messages, if it exceeds the bound for their speeds."""
        first, second = before.velocity, after.velocity
        step_m = hypot(after.pose.x_m - before.pose.x_m, after.pose.y_m - before.pose.y_m)
        turn_rad = abs(wrap_rad(after.pose.heading_rad - before.pose.heading_rad))
        speed_mps = max(abs(first.travel_mps), abs(second.travel_mps))
        rate_radps = max(abs(first.rotate_radps), abs(second.rotate_radps))
        bound_m = self._faults.odometry_jumped.bound + since_s * speed_mps
        bound_rad = self._faults.odometry_heading_jumped.bound + since_s * rate_radps
        if step_m <= bound_m and turn_rad <= bound_rad:
            return None
        return PoseJump(self._clock.now_s(), step_m, bound_m, turn_rad, bound_rad)


def _excess(step: float, one: float, other: float) -> float:
    """Return the excess of a step over the range of two: velocity changes between messages."""
    return step - max(min(step, max(one, other)), min(one, other))
