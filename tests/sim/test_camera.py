"""Pictures show what lies ahead of the rover, whichever way they are made."""

import io
import sys

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from executive.values.facts import Frame
from executive.values.geometry import Velocity
from executive.values.ports import CameraIntent
from sim.rover.camera import Backend, PictureSettings, best_backend
from sim.rover.jackal import SimulatedJackal
from sim.rover.world import Rock, SoilShape, World
from tests.sim.driving import hold, jpeg
from tests.suite import CHECKOUT
from tests.support.processes import run_to_end

ROCK_AHEAD = World(rocks=(Rock(3.0, 0.4, 0.3, 0.5),))
NEEDS_EGL = pytest.mark.skipif(best_backend() is not Backend.EGL, reason="no EGL here")
BACKENDS = [Backend.RAYS, pytest.param(Backend.EGL, marks=NEEDS_EGL)]


def picture(rover: SimulatedJackal) -> NDArray[np.int64]:
    """Return what the rover sees: shape (height, width, 3)."""
    with Image.open(io.BytesIO(jpeg(rover))) as image:
        return np.asarray(image).astype(np.int64)


def rock_pixels(rover: SimulatedJackal) -> tuple[float, float, int]:
    """Return column and row of the middle of the one rock, and how many pixels it covers."""
    seen = picture(rover)
    soil_is_red = seen[..., 0] - seen[..., 2] > 45
    rows, columns = np.nonzero((seen.sum(axis=2) < 270) & ~soil_is_red)
    return float(np.median(columns)), float(np.median(rows)), len(rows)


def rover_with(backend: Backend, world: World = ROCK_AHEAD) -> SimulatedJackal:
    return SimulatedJackal(world, picture=PictureSettings(backend=backend))


@pytest.mark.parametrize("backend", BACKENDS)
def test_shows_sky_over_red_soil_and_the_rock_where_it_lies(backend: Backend) -> None:
    rover = rover_with(backend)
    seen = picture(rover)
    assert seen.shape == (240, 320, 3)
    sky, soil = seen[:60].mean(axis=(0, 1)), seen[200:].mean(axis=(0, 1))
    assert sky.sum() > 1.2 * soil.sum()
    assert soil[0] > 1.3 * soil[1] > 1.3 * soil[2]
    column, row, count = rock_pixels(rover)
    assert column == pytest.approx(160 - 0.4 / 2.85 * 230, abs=8)
    assert row == pytest.approx(145, abs=15)
    assert count > 800


@NEEDS_EGL
@pytest.mark.parametrize("uneven_m", [0.0, 0.08])
def test_both_backends_see_the_same_rock_at_the_same_position(uneven_m: float) -> None:
    world = World(rocks=ROCK_AHEAD.rocks, ground=SoilShape(amplitude_m=uneven_m, feature_m=4.0))
    by_rays = rock_pixels(rover_with(Backend.RAYS, world))
    by_egl = rock_pixels(rover_with(Backend.EGL, world))
    assert by_egl[:2] == pytest.approx(by_rays[:2], abs=2)
    assert by_egl[2] == pytest.approx(by_rays[2], rel=0.15)


@NEEDS_EGL
def test_rays_are_used_if_no_device_can_draw() -> None:
    script = (
        "from sim.rover.camera import *\n"
        "from sim.rover.jackal import *\n"
        "from sim.rover.world import *\n"
        "settings = PictureSettings(32, 24, backend=Backend.EGL)\n"
        "rover = SimulatedJackal(World())\n"
        "camera = Camera(rover.model, settings)\n"
        "print(camera.backend.value, len(camera.jpeg(rover.data)), camera.backend.value)"
    )
    run = run_to_end(sys.executable, "-c", script, cwd=CHECKOUT, MUJOCO_EGL_DEVICE_ID="99")
    assert "pictures by ray casting" in run.stderr
    before, octets, after = run.stdout.split()
    assert (before, after) == ("egl", "rays")
    assert int(octets) > 500


def test_turning_the_camera_to_the_left_moves_the_rock_to_the_right() -> None:
    rover = rover_with(Backend.RAYS)
    before, *_ = rock_pixels(rover)
    rover.point_camera(CameraIntent(0.3, 0.0, 0.5))
    rover.advance(2.0)
    after, *_ = rock_pixels(rover)
    assert after - before == pytest.approx(0.3 * 230, abs=15)


def test_tilting_the_camera_down_shows_the_deck() -> None:
    rover = rover_with(Backend.RAYS)
    rover.point_camera(CameraIntent(2.5, -0.8, 2.0))
    rover.advance(3.0)
    seen = picture(rover)
    yellow = (seen[..., 0] > 150) & (seen[..., 1] > 110) & (seen[..., 2] < 60)
    assert yellow.mean() > 0.03


def test_a_requested_picture_arrives_with_the_next_facts() -> None:
    rover = rover_with(Backend.RAYS)
    rover.advance(1.0)
    assert not any(isinstance(fact, Frame) for fact in rover.facts())
    rover.request_frame()
    (frame,) = rover.facts()
    assert isinstance(frame, Frame)
    assert (frame.stamp_s, frame.format, frame.data[:3]) == (1.0, "JPG", b"\xff\xd8\xff")
    assert rover.facts() == []


@pytest.mark.parametrize("backend", BACKENDS)
def test_taking_pictures_does_not_disturb_the_drive(backend: Backend) -> None:
    watched, alone = rover_with(backend), rover_with(backend)
    for _ in range(5):
        hold(watched, Velocity(0.5, 0.4), 0.5)
        jpeg(watched)
        hold(alone, Velocity(0.5, 0.4), 0.5)
    assert watched.true_pose == alone.true_pose
