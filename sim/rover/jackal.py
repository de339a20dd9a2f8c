"""`SimulatedJackal`, in place of a real one, behind the port `NavigationRover`.

It has no navigation: goals are answered as without a server. Its base has limits and a timeout; its
odometry is dead reckoning: encoder speed, gyro rate.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import copysign, cos, inf, isfinite, sin, sqrt
from typing import Final
from zlib import crc32

import numpy as np

from executive.settings import MuxEntry, MuxSettings, Sensors
from executive.values.facts import (
    VELOCITY_TOPIC,
    Battery,
    ForeignMuxInput,
    NavigationState,
    NavigationStatus,
    Odometry,
    PlannedPath,
)
from executive.values.geometry import STANDING, Pose, Velocity, wrap_rad
from executive.values.ports import CameraIntent, NavigationGoal, PathRequest
from sim.checkpoint import Checkpointed, changing
from sim.pan_tilt import HeadController
from sim.rover import faults
from sim.rover.body import (
    PERIOD_S,
    SOON_S,
    STEPS_PER_PERIOD,
    BatteryPack,
    SimulatedBody,
    offset_left,
)
from sim.rover.camera import PictureSettings
from sim.rover.faults import SimulatedFault, jackal_fault_targets
from sim.rover.instruments import NormalRows
from sim.rover.model import JACKAL
from sim.rover.sensors import SensorSuite
from sim.rover.world import World

TRACK_M: Final = 0.37559
WHEEL_RADIUS_M: Final = 0.098
TRACK_MULTIPLIER: Final = 1.5
"""Skid steering rotates less than its track predicts; Clearpath multiplies commands by this."""

_BASE_MPS: Final = 2.0
_BASE_MPS2: Final = 20.0
_BASE_RADPS: Final = 4.0
_BASE_RADPS2: Final = 25.0
_BASE_TIMEOUT_S: Final = 0.25
"""Limits of the base itself (control.yaml of the Jackal)."""


def _approach(now: float, target: float, bound: float, step: float) -> float:
    target = max(-bound, min(bound, target))
    return max(now - step, min(now + step, target))


class BaseController(Checkpointed):
    """Turns the newest velocity command into wheel speeds, at 50 Hz."""

    CHANGES = changing(
        _command=Velocity, _commanded_s=float, _travel_mps=float, _rotate_radps=float
    )

    def __init__(self) -> None:
        self._command = STANDING
        self._commanded_s = float("-inf")
        self._travel_mps = 0.0
        self._rotate_radps = 0.0

    def command(self, velocity: Velocity, now_s: float) -> None:
        """Set the velocity command; it is valid until the next one or the timeout."""
        self._command = velocity
        self._commanded_s = now_s

    def follow(self, velocity: Velocity) -> None:
        """Set the velocity that the base has reached."""
        self._travel_mps, self._rotate_radps = velocity.travel_mps, velocity.rotate_radps

    def wheels_radps(self, now_s: float, period_s: float) -> tuple[float, float]:
        """Return the speeds of left and right wheels for the next period."""
        live = now_s - self._commanded_s <= _BASE_TIMEOUT_S
        wanted = self._command if live else STANDING
        self._travel_mps = _approach(
            self._travel_mps, wanted.travel_mps, _BASE_MPS, _BASE_MPS2 * period_s
        )
        self._rotate_radps = _approach(
            self._rotate_radps, wanted.rotate_radps, _BASE_RADPS, _BASE_RADPS2 * period_s
        )
        across_mps = self._rotate_radps * TRACK_MULTIPLIER * TRACK_M / 2
        return (
            (self._travel_mps - across_mps) / WHEEL_RADIUS_M,
            (self._travel_mps + across_mps) / WHEEL_RADIUS_M,
        )


_REST_MPS: Final = 0.005
_REST_RADPS: Final = 0.01
"""Speed of a wheel and gyro rate of a rover at rest: five times the noise of the gyro."""
_REST_S: Final = 0.5
"""Time at rest after which the heading is held."""


@dataclass(frozen=True, slots=True)
class SimulatedOdometry:
    """Accuracy of the sensors, and compensation of side slip.

    Attributes:
        slip_offset_m: c0 of the side-slip law v_y = -(c0 + c1 sign(v) sqrt|v w|) w.
        slip_gain: c1 of the law, in m / sqrt(m/s rad/s); both 0 switch the correction off.
        encoder_noise_mps: standard deviation of one encoder speed.
        encoder_scale: standard deviation of the error of the wheel radius, as a ratio.
        gyro_noise_radps: standard deviation of one gyro rate.
        gyro_scale: standard deviation of the error of the gyro's gain, as a ratio.
        gyro_bias_radps: standard deviation of the constant error of the gyro.
        tilt_noise_rad: standard deviation of one roll or pitch.
    """

    slip_offset_m: float = 0.044
    slip_gain: float = 0.065
    encoder_noise_mps: float = 0.005
    encoder_scale: float = 0.0007
    gyro_noise_radps: float = 0.002
    gyro_scale: float = 0.0004
    gyro_bias_radps: float = 0.00015
    tilt_noise_rad: float = 0.001


class WheelOdometry(Checkpointed):
    """Dead reckoning from a start pose, with the errors of real sensors.

    While wheels and gyro are at rest, the heading is held: the constant error of the gyro would
    turn it. Slower turns on standing wheels are lost.
    """

    CHANGES = changing(_draws=Checkpointed, _rest_s=float, pose=Pose)

    def __init__(
        self, settings: SimulatedOdometry, start: Pose, random: np.random.Generator
    ) -> None:
        self._settings = settings
        scale, gain, bias = random.standard_normal(3).tolist()
        self._scale = 1 + settings.encoder_scale * scale
        self._gain = 1 + settings.gyro_scale * gain
        self._bias_radps = settings.gyro_bias_radps * bias
        self._draws = NormalRows(random, 4)
        self._rest_s = 0.0
        self.pose = start

    def advance(
        self,
        stamp_s: float,
        period_s: float,
        wheels_mps: Sequence[float],
        gyro_radps: float,
        lean: Pose,
    ) -> Odometry:
        """Integrate one period and return the odometry published for its end."""
        settings = self._settings
        encoder_mps = sum(wheels_mps) / len(wheels_mps)
        first, second, third, fourth = next(self._draws)
        travel_mps = encoder_mps * self._scale + settings.encoder_noise_mps * first
        rotate_radps = (
            gyro_radps * self._gain + self._bias_radps + settings.gyro_noise_radps * second
        )
        roll_rad = lean.roll_rad + settings.tilt_noise_rad * third
        pitch_rad = lean.pitch_rad + settings.tilt_noise_rad * fourth
        slip_m = settings.slip_offset_m + settings.slip_gain * copysign(
            sqrt(abs(encoder_mps * gyro_radps)), encoder_mps
        )
        resting = abs(rotate_radps) < _REST_RADPS and max(map(abs, wheels_mps)) < _REST_MPS
        self._rest_s = self._rest_s + period_s if resting else 0.0
        turn_rad = 0.0 if self._rest_s > _REST_S else rotate_radps * period_s
        ahead_m = travel_mps * cos(pitch_rad) * period_s
        left_m = -slip_m * turn_rad
        before = self.pose
        midway_rad = before.heading_rad + turn_rad / 2
        self.pose = Pose(
            before.x_m + ahead_m * cos(midway_rad) - left_m * sin(midway_rad),
            before.y_m + ahead_m * sin(midway_rad) + left_m * cos(midway_rad),
            before.z_m - travel_mps * sin(pitch_rad) * period_s,
            wrap_rad(before.heading_rad + turn_rad),
            roll_rad,
            pitch_rad,
        )
        return Odometry(stamp_s, self.pose, Velocity(travel_mps, rotate_radps))


FOREIGN_INPUT: Final = "another"
FOREIGN_INPUT_TIMEOUT_S: Final = 0.5
"""Timeout of an input that the executive does not know."""
_ANGLES_EVERY = 5
_BATTERY_EVERY = 50
_STALL_EVERY_S = 4.0
_MIN_STALL_RATIO = 0.28
"""Minimum stall as a ratio of the maximum: 50 ms of 180."""


class SimulatedJackal(SimulatedBody):
    """A Jackal in a world. The odometry frame is the world's frame.

    Attributes:
        odometry: the odometry before its latency and faults.
    """

    CHANGES = changing(
        SimulatedBody,
        odometry=Checkpointed,
        _base=Checkpointed,
        _mux=Checkpointed,
        _servos=Checkpointed,
        _in_transit=deque[tuple[float, Odometry]],
        _delays=np.random.Generator,
        _published=Odometry | None,
        _other_command_s=float,
        _other_input=str | None,
        _suite=Checkpointed,
    )

    def __init__(
        self,
        world: World,
        seed: int = 0,
        odometry: SimulatedOdometry | None = None,
        picture: PictureSettings | None = None,
        sensors: Sensors | None = None,
        mux: MuxSettings | None = None,
    ) -> None:
        """Put the rover on the ground at the world's start and let it settle.

        Args:
            world: its world.
            seed: seed of all sensor noise; the same seed and calls repeat bit for bit.
            odometry: accuracy of the odometry.
            picture: size and backend of camera pictures.
            sensors: its sensors other than odometry; none unless given.
            mux: mux of the base; None accepts every velocity.
        """
        sensors = sensors or Sensors()
        super().__init__(JACKAL, BatteryPack(), world, picture, jackal_fault_targets(sensors))
        random = np.random.default_rng(seed)
        self.odometry = WheelOdometry(odometry or SimulatedOdometry(), self._pose, random)
        self._base = BaseController()
        self._mux = None if mux is None else Mux(mux)
        self._servos = HeadController()
        self._in_transit: deque[tuple[float, Odometry]] = deque()
        self._delays = np.random.default_rng([seed, crc32(b"odometry_jitter")])
        self._published: Odometry | None = None
        self._other_command_s = 0.0
        self._suite = SensorSuite(sensors, seed, self)
        self._read_every, self._read_sensors = self._suite.every, self._suite.read
        self._other_input: str | None = None
        self._actuate()

    def drive(self, velocity: Velocity) -> None:
        """Command a velocity, as cmd_vel does; it times out after 0.25 s.

        Raises:
            ValueError: if a figure is not finite.
        """
        if faults.CmdVelLost not in self._faults:
            self.mux_command(None if self._mux is None else self._mux.settings.input, velocity)

    def mux_command(self, name: str | None, velocity: Velocity) -> None:
        """Process a velocity of an input of the mux; None without a mux.

        Raises:
            ValueError: if a figure is not finite.
        """
        if not velocity.finite:
            raise ValueError(f"{velocity} is no velocity")
        if name is None or self._mux is None or self._mux.passes(name, self.time_s):
            self._base.command(velocity, self.time_s)

    def mux_lock(self, name: str, locked: bool) -> None:
        """Process a message of a lock of the mux."""
        if self._mux is not None:
            self._mux.lock(name, locked, self.time_s)

    def lock(self, held: bool) -> None:
        """Hold the executive's lock of the mux, with zero on its input for stops, or release it."""
        if self._mux is None:
            return
        settings = self._mux.settings
        if held and settings.stop is not None:
            self.mux_command(settings.stop, STANDING)
        self.mux_lock(settings.lock, held)

    def emergency_stop(self) -> None:
        """Command zero velocity, and hold the lock."""
        self.drive(STANDING)
        self.lock(True)

    def navigate(self, goal: NavigationGoal) -> None:
        """Report that there is no server."""
        self._due.append(NavigationStatus(goal.number, NavigationState.UNAVAILABLE))

    def cancel_navigation(self) -> None:
        """Cancel nothing: there is no server."""

    def open_gate(self, is_open: bool) -> None:
        """Leave the gate shut: its lock is locked without messages."""

    def plan_path(self, request: PathRequest) -> None:
        """Report that there is no planner."""
        self._due.append(PlannedPath(request.number, (), "the simulation has no planner"))

    def point_camera(self, wanted: CameraIntent) -> None:
        """Command the camera's angles and maximum speed, limited to those of the head.

        Raises:
            ValueError: if a figure is not finite.
        """
        if not all(map(isfinite, (wanted.pan_rad, wanted.tilt_rad, wanted.speed_radps))):
            raise ValueError(f"{wanted} cannot be done")
        self._servos.set_speed(wanted.speed_radps)
        self._servos.point(wanted.pan_rad, wanted.tilt_rad)

    def skip(self, duration_s: float) -> None:
        """Let time pass; the last facts arrive at its end: of the battery, and the odometry."""
        super().skip(duration_s)
        self._suite.skip()
        self._report_battery()
        if self._published is not None:
            stamp_s = self._published.stamp_s + duration_s
            self._due.append(replace(self._published, stamp_s=stamp_s))
        self._in_transit = deque(
            (due_s + duration_s, replace(each, stamp_s=each.stamp_s + duration_s))
            for due_s, each in self._in_transit
        )

    def inject(self, fault: SimulatedFault) -> None:
        """Inject a fault."""
        super().inject(fault)
        match fault:
            case faults.OdometryJump(by_m):
                self.odometry.pose = offset_left(self.odometry.pose, by_m)
            case faults.CmdVelOverridden():
                self._other_command_s = self.time_s + PERIOD_S
                self._other_input = self._input_of(round(fault.priority))
            case _:
                pass

    def _sense(self, before: Pose, turned_rad: list[float]) -> None:
        """Read the sensors at the end of a period."""
        drift = self.fault(faults.OdometryDrift)
        if drift is not None:
            self.odometry.pose = offset_left(self.odometry.pose, drift.rate_mps * PERIOD_S)
        counted_rad = self.counted(turned_rad)
        self._publish_odometry(
            self.odometry.advance(
                self.time_s,
                PERIOD_S,
                [WHEEL_RADIUS_M * counted / PERIOD_S for counted in counted_rad],
                self._gyro_radps(wrap_rad(self._pose.heading_rad - before.heading_rad) / PERIOD_S),
                self._pose,
            )
        )
        period = self._steps // STEPS_PER_PERIOD
        if period % _ANGLES_EVERY == 1:
            self._due.append(self.camera_angles)
        if period % _BATTERY_EVERY == 1:
            self._report_battery()

    def _report_battery(self) -> None:
        voltage_v = self._voltage_v()
        if faults.BatterySilent not in self._faults:
            self._due.append(Battery(voltage_v, self._battery.charge_ratio))

    def _gyro_radps(self, true_radps: float) -> float:
        """Return the gyro's measurement of a rate, without its own noise."""
        gain, bias = self.fault(faults.GyroGain), self.fault(faults.GyroBias)
        if faults.GyroDead in self._faults:
            return 0.0
        if gain is not None:
            true_radps *= gain.factor
        return true_radps if bias is None else true_radps + bias.rate_radps

    def _publish_odometry(self, measured: Odometry) -> None:
        """Publish the odometry of the last period, or an earlier one, changed by the faults."""
        late = self.fault(faults.OdometryLate)
        delay_s = PERIOD_S if late is None else PERIOD_S + late.by_s
        self._in_transit.append((measured.stamp_s + self._jitter_s(), measured))
        while self._in_transit and self._in_transit[0][0] <= self.time_s - delay_s + SOON_S:
            _, arrived = self._in_transit.popleft()
            if faults.OdometryLost not in self._faults:
                self._published = self._distorted(arrived, self._published)
                self._due.append(self._published)

    def _jitter_s(self) -> float:
        """Return the additional delay of the next odometry."""
        jitter = self.fault(faults.OdometryJitter)
        if jitter is None:
            return 0.0
        wait_s = jitter.mean_s * float(self._delays.standard_exponential())
        max_s = max(jitter.stall_s, jitter.mean_s)
        if self._delays.random() < PERIOD_S / _STALL_EVERY_S:
            wait_s += jitter.stall_s * float(self._delays.uniform(_MIN_STALL_RATIO, 1.0))
        return min(wait_s, max_s)

    def _distorted(self, fact: Odometry, last: Odometry | None) -> Odometry:
        """Return the odometry published for a measurement."""
        if last is not None and faults.OdometryRepeated in self._faults:
            return last
        if last is not None and faults.OdometryFrozen in self._faults:
            return replace(last, stamp_s=fact.stamp_s)
        if faults.OdometryZeroTwist in self._faults:
            return replace(fact, velocity=STANDING)
        return fact

    def _input_of(self, priority: int) -> str | None:
        """Return the input of the mux with a priority; adds one if there is none."""
        if self._mux is None:
            return None
        for name, entry in self._mux.settings.topics.items():
            if entry.priority == priority:
                return name
        self._mux.add(FOREIGN_INPUT, MuxEntry(FOREIGN_INPUT, FOREIGN_INPUT_TIMEOUT_S, priority))
        return FOREIGN_INPUT

    def _report_mux_input(self, name: str | None) -> None:
        """Notify the executive, which subscribes to its topic and the mux's other inputs."""
        settings = None if self._mux is None else self._mux.settings
        if settings is None or name == settings.input:
            self._due.append(ForeignMuxInput(VELOCITY_TOPIC, overrides=True))
        elif name in settings.topics:
            own = settings.topics[settings.input]
            self._due.append(ForeignMuxInput(name, settings.topics[name].priority > own.priority))

    def _actuate(self) -> None:
        """Set the set points of motors and head for the next period."""
        other = self.fault(faults.CmdVelOverridden)
        if other is not None and self.time_s >= self._other_command_s - SOON_S:
            self._other_command_s += 1 / other.rate_hz
            self.mux_command(self._other_input, Velocity(other.travel_mps, other.rotate_radps))
            self._report_mux_input(self._other_input)
        left, right = self._unstuck(*self._base.wheels_radps(self.time_s, PERIOD_S))
        head_rad = self._head_rad(*self._servos.setpoints_rad(PERIOD_S))
        self._ctrl[:] = (left, right, left, right, *head_rad)


