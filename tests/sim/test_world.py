"""Worlds are read whole or refused with every fault named."""

import re
from math import hypot, radians, tan
from pathlib import Path

import pytest

from executive.settings import SettingsError
from executive.values.geometry import Velocity
from sim.rover.faults import LowFriction
from sim.rover.features import (
    Ditch,
    FeatureKind,
    FrictionPatch,
    GroundPoint,
    SlopeZone,
    StepBlock,
    Wall,
)
from sim.rover.jackal import SimulatedJackal
from sim.rover.mocup import SimulatedMocup
from sim.rover.world import Clearing, Rock, Scatter, SoilShape, World, load_world
from sim.scenario.reading import load_scenario
from tests.sim.driving import hold
from tests.support.patience import shipped

WORLDS = Path(__file__).parents[2] / "config" / "worlds"


@pytest.mark.parametrize("path", shipped(WORLDS), ids=lambda path: path.stem)
def test_a_rover_is_stationary_in_every_packaged_world(path: Path) -> None:
    rover = SimulatedJackal(load_world(path))
    rover.advance(0.5)
    assert rover.world.name == path.stem
    assert hypot(rover.true_pose.x_m, rover.true_pose.y_m) < 0.05


def test_reads_all_keys_of_a_world(tmp_path: Path) -> None:
    path = tmp_path / "hollow.yaml"
    path.write_text(
        "ground: {amplitude_m: 0.1, feature_m: 3, size_m: 20, seed: 4}\n"
        "slope_rad: 0.1\nfriction: 0.5\ncharge_ratio: 0.4\n"
        "rocks: [{x_m: 1, y_m: 2, radius_m: 0.3, height_m: 0.2}]\n"
        "scatter: {count: 3, clearings: [{x_m: 0, y_m: 0, radius_m: 2}]}\n"
        "start: {x_m: -1, y_m: 0.5, heading_rad: 1.5}\n"
        "walls: [{x_m: 3, y_m: 1, to: {x_m: 3, y_m: -1}, height_m: 0.5}]\n"
        "steps: [{x_m: 5, y_m: 0, length_m: 1, width_m: 2, height_m: 0.05}]\n"
        "ditches: [{x_m: 7, y_m: 0, length_m: 0.5, width_m: 2, depth_m: 0.1, heading_rad: 0.2}]\n"
        "patches: [{x_m: 2, y_m: 0, length_m: 1, width_m: 2, friction: 0.1}]\n"
        "slopes: [{x_m: -5, y_m: 0, length_m: 2, width_m: 3, slope_rad: 0.2}]\n"
    )
    world = load_world(path)
    assert world.name == "hollow"
    assert world.ground == SoilShape(amplitude_m=0.1, feature_m=3, size_m=20, seed=4)
    assert world.rocks == (Rock(1, 2, 0.3, 0.2),)
    assert world.scatter.clearings == (Clearing(0, 0, 2),)
    assert (world.slope_rad, world.friction, world.charge_ratio) == (0.1, 0.5, 0.4)
    assert (world.start.x_m, world.start.y_m, world.start.heading_rad) == (-1, 0.5, 1.5)
    assert world.walls == (Wall(x_m=3, y_m=1, to=GroundPoint(3, -1), height_m=0.5),)
    assert world.steps == (StepBlock(x_m=5, y_m=0, length_m=1, width_m=2, height_m=0.05),)
    ditch = Ditch(x_m=7, y_m=0, length_m=0.5, width_m=2, depth_m=0.1, heading_rad=0.2)
    assert world.ditches == (ditch,)
    assert world.patches == (FrictionPatch(x_m=2, y_m=0, length_m=1, width_m=2, friction=0.1),)
    assert world.slopes == (SlopeZone(x_m=-5, y_m=0, length_m=2, width_m=3, slope_rad=0.2),)
    shapes = {outline.kind: outline for outline in world.outlines}
    assert set(shapes) == set(FeatureKind)
    corners = shapes[FeatureKind.WALL].corners
    assert [corner.x_m for corner in corners] == pytest.approx([3.05, 3.05, 2.95, 2.95])
    assert [corner.y_m for corner in corners] == pytest.approx([-1, 1, 1, -1])
    assert shapes[FeatureKind.SLOPE].text == "11°"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("frictoin: 0.5", "frictoin"),
        ("friction: 9", "friction: 9 is not in 0.05 .. 2"),
        ("friction: slippery", "slippery"),
        ("ground: {amplitude_m: .nan}", "ground.amplitude_m: expected a finite number, got nan"),
        ("ground: {seed: -1}", "ground.seed: -1 is below 0"),
        (
            "rocks: [{x_m: 1, y_m: 0, radius_m: 0.2}]",
            r": rocks\[0\]: key 'height_m' is missing",
        ),
        ("start: {heading_rad: 90}", "start.heading_rad: 90 is not in"),
        ("start: {x_m: 1.0e+9}", r"start.x_m: 1e\+09 is not in -1000 .. 1000"),
        ("start: {y_m: .nan}", "start.y_m: expected a finite number, got nan"),
        ("[1, 2]", "a world is a YAML mapping"),
        ("a: [", "flow node"),
    ],
)
def test_refuses_an_invalid_world(tmp_path: Path, text: str, fault: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=fault) as refusal:
        load_world(path)
    assert str(path) in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("walls: [{x_m: 1, y_m: 0}]", r"bad.yaml: walls\[0\]: key 'to' is missing"),
        ("walls: [{x_m: 1, y_m: 0, to: {x_m: 1, y_m: 0}}]", "a wall is shorter than 0.05 m"),
        ("walls: [{x_m: 1, y_m: 0, to: {x_m: 1.0e+9, y_m: 0}}]", r"to.x_m: 1e\+09 is not in"),
        ("walls: [{x_m: 9, y_m: 0, to: {x_m: 8, y_m: 1}, height_m: 99}]", "height_m: 99 is not"),
        ("walls: [{x_m: 0.2, y_m: -1, to: {x_m: 0.2, y_m: 1}}]", r"walls\[0\] is nearer than 0.3"),
        ("steps: [{AT 0, height_m: 0.1}]", r"steps\[0\] is nearer than 0.35 m to the start"),
        ("steps: [{AT 3}]", r"steps\[0\]: key 'height_m' is missing"),
        ("ditches: [{x_m: 3, y_m: 0, length_m: 0.1, width_m: 1, depth_m: 0.1}]", "narrower than"),
        ("ditches: [{AT 15, depth_m: 0.1}]", r"ditches\[0\] reaches beyond the 30 m of"),
        ("patches: [{AT 3, friction: 0}]", "friction: 0 is not in"),
        (
            "patches: [{x_m: 3, y_m: 0, length_m: 0, width_m: 1, friction: 1}]",
            "length_m: 0 is not",
        ),
        ("slopes: [{AT 3, slope_rad: 10}]", "slope_rad: 10 is not in"),
        ("slopes: [{AT 3, slope: 0.1}]", "unknown key 'slope'"),
    ],
)
def test_refuses_what_no_feature_can_be(tmp_path: Path, text: str, fault: str) -> None:
    at = r"x_m: \1, y_m: 0, length_m: 1, width_m: 1"
    test_refuses_an_invalid_world(tmp_path, re.sub(r"AT (\d+)", at, text), fault)


