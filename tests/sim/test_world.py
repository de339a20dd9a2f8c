"""Worlds are read whole or refused with every fault named."""

from math import hypot
from pathlib import Path

import pytest

from executive.geometry import Velocity
from executive.settings import SettingsError
from sim.rover.jackal import SimulatedJackal
from sim.rover.world import Clearing, Ground, Rock, Scatter, World, load_world
from tests.sim.driving import hold

WORLDS = Path(__file__).parents[2] / "config" / "worlds"


@pytest.mark.parametrize("path", sorted(WORLDS.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_rover_stands_in_every_world_that_comes_with_it(path: Path) -> None:
    rover = SimulatedJackal(load_world(path))
    rover.advance(0.5)
    assert rover.world.name == path.stem
    assert hypot(rover.true_pose.x_m, rover.true_pose.y_m) < 0.05


def test_reads_all_that_a_world_can_say(tmp_path: Path) -> None:
    path = tmp_path / "hollow.yaml"
    path.write_text(
        "ground: {amplitude_m: 0.1, feature_m: 3, size_m: 20, seed: 4}\n"
        "slope_rad: 0.1\nfriction: 0.5\ncharge_ratio: 0.4\n"
        "rocks: [{x_m: 1, y_m: 2, radius_m: 0.3, height_m: 0.2}]\n"
        "scatter: {count: 3, clearings: [{x_m: 0, y_m: 0, radius_m: 2}]}\n"
        "start: {x_m: -1, y_m: 0.5, heading_rad: 1.5}\n"
    )
    world = load_world(path)
    assert world.name == "hollow"
    assert world.ground == Ground(amplitude_m=0.1, feature_m=3, size_m=20, seed=4)
    assert world.rocks == (Rock(1, 2, 0.3, 0.2),)
    assert world.scatter.clearings == (Clearing(0, 0, 2),)
    assert (world.slope_rad, world.friction, world.charge_ratio) == (0.1, 0.5, 0.4)
    assert (world.start.x_m, world.start.y_m, world.start.heading_rad) == (-1, 0.5, 1.5)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("frictoin: 0.5", "frictoin"),
        ("friction: 9", "friction 9.0 is not in"),
        ("friction: slippery", "slippery"),
        ("ground: {amplitude_m: .nan}", "amplitude_m nan"),
        ("ground: {seed: -1}", "seed -1 is below 0"),
        ("rocks: [{x_m: 1, y_m: 0, radius_m: 0.2}]", r"missing @ .*bad.yaml.rocks\[0\].height_m"),
        ("start: {heading_rad: 90}", "start heading is not within"),
        ("start: {x_m: 1.0e+9}", "farther than 1000 m"),
        ("start: {y_m: .nan}", "farther than 1000 m"),
        ("[1, 2]", "a world is a YAML mapping"),
        ("a: [", "flow node"),
    ],
)
def test_refuses_what_a_world_cannot_be(tmp_path: Path, text: str, fault: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=fault) as refusal:
        load_world(path)
    assert str(path) in str(refusal.value)


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
