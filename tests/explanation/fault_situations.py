"""A situation for each kind of fault that monitors see, and for what leaves of the tree fail by."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import nan
from typing import Any, Final

from py_trees.common import Status

from executive.commands import MoveFile, MoveForward, Request, RotateBy, Stop, TakePicture
from executive.goals import Context
from executive.obstacles.zones import KnownRock, Zones
from executive.settings import LaserSettings, SecondOdometrySettings, Settings
from executive.values.facts import ForeignMuxInput, Frame, Imu, Joints, Odometry, SecondOdometry
from executive.values.geometry import STANDING, Velocity
from executive.values.reasons import Reason
from tests.explanation.case import JACKAL, Case
from tests.support.kinematic import PICTURE, STEP_S, Bench, KinematicRover, ignoring
from tests.support.laser import Disc, ScanningRover
from tests.support.sensed_drive import SensedRover
from trees import RoverTree
from trees.motion import Drive

FAR: Final = MoveForward(50.0)
SPIN: Final = RotateBy(6.0)
MAX_DURATION_S: Final = 15.0


def _until_ended(bench: Bench, limit_s: float = MAX_DURATION_S) -> None:
    """Let time pass until command 1 has ended, at most as long."""
    for _ in range(round(limit_s / STEP_S)):
        if bench.stages(1)[-1].terminal:
            return
        bench.step()


def _sensing(*ignored: str) -> Settings:
    jackal = ignoring(
        *("odometry_frozen", "off_command", "turn_off_command", "turn_angle_off_command"), *ignored
    )
    second = SecondOdometrySettings(rate_hz=2.0, fused=False)
    return replace(jackal, sensors=replace(jackal.sensors, second_odometry=second))


def _body(bench: Bench) -> SensedRover:
    assert isinstance(bench.rover, SensedRover)
    return bench.rover


def _goes_wrong(
    request: Request | None, after_s: float, lasts_s: float, **changes: Any
) -> Callable[[Bench], None]:
    """Return what begins a motion, and lets something go wrong with the rover meanwhile."""

    def inject(bench: Bench) -> None:
        body = _body(bench).body
        bench.odometry = False
        bench.run(2.0)
        if request is not None:
            bench.submit(request, 1)
        bench.run(after_s)
        for name, value in changes.items():
            assert hasattr(body, name)
            setattr(body, name, value)
        if request is None:
            bench.run(lasts_s)
        else:
            _until_ended(bench, lasts_s)

    return inject


def _sensed(
    reason: Reason, request: Request = FAR, *, after_s: float = 2.0, **changes: Any
) -> Case:
    inject = _goes_wrong(request, after_s, MAX_DURATION_S, **changes)
    name = f"{reason.name} seen by sensors"
    return Case(name, inject, "MOE:1", reason, settings=_sensing(), rover=SensedRover)


def _silent(kind: type, message: str) -> Case:
    inject = _goes_wrong(FAR, 2.0, 7.0, lost={kind})
    return Case(
        f"{message} silent",
        inject,
        "MOE:1",
        None,
        "(SENSOR_SILENT 961)",
        _sensing(),
        rover=SensedRover,
    )


@dataclass
class WeakRover(KinematicRover):
    """Makes less of each command than it is told to.

    Attributes:
        strength: how much of it, also by its odometry.
        pose_strength: how much of that its pose shows.
    """

    strength: float = 1.0
    pose_strength: float = 1.0

    def drive(self, velocity: Velocity) -> None:
        super().drive(
            Velocity(self.strength * velocity.travel_mps, self.strength * velocity.rotate_radps)
        )

    def advance(self, step_s: float) -> None:
        super().advance(step_s * self.pose_strength)


def _weak(_: Settings) -> WeakRover:
    return WeakRover()


def _weakens(request: Request, **changes: float) -> Callable[[Bench], None]:
    def inject(bench: Bench) -> None:
        bench.submit(request, 1)
        bench.run(1.0)
        for name, value in changes.items():
            assert hasattr(bench.rover, name)
            setattr(bench.rover, name, value)
        _until_ended(bench, 60.0)

    return inject


def _delayed(every: int, late_s: float) -> Callable[[Bench], None]:
    """Return what lets odometry come seldom, and late."""

    def inject(bench: Bench) -> None:
        bench.submit(FAR, 1)
        bench.run(1.0)
        bench.odometry = False
        poses: list[Odometry] = []
        for step in range(60):
            bench.step()
            now_s = bench.clock.now_s()
            poses.append(Odometry(now_s, bench.rover.pose, bench.rover.velocity))
            due = [each for each in poses if each.stamp_s <= now_s - late_s + 1e-9]
            if step % every == 0 and due:
                bench.executive.observe(due[-1])

    return inject


def _without_twist(bench: Bench) -> None:
    bench.submit(FAR, 1)
    bench.odometry = False
    for _ in range(60):
        bench.step()
        bench.executive.observe(Odometry(bench.clock.now_s(), bench.rover.pose, STANDING))


def _silent_odometry(bench: Bench) -> None:
    bench.run(1.0)
    bench.odometry = False
    bench.run(1.5)


def _moves_by_itself(bench: Bench) -> None:
    bench.run(3.0)
    bench.rover.velocity = Velocity(0.3, 0.0)
    bench.run(2.0)


def _silent_battery(bench: Bench) -> None:
    bench.voltage_v = None
    bench.run(6.0)


def _battery_without_number(bench: Bench) -> None:
    bench.voltage_v = nan
    bench.run(1.0)


def _preempted(bench: Bench) -> None:
    bench.drive_on()
    for _ in range(20):
        bench.executive.observe(ForeignMuxInput("joystick", overrides=True))
        bench.step()


def _scanning(bench: Bench) -> ScanningRover:
    assert isinstance(bench.rover, ScanningRover)
    return bench.rover


def _to_a_rock(bench: Bench) -> None:
    bench.run(1.0)
    _scanning(bench).discs = [Disc(4.0, 0.0, 0.5)]
    bench.submit(FAR, 1)
    _until_ended(bench)


def _slowed_by_a_rock(bench: Bench) -> None:
    bench.run(1.0)
    bench.submit(FAR, 1)
    bench.run(2.0)
    rover = _scanning(bench)
    rover.discs = [Disc(rover.pose.x_m + 2.0, 0.0, 0.5)]
    while "OBSTACLE_NEAR" not in {
        each.reason.name for each in bench.received.reports if each.reason
    }:
        bench.step()


def _blind(bench: Bench) -> None:
    bench.run(1.0)
    bench.submit(FAR, 1)
    bench.run(1.0)
    _scanning(bench).blind = True
    _until_ended(bench)


def _brakes_badly(bench: Bench) -> None:
    bench.submit(MoveForward(2.0), 1)
    _until_ended(bench)


def _unverified(bench: Bench) -> None:
    _goes_wrong(MoveForward(2.0), 1.0, MAX_DURATION_S, lost={SecondOdometry})(bench)


def _shoved(bench: Bench) -> None:
    bench.submit(MoveForward(3.0), 1)
    bench.run(3.2)
    bench.rover.pose = replace(bench.rover.pose, y_m=0.15)
    _until_ended(bench)


def _slides_on(bench: Bench) -> None:
    bench.submit(Stop(), 1)
    for _ in range(round(6.0 / STEP_S)):
        pose = bench.rover.pose
        bench.rover.pose = replace(pose, x_m=pose.x_m + 0.4 * STEP_S)
        bench.step()


def _pictured(stamp_s: float, data: bytes = PICTURE) -> Callable[[Bench], None]:
    def inject(bench: Bench) -> None:
        bench.run(10.0)
        bench.rover.camera_works = False
        bench.submit(TakePicture(), 1)
        for _ in range(2):
            bench.run(0.2)
            bench.rover.facts.append(Frame(stamp_s, "JPG", data))
        _until_ended(bench)

    return inject


def _no_space_for_pictures(bench: Bench) -> None:
    root = bench.executive.files.root
    root.mkdir(parents=True, exist_ok=True)
    (root / "pictures").write_bytes(b"no folder")
    bench.submit(TakePicture(), 1)
    _until_ended(bench)


def _no_folder(bench: Bench) -> None:
    bench.executive.files.root.mkdir(parents=True, exist_ok=True)
    for name in ("a.jpg", "b.jpg"):
        (bench.executive.files.root / name).write_bytes(b"x")
    bench.submit(MoveFile("a.jpg", "b.jpg/a.jpg"), 1)
    _until_ended(bench)


class Exploding(RoverTree):
    """A rover tree whose drive leaf raises."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        (drive,) = [node for node in self.root.iterate() if isinstance(node, Drive)]

        def explode() -> Status:
            raise ZeroDivisionError("boom")

        vars(drive)["act"] = explode


