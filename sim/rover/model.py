"""`build_model`: the MuJoCo model of a rover, from its XML file, in a world."""

from dataclasses import dataclass
from importlib.resources import files
from math import cos, pi, sin
from random import Random
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.rover import scenery
from sim.rover.world import Terrain, World

PICTURE_LIMIT = (1280, 960)
"""Maximum width and height of a picture."""
_MEETS_ROVER = 3
_BELOW_M = 2.0
"""Depth of walls and steps in the ground, and of the level ground around a square."""
_AROUND_M = 200.0
_FILM_M = 0.001
"""Height of a visible patch over the ground."""


@dataclass(frozen=True, slots=True)
class Chassis:
    """One kind of rover.

    Attributes:
        file: its MuJoCo model; the joints are the free one, the wheels, pan and tilt.
        wheels: number of driven wheels.
        base_height_m: height of base_link over the ground below the wheels.
        reach_m: half the side of the square of ground that can touch it.
        yield_m: twice the compression of tyre and soil under its weight.
    """

    file: str
    wheels: int
    base_height_m: float
    reach_m: float
    yield_m: float


JACKAL = Chassis("jackal.xml", wheels=4, base_height_m=0.061, reach_m=0.25, yield_m=0.01)
"""With half a centimetre of compression all four wheels carry on uneven ground, and the track
multiplier is right at every friction."""
MOCUP = Chassis("mocup.xml", wheels=2, base_height_m=0.041, reach_m=0.13, yield_m=0.001)


@dataclass(frozen=True, slots=True)
class _Scene:
    """A world to be added to a model; `contact` has the contact parameters of its ground."""

    spec: mujoco.MjSpec
    soil: mujoco.MjsBody
    world: World
    terrain: Terrain
    contact: dict[str, Any]


def build_model(world: World, step_s: float, chassis: Chassis) -> mujoco.MjModel:
    """Return the compiled model of the rover in a world, at its start.

    Raises:
        ValueError: if MuJoCo refuses the model.
    """
    spec = mujoco.MjSpec.from_string(files("sim.rover").joinpath(chassis.file).read_text("utf-8"))
    spec.option.timestep = step_s
    _add_materials(spec)
    soil = spec.worldbody.add_body(name="terrain", quat=_rise(world.slope_rad))
    scene = _Scene(spec, soil, world, world.terrain, _contact(world, chassis))
    _add_soil(scene)
    _add_rocks(scene)
    _add_features(scene)
    _add_hills(soil)
    _set_rover_start(spec.body("base_link"), scene, chassis)
    return spec.compile()


def _set_rover_start(base: mujoco.MjsBody, scene: _Scene, chassis: Chassis) -> None:
    """Put the rover at its start, tilted like the ground, above the ground with all wheels."""
    start, soil = scene.world.start, scene.soil
    reach_m = (-chassis.reach_m, 0.0, chassis.reach_m)
    height_m = chassis.base_height_m + max(
        scene.terrain.height_m(start.x_m + along, start.y_m + across)
        for along in reach_m
        for across in reach_m
    )
    mujoco.mju_rotVecQuat(base.pos, np.array((start.x_m, start.y_m, height_m)), soil.quat)
    heading = np.array((cos(start.heading_rad / 2), 0, 0, sin(start.heading_rad / 2)))
    mujoco.mju_mulQuat(base.quat, soil.quat, heading)


def _rise(slope_rad: float) -> tuple[float, float, float, float]:
    """Return the rotation that lifts +x by a slope."""
    return (cos(slope_rad / 2), 0, -sin(slope_rad / 2), 0)