@dataclass(slots=True)
class _LastMessage:
    """An input or a lock, with the time of its last message; `locked` is for a lock."""

    entry: MuxEntry
    at_s: float = -inf
    locked: bool = False

    def expired(self, now_s: float) -> bool:
        return 0.0 < self.entry.timeout < now_s - self.at_s


class Mux(Checkpointed):
    """Selects the input that drives the base, as twist_mux does.

    An input is masked while its last message is older than its timeout, or while a lock of a higher
    priority is locked. A message is forwarded to the base if its input has the maximum priority of
    those that are not masked. An input without a timeout counts even without a message. A lock has
    the state of its last message, and is locked if that is older than its timeout. For a masked
    message no other one is published: the base stops by its own timeout.
    """

    CHANGES = changing(_inputs=dict[str, _LastMessage], _locks=dict[str, _LastMessage])

    def __init__(self, settings: MuxSettings) -> None:
        self.settings = settings
        self._inputs = {name: _LastMessage(entry) for name, entry in settings.topics.items()}
        self._locks = {name: _LastMessage(entry) for name, entry in settings.locks.items()}

    def add(self, name: str, entry: MuxEntry) -> None:
        """Add an input; it replaces one of that name."""
        self._inputs[name] = _LastMessage(entry)

    def passes(self, name: str, now_s: float) -> bool:
        """Process a velocity of an input; return whether it is forwarded to the base."""
        self._inputs[name].at_s = now_s
        bar = max(
            (
                lock.entry.priority
                for lock in self._locks.values()
                if lock.locked or lock.expired(now_s)
            ),
            default=0,
        )
        open_ = (each for each in self._inputs.values() if each.entry.priority >= bar)
        live = (each for each in open_ if not each.expired(now_s))
        first = max(live, key=lambda each: each.entry.priority, default=None)
        return first is self._inputs[name]

    def lock(self, name: str, locked: bool, now_s: float) -> None:
        """Process a message of a lock."""
        lock = self._locks[name]
        lock.locked, lock.at_s = locked, now_s