def test_refuses_a_world_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="cannot be read"):
        load_world(tmp_path / "nowhere.yaml")


def test_scattered_rocks_keep_out_of_clearings_and_repeat() -> None:
    scatter = Scatter(count=80, seed=1, clearings=(Clearing(2, 1, 3),))
    rocks = World(scatter=scatter).all_rocks
    assert rocks == World(scatter=scatter).all_rocks
    assert len(rocks) == 80
    assert all(hypot(rock.x_m - 2, rock.y_m - 1) > 3 + rock.radius_m for rock in rocks)
    assert all(hypot(rock.x_m, rock.y_m) > 0.7 + rock.radius_m for rock in rocks)


def test_the_rover_drives_against_a_rock_and_not_through_it() -> None:
    rover = SimulatedJackal(World(rocks=(Rock(2.0, 0.0, 0.5, 0.8),)))
    hold(rover, Velocity(0.4, 0), 10.0)
    assert 1.0 < rover.true_pose.x_m < 1.6


SCENARIO = """\
title: Features
duration: 1
world:
  walls: [{x: 3, y: 1, to: {x: 3, y: -1}, thickness: 0.2}]
  slopes: [{x: 5, y: 0, length: 1, width: 2, slope: 10deg, heading: 90deg}]
  ditches: [{x: 5, y: 5, length: 1, width: 2, depth: 0.1, %s}]
expect: [{mode: IDLE}]
"""


