"""A rover without physics and all its sensors, which obeys velocities as far as a test lets it."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import cos, nan, sin
from random import Random

from executive.safety import Fault, FaultMonitor
from executive.settings import Settings, load_settings
from executive.values.clock import ManualClock
from executive.values.facts import Fact, Imu, Joints, Odometry, SecondOdometry
from executive.values.geometry import GRAVITY_MPS2, Pose, Velocity, wrap_rad
from tests.support.kinematic import KinematicRover

STEP_S = 0.01
SECOND_LATE_S = 0.4
BASE_TIMEOUT_S = 0.25
MAX_STEPS = 4
"""Of a base that is behind, at once."""


@dataclass
class SensedDrive:
    """Drives on simulated time, and has its monitors look at it 20 times a second.

    Attributes:
        left, right: how much of its command a side makes of it.
        grip: how much of the wheels' speed moves the rover.
        odometry_travel, odometry_turn, gyro: how much of the truth each tells.
        gyro_bias_radps, odometry_bias_radps: what the gyro adds, and the odometry.
        torque_nm: of each wheel that is off its command; and what it takes to accelerate.
        held_n: a force that holds the rover back.
        roll_rad, pitch_rad: how the ground leans.
        second_in_odometry: where the second odometry has its origin.
        clock_off_s: by how much the sensors' clock is ahead of the core's.
        torques: whether the wheels tell of torques.
        oriented: whether the IMU measures its orientation.
        lost: kinds of facts that do not arrive.
        aside_mps: by how much the rover slides to the left.
        wheel_noise_radps: standard deviation of one speed of a wheel.
        stalled: whether the executive is: no tick, and facts wait; the base stops after 0.25 s.
        base_stalled: whether the base is, with its sensors; later it catches up.
    """

    settings: Settings
    left: float = 1.0
    right: float = 1.0
    grip: float = 1.0
    odometry_travel: float = 1.0
    odometry_turn: float = 1.0
    gyro: float = 1.0
    gyro_bias_radps: float = 0.0
    torque_nm: float = 3.0
    held_n: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    second_in_odometry: Pose = field(default_factory=Pose)
    clock_off_s: float = 0.0
    torques: bool = True
    oriented: bool = True
    lost: set[type] = field(default_factory=set)
    aside_mps: float = 0.0
    odometry_bias_radps: float = 0.0
    wheel_noise_radps: float = 0.0
    stalled: bool = False
    base_stalled: bool = False

    def __post_init__(self) -> None:
        """Let it stand at the origin of its odometry."""
        self.clock = ManualClock()
        self.safety = FaultMonitor(self.clock, self.settings)
        self.observe: Callable[[Fact], None] = self.safety.observe
        joints = load_settings("jackal").sensors.joints
        assert joints is not None
        self._joints = joints
        self._random = Random(1)
        self.moving = True
        self.begun: list[Fault] = []
        self.over: list[Fault] = []
        self.wanted = Velocity()
        self.commanded = Velocity()
        self.true = self.believed = Pose()
        self._wheels = Velocity()
        self._moves = self._before = Velocity()
        self._active: deque[tuple[float, Fact]] = deque()
        self._steps = self._base_steps = 0

    @property
    def names(self) -> list[str]:
        """The faults that have begun, in their order."""
        return [fault.name for fault in self.begun]

    @property
    def motion(self) -> Velocity:
        """Its true velocity."""
        return self._moves

    def run(self, velocity: Velocity, duration_s: float) -> None:
        """Drive at a velocity for a while, within the accelerations of the arbiter."""
        self.wanted = velocity
        for _ in range(round(duration_s / STEP_S)):
            self._step()

    def _step(self) -> None:
        self.move_on()
        if self._steps % 5 == 0 and not self.stalled:
            self._tick()

    def move_on(self) -> None:
        """Obey what is commanded for a step, and sense it."""
        self._steps += 1
        self.clock.set(self._steps * STEP_S)
        behind = 0 if self.base_stalled else self._steps - self._base_steps
        for _ in range(min(behind, MAX_STEPS)):
            self._base_steps += 1
            self._move()
            self._sense()

    def _tick(self) -> None:
        changes = self.safety.check(self.moving)
        self.begun += changes.begun
        self.over += changes.ended
        self.commanded = Velocity(
            _toward(self.commanded.travel_mps, self.wanted.travel_mps, 0.05),
            _toward(self.commanded.rotate_radps, self.wanted.rotate_radps, 0.15),
        )
        self.safety.history.command(self.commanded)

    def _move(self) -> None:
        half_m = self._joints.track_m / 2
        commanded_s = self.safety.history.commands.time_s
        timed_out = self.stalled and self.clock.now_s() - commanded_s > BASE_TIMEOUT_S
        commanded = Velocity() if timed_out else self.commanded
        across_mps = commanded.rotate_radps * half_m
        left_mps = self.left * (commanded.travel_mps - across_mps)
        right_mps = self.right * (commanded.travel_mps + across_mps)
        before = self._before = self._moves
        self._wheels = Velocity(
            _toward(self._wheels.travel_mps, (left_mps + right_mps) / 2, 0.04),
            _toward(self._wheels.rotate_radps, (right_mps - left_mps) / 2 / half_m, 0.1),
        )
        travel_mps = self.grip * self._wheels.travel_mps
        self._moves = Velocity(
            _toward(before.travel_mps, travel_mps, 0.08), self.grip * self._wheels.rotate_radps
        )
        true = _moved(self.true, self._moves, self.aside_mps)
        self.true = Pose(true.x_m, true.y_m, 0.0, true.heading_rad, self.roll_rad, self.pitch_rad)
        reported = self._reported
        believed = _moved(self.believed, reported, 0.0)
        self.believed = Pose(
            believed.x_m, believed.y_m, 0.0, believed.heading_rad, self.roll_rad, self.pitch_rad
        )

    @property
    def _reported(self) -> Velocity:
        return Velocity(
            self.odometry_travel * self._wheels.travel_mps,
            self.odometry_turn * self._moves.rotate_radps + self.odometry_bias_radps,
        )

    def _sense(self) -> None:
        now_s = self.clock.now_s()
        stamp_s = self._base_steps * STEP_S + self.clock_off_s
        self._send(self._imu(stamp_s), 0.0)
        if self._base_steps % 2 == 0:
            self._send(self._wheel_speeds(stamp_s), 0.0)
            self._send(Odometry(stamp_s, self.believed, self._reported), 0.02)
        if self._base_steps % 50 == 0:
            self._send(SecondOdometry(stamp_s, self._seen), SECOND_LATE_S)
        while self._active and not self.stalled and self._active[0][0] <= now_s + 1e-9:
            self.observe(self._active.popleft()[1])

    def _send(self, fact: Fact, late_s: float) -> None:
        if type(fact) in self.lost:
            return
        self._active.append((self.clock.now_s() + late_s, fact))
        self._active = deque(sorted(self._active, key=lambda each: each[0]))

    def _imu(self, stamp_s: float) -> Imu:
        turn_radps = self._moves.rotate_radps * self.gyro + self.gyro_bias_radps
        rate_radps = turn_radps * cos(self.pitch_rad)
        gained_mps2 = (self._moves.travel_mps - self._before.travel_mps) / STEP_S
        w = self._moves.rotate_radps
        slip = self.settings.mpc.measured_slip
        aside_mps = -slip.side_slip_m(self._wheels.travel_mps, w) * w
        return Imu(
            stamp_s,
            self.roll_rad if self.oriented else nan,
            self.pitch_rad if self.oriented else nan,
            -turn_radps * sin(self.pitch_rad),
            rate_radps * sin(self.roll_rad),
            rate_radps * cos(self.roll_rad),
            gained_mps2 - GRAVITY_MPS2 * sin(self.pitch_rad) - w * aside_mps,
            0.0,
            GRAVITY_MPS2,
        )

    def _wheel_speeds(self, stamp_s: float) -> Joints:
        joints = self._joints
        across_mps = self._wheels.rotate_radps * joints.track_m / 2
        left = (self._wheels.travel_mps - across_mps) / joints.wheel_radius_m
        right = (self._wheels.travel_mps + across_mps) / joints.wheel_radius_m
        mass_kg = self.settings.mass_kg or 0.0
        gained_mps2 = (self._moves.travel_mps - self._before.travel_mps) / STEP_S
        felt_n = mass_kg * (gained_mps2 - GRAVITY_MPS2 * sin(self.pitch_rad))
        torque_nm = (felt_n + self.held_n) * joints.wheel_radius_m / 4
        efforts = torque_nm + 0.02 * left, torque_nm + 0.02 * right
        if self.left != 1.0:
            efforts = self.torque_nm, efforts[1]
        if self.right != 1.0:
            efforts = efforts[0], self.torque_nm
        lefts, rights = self._with_noise(left), self._with_noise(right)
        if not self.torques:
            return Joints(stamp_s, lefts, rights)
        return Joints(stamp_s, lefts, rights, (efforts[0],) * 2, (efforts[1],) * 2)

    def _with_noise(self, speed_radps: float) -> tuple[float, float]:
        noise_radps = self.wheel_noise_radps
        return (
            speed_radps + self._random.gauss(0.0, noise_radps),
            speed_radps + self._random.gauss(0.0, noise_radps),
        )

    @property
    def _seen(self) -> Pose:
        frame, true = self.second_in_odometry, self.true
        cosine, sine = cos(-frame.heading_rad), sin(-frame.heading_rad)
        x_m, y_m = true.x_m - frame.x_m, true.y_m - frame.y_m
        return Pose(
            x_m * cosine - y_m * sine,
            x_m * sine + y_m * cosine,
            heading_rad=wrap_rad(true.heading_rad - frame.heading_rad),
        )


class SensedRover(KinematicRover):
    """A rover for a bench that has all sensors of a `SensedDrive`; its odometry is one of them.

    Attributes:
        body: what goes wrong is set here.
    """

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.body = SensedDrive(settings)
        self.body.observe = lambda fact: self.facts.append(fact)

    def advance(self, step_s: float) -> None:
        self.body.commanded = self.velocity
        for _ in range(round(step_s / STEP_S)):
            self.body.move_on()
        self.pose = self.body.believed


def _moved(pose: Pose, velocity: Velocity, aside_mps: float) -> Pose:
    along_rad = pose.heading_rad + velocity.rotate_radps * STEP_S / 2
    ahead_m, left_m = velocity.travel_mps * STEP_S, aside_mps * STEP_S
    return Pose(
        pose.x_m + ahead_m * cos(along_rad) - left_m * sin(along_rad),
        pose.y_m + ahead_m * sin(along_rad) + left_m * cos(along_rad),
        heading_rad=wrap_rad(pose.heading_rad + velocity.rotate_radps * STEP_S),
    )


def _toward(value: float, wanted: float, step: float) -> float:
    return max(value - step, min(value + step, wanted))
