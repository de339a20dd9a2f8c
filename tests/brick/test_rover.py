"""MOCUP in MuJoCo: how far whole motions lead, and that they lead there each time."""

from collections.abc import Callable
from math import degrees, hypot, pi

import pytest

from executive.values.geometry import wrap_rad
from sim.rover.faults import BatteryLow, OdometryLost
from sim.rover.mocup import SimulatedMocup
from sim.rover.world import Scatter, SoilShape, World
from tests.brick.rig import command
from tests.sim.driving import jpeg

Script = tuple[tuple[str, ...], ...]

LINE: Script = (("moveForward", "1.0"),)
BACK: Script = (("moveForward", "-1.0"),)
TURN: Script = (("rotateBy", repr(pi / 2)),)
SQUARE: Script = (*LINE, *TURN) * 4
TARGET: Script = (("moveTo", "1.0", "1.0", "0.0", ""),)
SETTINGS: Script = (("setTravelSpeed", "0.2"), ("setRotateSpeed", "1.0"))
UNEVEN = World(ground=SoilShape(amplitude_m=0.1, seed=2))


def carry_out(rover: SimulatedMocup, script: Script) -> bytes:
    """Give the commands one after the other; return all that the brick said."""
    reply = b""
    for number, (name, *inputs) in enumerate((*SETTINGS, *script), 1):
        rover.receive(str(command(name, number, *inputs)).encode())
        answer = b""
        while f"|True|True|{number}|#".encode() not in answer:
            assert rover.time_s < 120.0, answer
            rover.advance(0.02)
            answer += rover.brick.transmit()
        reply += answer
    return reply


def errors(rover: SimulatedMocup) -> tuple[float, float]:
    """Return by how many metres and degrees the brick's odometry is off."""
    true, seen = rover.true_pose, rover.brick.machine.odometry.pose
    turned_rad = abs(wrap_rad(true.heading_rad - seen.heading_rad))
    return hypot(true.x_m - seen.x_m, true.y_m - seen.y_m), degrees(turned_rad)


@pytest.mark.parametrize("world", [World(), World(friction=0.3), UNEVEN])
@pytest.mark.parametrize(
    ("script", "off_m", "off_deg"),
    [
        (LINE, (0.0, 0.005), (0.0, 0.2)),
        (BACK, (0.0, 0.005), (0.0, 0.2)),
        (TURN, (0.0, 0.002), (0.8, 2.0)),
        (SQUARE, (0.04, 0.11), (3.6, 8.0)),
        (TARGET, (0.01, 0.03), (0.0, 0.5)),
    ],
)
def test_odometry_errs_as_much_as_the_track_is_misjudged(
    world: World, script: Script, off_m: tuple[float, float], off_deg: tuple[float, float]
) -> None:
    for seed in (0, 2):
        rover = SimulatedMocup(world, seed)
        carry_out(rover, script)
        wrong_m, wrong_deg = errors(rover)
        assert off_m[0] <= wrong_m <= off_m[1]
        assert off_deg[0] <= wrong_deg <= off_deg[1]


def test_a_run_repeats_bit_for_bit() -> None:
    world = World(ground=SoilShape(amplitude_m=0.1), scatter=Scatter(count=20, seed=1))

    def run(advance: Callable[[SimulatedMocup], None]) -> tuple[bytes, object]:
        rover = SimulatedMocup(world, seed=3)
        rover.receive(str(command("moveTo", 1, "0.5", "0.5", "0.0", "")).encode())
        for _ in range(400):
            advance(rover)
        return rover.brick.transmit(), (rover.true_pose, rover.energy_j)

    def by_step(rover: SimulatedMocup) -> None:
        for _ in range(4):
            rover.advance(0.005)

    assert run(lambda rover: rover.advance(0.02)) == run(by_step)
    assert run(lambda rover: rover.advance(0.02)) != run(lambda rover: rover.advance(0.04))


def test_camera_and_battery_are_as_reported() -> None:
    rover = SimulatedMocup(World())
    carry_out(rover, (("setCameraRotateSpeed", "1.0"), ("setCameraAngles", "1.0", "-0.5")))
    rover.advance(1.5)
    angles = rover.camera_angles
    assert (angles.pan_rad, angles.tilt_rad) == pytest.approx((1.0, -0.5), abs=0.02)
    volts = rover.brick.machine.senses.voltage_v
    assert 7.5 <= volts <= 8.4
    rover.inject(BatteryLow())
    rover.advance(0.02)
    assert rover.brick.machine.senses.voltage_v == 6.0
    assert jpeg(rover)[:2] == b"\xff\xd8"


def test_failed_telemetry_recovers() -> None:
    rover = SimulatedMocup(World())
    rover.inject(OdometryLost())
    rover.advance(1.0)
    assert rover.brick.transmit() == b""
    rover.clear(OdometryLost)
    rover.advance(1.0)
    assert rover.brick.transmit().count(b"#") == 5