def test_a_scenario_writes_them_without_units(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(SCENARIO % "heading: 0")
    world = load_scenario(str(path)).world
    assert world.walls == (Wall(x_m=3, y_m=1, to=GroundPoint(3, -1), thickness_m=0.2),)
    (slope,) = world.slopes
    assert (slope.slope_rad, slope.heading_rad) == pytest.approx((radians(10), radians(90)))
    path.write_text(SCENARIO % "height: 1")
    with pytest.raises(SettingsError, match=r"world.ditches\[0\]: unknown key 'height'"):
        load_scenario(str(path))


AHEAD = Velocity(0.5, 0)


def driven(world: World, duration_s: float = 4.0) -> SimulatedJackal:
    """Return a rover that was told to drive 2 m ahead."""
    rover = SimulatedJackal(world)
    hold(rover, AHEAD, duration_s)
    return rover


def test_a_wall_holds_it_for_any_wheel_speed() -> None:
    rover = driven(World(walls=(Wall(x_m=1.5, y_m=-1.0, to=GroundPoint(1.5, 1.0)),)))
    pose = rover.true_pose
    assert 1.0 < pose.x_m < 1.25
    assert abs(pose.pitch_rad) < 0.1
    assert rover.odometry.pose.x_m > 1.8


@pytest.mark.parametrize(("height_m", "climbed"), [(0.03, True), (0.12, False)])
def test_a_low_step_is_climbed_and_a_high_one_is_not(height_m: float, climbed: bool) -> None:
    step = StepBlock(x_m=2.5, y_m=0.0, length_m=2.0, width_m=2.0, height_m=height_m)
    pose = driven(World(steps=(step,))).true_pose
    assert (pose.z_m == pytest.approx(0.061 + height_m, abs=0.01)) == climbed
    assert (pose.x_m > 1.85) == climbed


@pytest.mark.parametrize(("depth_m", "crossed"), [(0.04, True), (0.3, False)])
def test_a_shallow_ditch_is_crossed_and_a_deep_one_is_not(depth_m: float, crossed: bool) -> None:
    ditch = Ditch(x_m=1.0, y_m=0.0, length_m=0.5, width_m=2.0, depth_m=depth_m)
    rover = driven(World(ditches=(ditch,), ground=SoilShape(size_m=8.0)))
    hold(rover, AHEAD, 1.0)
    pose = rover.true_pose
    assert (pose.x_m > 2.2) == crossed
    assert (abs(pose.pitch_rad) < 0.1) == crossed


def test_level_ground_surrounds_a_square_with_a_ditch() -> None:
    ditch = Ditch(x_m=0.0, y_m=1.5, length_m=0.5, width_m=0.5, depth_m=0.3)
    rover = driven(World(ditches=(ditch,), ground=SoilShape(size_m=4.0)), 6.0)
    assert rover.true_pose.x_m > 2.8
    assert rover.true_pose.z_m == pytest.approx(0.061, abs=0.005)


@pytest.mark.parametrize("slope_deg", [10.0, -10.0])
def test_a_slope_begins_and_ends_at_its_declared_position(slope_deg: float) -> None:
    zone = SlopeZone(x_m=1.5, y_m=0.0, length_m=1.0, width_m=9.0, slope_rad=radians(slope_deg))
    world = World(slopes=(zone,), ground=SoilShape(size_m=10.0))
    pitch = driven(world, 3.0).true_pose.pitch_rad
    assert pitch == pytest.approx(radians(-slope_deg), abs=0.02)
    beyond = driven(world, 5.2).true_pose
    assert beyond.pitch_rad == pytest.approx(0, abs=0.03)
    assert beyond.z_m - 0.061 == pytest.approx(tan(radians(slope_deg)), abs=0.01)


def test_slopes_add_up_to_a_ridge() -> None:
    up, down = (
        SlopeZone(x_m=x_m, y_m=0.0, length_m=1.0, width_m=2.0, slope_rad=slope_rad)
        for x_m, slope_rad in ((1.5, 0.2), (2.5, -0.2))
    )
    terrain = World(slopes=(up, down)).terrain
    heights_m = [terrain.height_m(x_m, 0.0) for x_m in (0.9, 1.5, 2.0, 2.5, 3.1)]
    assert heights_m == pytest.approx([0, tan(0.2) / 2, tan(0.2), tan(0.2) / 2, 0], abs=0.01)
    assert terrain.height_m(2.0, 1.2) == 0.0


def test_hills_stay_as_they_are_beside_a_ditch() -> None:
    ground = SoilShape(amplitude_m=0.1, seed=2)
    ditch = Ditch(x_m=3.0, y_m=0.0, length_m=1.0, width_m=1.0, depth_m=0.2)
    plain, dug = World(ground=ground).terrain, World(ground=ground, ditches=(ditch,)).terrain
    for position in ((0.0, 0.0), (1.3, -2.1), (-4.0, 3.3)):
        assert dug.height_m(*position) == pytest.approx(plain.height_m(*position), abs=0.004)
    assert plain.height_m(3.0, 0.0) - dug.height_m(3.0, 0.0) == pytest.approx(0.2, abs=0.004)


def test_wheels_have_the_friction_of_their_patch() -> None:
    uphill = World(slope_rad=radians(15), friction=0.6)
    ice = FrictionPatch(x_m=1.5, y_m=0.0, length_m=1.0, width_m=2.0, friction=0.05)
    assert driven(uphill).true_pose.x_m > 1.7
    icy = World(slope_rad=radians(15), friction=0.6, patches=(ice,))
    assert 0.9 < driven(icy).true_pose.x_m < 1.4
    same = FrictionPatch(x_m=1.5, y_m=0.0, length_m=1.0, width_m=2.0, friction=0.6)
    patched = World(slope_rad=radians(15), friction=0.6, patches=(ice, same))
    assert driven(patched).true_pose == pytest.approx(driven(uphill).true_pose)


def test_slip_and_patches_act_together_and_mocup_has_them_too() -> None:
    ice = FrictionPatch(x_m=0.0, y_m=0.0, length_m=4.0, width_m=4.0, friction=0.6)
    rover = SimulatedMocup(World(slope_rad=radians(8), friction=0.1, patches=(ice,)))
    rover.advance(1.0)
    assert abs(rover.true_pose.x_m) < 0.01
    rover.inject(LowFriction(0.1))
    rover.advance(1.0)
    assert rover.true_pose.x_m < -0.05


def test_rocks_may_all_be_higher_than_a_laser() -> None:
    low, high = Scatter(count=20, seed=3), Scatter(count=20, seed=3, min_height_m=1.0)
    assert [rock.x_m for rock in low.rocks()] == [rock.x_m for rock in high.rocks()]
    assert min(rock.height_m for rock in low.rocks()) < 0.5
    assert {rock.height_m for rock in high.rocks()} == {1.0}


def test_contacts_are_counted_where_the_rover_begins_to_touch() -> None:
    wall = Wall(x_m=1.0, y_m=-1.0, to=GroundPoint(1.0, 1.0))
    rover = SimulatedJackal(World(walls=(wall,), rocks=(Rock(-2.0, 0.0, 0.3, 0.3),)))
    hold(rover, Velocity(0.5), 0.8)
    assert rover.contacts == 0
    hold(rover, Velocity(0.5), 2.0)
    touched = rover.contacts
    assert touched >= 1
    hold(rover, Velocity(-0.5), 2.0)
    assert rover.contacts == touched
    hold(rover, Velocity(-0.5), 4.0)
    assert rover.contacts > touched