def _explodes(bench: Bench) -> None:
    bench.submit(FAR, 1)
    bench.run(0.5)


def _disk_full(bench: Bench) -> None:
    bench.drive_on()
    bench.fill_disk()
    bench.submit(MoveForward(1.0), 2)
    bench.run(0.2)
    bench.fill_disk(False)
    bench.run(0.2)


_SLIPPERY: Final = _sensing("travel_slip", "turn_slip", "wheel_slip", "odometry_off_wheels")
_SEEING: Final = replace(JACKAL, sensors=replace(JACKAL.sensors, laser=LaserSettings(rate_hz=10)))
_BRAKING_BADLY: Final = replace(
    JACKAL,
    zones=Zones(rocks=(KnownRock("boulder", 3.0, 0.0, 0.5),)),
    drive=replace(JACKAL.drive, braking_mps2=0.3),
)
_PATIENT: Final = ignoring(
    "odometry_off_twist", "odometry_heading_off_twist", "no_progress", "turn_angle_off_command"
)


def _scanner(_: Settings) -> ScanningRover:
    return ScanningRover()


FAULTS: Final = (
    _sensed(Reason.WHEELS_OFF_COMMAND, left=0.0),
    _sensed(Reason.WHEELS_UNPOWERED, left=0.9, torque_nm=0.0),
    _sensed(Reason.ODOMETRY_OFF_WHEELS, odometry_travel=0.0),
    _sensed(Reason.ODOMETRY_OFF_GYRO, gyro_bias_radps=0.03),
    _sensed(Reason.WHEELS_OFF_GYRO, SPIN, after_s=1.0, gyro=0.0, odometry_turn=0.0),
    _sensed(Reason.WHEEL_SLIP, grip=0.0),
    _sensed(Reason.MOTION_BLOCKED, held_n=60.0),
    _sensed(Reason.TILT_LIMIT, roll_rad=0.6),
    _sensed(Reason.TRAVEL_SLIP, aside_mps=0.5),
    _sensed(Reason.TURN_SLIP, gyro_bias_radps=0.3, odometry_bias_radps=0.3),
    _silent(Joints, "joints"),
    _silent(Imu, "inertial sensors"),
    _silent(SecondOdometry, "second odometry"),
    Case(
        "slides while it stands",
        _goes_wrong(None, 2.0, 2.5, aside_mps=0.2),
        None,
        None,
        "(SLIDE_AT_REST 953)",
        _sensing(),
        rover=SensedRover,
    ),
    Case("off command", _weakens(FAR, strength=0.4), "MOE:1", Reason.OFF_COMMAND, rover=_weak),
    Case(
        "no progress",
        _weakens(FAR, strength=0.0),
        "MOE:1",
        Reason.NO_PROGRESS,
        settings=ignoring("off_command", "odometry_frozen"),
        rover=_weak,
    ),
    Case("odometry late", _delayed(1, 0.15), "MOE:1", Reason.ODOMETRY_LATE),
    Case("odometry slow", _delayed(5, 0.0), "MOE:1", Reason.ODOMETRY_RATE_LOW),
    Case("odometry without twist", _without_twist, "MOE:1", Reason.ODOMETRY_INCONSISTENT),
    Case("odometry silent", _silent_odometry, None, None, "(ODOMETRY_SILENT 914)"),
    Case("now: moves by itself", _moves_by_itself, None, Reason.UNCOMMANDED_MOTION),
    Case("battery silent", _silent_battery, None, None, "(BATTERY_SILENT 921)"),
    Case("battery without number", _battery_without_number, None, None, "(BATTERY_NOT_FINITE 922)"),
    Case("taken over", _preempted, "MOE:1", Reason.OTHER_PUBLISHER, "joystick"),
    Case("now: taken over", _preempted, None, Reason.OTHER_PUBLISHER, "joystick"),
    Case(
        "rock seen ahead",
        _to_a_rock,
        "MOE:1",
        Reason.OBSTACLE_AHEAD,
        settings=_SEEING,
        rover=_scanner,
    ),
    Case(
        "slowed by a rock",
        _slowed_by_a_rock,
        "MOE:1",
        None,
        "(OBSTACLE_NEAR 973)",
        _SEEING,
        rover=_scanner,
    ),
    Case("laser silent", _blind, "MOE:1", Reason.LASER_SILENT, settings=_SEEING, rover=_scanner),
    Case(
        "rock known ahead",
        _brakes_badly,
        "MOE:1",
        Reason.ZONE_AHEAD,
        "boulder",
        _BRAKING_BADLY,
    ),
    Case(
        "not confirmed",
        _goes_wrong(MoveForward(3.0), 1.0, MAX_DURATION_S, grip=0.85),
        "MOE:1",
        Reason.NOT_CONFIRMED,
        settings=_SLIPPERY,
        rover=SensedRover,
    ),
    Case(
        "not verified",
        _unverified,
        "MOE:1",
        Reason.UNVERIFIED,
        settings=_sensing("second_odometry_silent"),
        rover=SensedRover,
    ),
    Case("off its target", _shoved, "MOE:1", Reason.OFF_TARGET, settings=_PATIENT),
    Case(
        "drives too slowly",
        _weakens(MoveForward(3.0), pose_strength=0.1),
        "MOE:1",
        Reason.DRIVE_DEADLINE,
        settings=_PATIENT,
        rover=_weak,
    ),
    Case(
        "turns too slowly",
        _weakens(RotateBy(3.0), pose_strength=0.1),
        "MOE:1",
        Reason.TURN_DEADLINE,
        settings=_PATIENT,
        rover=_weak,
    ),
    Case("does not stand", _slides_on, "MOE:1", Reason.STOP_DEADLINE, settings=_PATIENT),
    Case("picture stale", _pictured(2.0), "MOE:1", Reason.CAPTURE_STALE),
    Case("picture cut", _pictured(10.2, PICTURE[:-2]), "MOE:1", Reason.CAPTURE_TRUNCATED),
    Case("picture not stored", _no_space_for_pictures, "MOE:1", Reason.CAPTURE_NOT_STORED),
    Case("file not moved", _no_folder, "MOE:1", Reason.INSTANT_COMMAND_FAILED),
    Case("leaf raised", _explodes, "MOE:1", Reason.LEAF_RAISED, "boom", build_tree=Exploding),
    Case("disk full", _disk_full, "MOE:1", Reason.LEDGER_FAILED),
    Case("now: disk full", _disk_full, None, Reason.LEDGER_FAILED),
)