def _add_materials(spec: mujoco.MjSpec) -> None:
    """Add sky, sun, haze and the materials of the ground."""
    visual = spec.visual
    visual.quality.shadowsize = 1024
    visual.quality.offsamples = 0
    visual.global_.offwidth, visual.global_.offheight = PICTURE_LIMIT
    visual.headlight.active = 1
    visual.headlight.ambient = (scenery.AMBIENT,) * 3
    visual.headlight.diffuse = (0, 0, 0)
    visual.headlight.specular = (0, 0, 0)
    visual.rgba.fog = (*scenery.HORIZON, 1)
    visual.rgba.haze = (*scenery.HORIZON, 1)
    spec.stat.extent = 10
    spec.stat.center = (0, 0, 0)
    visual.map.fogstart = scenery.HAZE_START_M / 10
    visual.map.fogend = scenery.HAZE_END_M / 10
    visual.map.shadowclip = 1.5
    visual.map.znear = 0.003
    visual.map.zfar = 25
    spec.body("base_link").add_light(
        name="sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
        pos=tuple(-8 * axis for axis in scenery.SUN_DIRECTION),
        dir=scenery.SUN_DIRECTION,
        diffuse=(scenery.SUNLIGHT,) * 3,
        specular=(0.15,) * 3,
        castshadow=True,
    )
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=scenery.ZENITH,
        rgb2=scenery.HORIZON,
        width=256,
        height=256,
    )
    for name, image, repeat in (
        ("soil", scenery.soil_texture(), 1 / scenery.TILE_M),
        ("rock", scenery.rock_texture(), 1.0),
    ):
        texture = spec.add_texture(
            name=name,
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            width=image.shape[1],
            height=image.shape[0],
            nchannel=3,
        )
        texture.data = image.tobytes()
        material = spec.add_material(
            name=name, texrepeat=(repeat, repeat), texuniform=True, specular=0, shininess=0
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    spec.add_material(name="hill", rgba=(*scenery.HILL, 1), specular=0)


def _contact(world: World, chassis: Chassis) -> dict[str, Any]:
    """Return the contact parameters of ground and rocks, as attributes of a geom."""
    return {
        "conaffinity": _MEETS_ROVER,
        "contype": 0,
        "condim": 3,
        "priority": 1,
        "friction": (world.friction, 0, 0),
        "solimp": (0, 0.95, chassis.yield_m, 0.5, 2),
    }


def _add_soil(scene: _Scene) -> None:
    """Add the infinite plane, and the uneven square a little above it.

    If the square goes below level ground, the plane is below all of it, and level ground is added
    around.
    """
    soil, terrain = scene.soil, scene.terrain
    heights_m = terrain.heights_m
    min_m, max_m = heights_m.min(), heights_m.max()
    uneven = bool(max_m > min_m)
    common = {**scene.contact, "material": "soil"}
    soil.add_geom(
        name="plain",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(300, 300, 10),
        pos=(0, 0, min_m - 0.002 if uneven else 0),
        **common,
    )
    if uneven:
        rows, columns = heights_m.shape
        span_m = max_m - min_m
        scene.spec.add_hfield(
            name="hills",
            nrow=rows,
            ncol=columns,
            size=(terrain.size_m / 2, terrain.size_m / 2, span_m, 0.1),
            userdata=((heights_m - min_m) / span_m).ravel(),
        )
        soil.add_geom(
            name="hills",
            type=mujoco.mjtGeom.mjGEOM_HFIELD,
            hfieldname="hills",
            pos=(0, 0, min_m),
            **common,
        )
    if min_m < 0:
        _add_level_ground(soil, terrain.size_m / 2, common)


def _add_level_ground(soil: mujoco.MjsBody, inner_m: float, common: dict[str, Any]) -> None:
    """Add level ground around a square, given by its half side."""
    outer_m = inner_m + _AROUND_M
    middle_m, half_m = (inner_m + outer_m) / 2, _AROUND_M / 2
    for number, (x_m, y_m, half_x_m, half_y_m) in enumerate(
        (
            (middle_m, 0.0, half_m, outer_m),
            (-middle_m, 0.0, half_m, outer_m),
            (0.0, middle_m, inner_m, half_m),
            (0.0, -middle_m, inner_m, half_m),
        )
    ):
        soil.add_geom(
            name=f"level{number}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=(half_x_m, half_y_m, _BELOW_M / 2),
            pos=(x_m, y_m, -_BELOW_M / 2),
            **common,
        )


def _add_features(scene: _Scene) -> None:
    """Add walls and steps, and markers of patches with different friction.

    All are upright blocks with their height above the ground at their centre, and reach into it.
    """
    world, contact = scene.world, scene.contact
    if not (world.walls or world.steps or world.patches):
        return
    scene.spec.add_material(name="wall", rgba=(*scenery.WALL, 1), specular=0)
    scene.spec.add_material(name="patch", rgba=(*scenery.PATCH, 1), specular=0.2)
    above = {**contact, "priority": contact["priority"] + 2}
    blocks = [
        (wall.area, wall.height_m, "wall", {**above, "friction": (wall.friction, 0, 0)})
        for wall in world.walls
    ]
    blocks += [(step, step.height_m, "wall", contact) for step in world.steps]
    unfelt = {"contype": 0, "conaffinity": 0}
    blocks += [(patch, _FILM_M, "patch", unfelt) for patch in world.patches]
    for number, (area, height_m, material, touch) in enumerate(blocks):
        ground_m = scene.terrain.height_m(area.x_m, area.y_m)
        scene.soil.add_geom(
            name=f"feature{number}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=(area.length_m / 2, area.width_m / 2, (height_m + _BELOW_M) / 2),
            pos=(area.x_m, area.y_m, ground_m + (height_m - _BELOW_M) / 2),
            quat=(cos(area.heading_rad / 2), 0, 0, sin(area.heading_rad / 2)),
            material=material,
            **touch,
        )


def _add_hills(soil: mujoco.MjsBody) -> None:
    """Add hills at the horizon, out of reach."""
    random = Random(11)
    count = 14
    for number in range(count):
        bearing_rad = 2 * pi * (number + random.uniform(-0.3, 0.3)) / count
        distance_m = random.uniform(90, 140)
        soil.add_geom(
            name=f"hill{number}",
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            size=(random.uniform(20, 40), random.uniform(20, 40), random.uniform(5, 14)),
            pos=(distance_m * cos(bearing_rad), distance_m * sin(bearing_rad), -1),
            contype=0,
            conaffinity=0,
            material="hill",
        )


_SUNK = 0.3
"""Part of a rock's height that is in the ground."""
_CHIPS = 14
_CORNERS = 160


def _add_rocks(scene: _Scene) -> None:
    """Add the rocks of a world to its soil."""
    soil, rocks = scene.soil, scene.world.all_rocks
    random = np.random.default_rng(len(rocks))
    ball = _ball()
    for number, rock in enumerate(rocks):
        half_m = rock.height_m / (2 * (1 - _SUNK))
        axes_m = np.array((rock.radius_m, rock.radius_m * random.uniform(0.7, 1.0), half_m))
        turn_rad = random.uniform(0, pi)
        ground_m = scene.terrain.height_m(rock.x_m, rock.y_m)
        placement = {
            "pos": (rock.x_m, rock.y_m, ground_m + rock.height_m - half_m),
            "quat": (cos(turn_rad / 2), 0, 0, sin(turn_rad / 2)),
            "material": "rock",
        }
        soil.add_geom(
            name=f"rock{number}",
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            size=axes_m,
            group=4,
            **scene.contact,
            **placement,
        )
        mesh = scene.spec.add_mesh(name=f"stone{number}")
        mesh.uservert = (_chipped(ball, random) * axes_m).ravel()
        soil.add_geom(
            name=f"stone{number}",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=f"stone{number}",
            group=1,
            contype=0,
            conaffinity=0,
            **placement,
        )


def _chipped(ball: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Return a ball with flat sides; MuJoCo uses its convex hull as mesh."""
    normals = random.standard_normal((_CHIPS, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    stone = 1.08 * ball
    for normal, depth in zip(normals, random.uniform(0.78, 1.0, _CHIPS), strict=True):
        beyond = np.maximum(stone @ normal - depth, 0)
        stone = stone - beyond[:, None] * normal
    return np.asarray(stone)


def _ball() -> NDArray[np.float64]:
    """Return points spread evenly over the unit sphere, shape (_CORNERS, 3)."""
    number = np.arange(_CORNERS) + 0.5
    up = 1 - 2 * number / _CORNERS
    around = number * pi * (1 + 5**0.5)
    across = np.sqrt(1 - up * up)
    return np.stack((across * np.cos(around), across * np.sin(around), up), 1)
