"""Rocks of the model: an ellipsoid that wheels meet, and a chipped stone that cameras see."""

from math import cos, pi, sin
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.terrain import Terrain
from sim.world import World

_SUNK = 0.3
"""Part of a rock's height that is in the ground."""
_CHIPS = 14
_CORNERS = 160


def add_rocks(
    spec: mujoco.MjSpec,
    soil: mujoco.MjsBody,
    world: World,
    terrain: Terrain,
    contact: dict[str, Any],
) -> None:
    """Add the rocks of a world to its soil.

    Args:
        spec: gets the stones' shapes.
        soil: gets the rocks.
        world: says where they lie.
        terrain: says how high.
        contact: how a rock meets the rover, as attributes of a geom.
    """
    random = np.random.default_rng(len(world.all_rocks))
    ball = _ball()
    for number, rock in enumerate(world.all_rocks):
        half_m = rock.height_m / (2 * (1 - _SUNK))
        axes_m = np.array((rock.radius_m, rock.radius_m * random.uniform(0.7, 1.0), half_m))
        turn_rad = random.uniform(0, pi)
        ground_m = terrain.height_m(rock.x_m, rock.y_m)
        place = {
            "pos": (rock.x_m, rock.y_m, ground_m + rock.height_m - half_m),
            "quat": (cos(turn_rad / 2), 0, 0, sin(turn_rad / 2)),
            "material": "rock",
        }
        soil.add_geom(
            name=f"rock{number}",
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            size=axes_m,
            group=3,
            **contact,
            **place,
        )
        mesh = spec.add_mesh(name=f"stone{number}")
        mesh.uservert = (_chipped(ball, random) * axes_m).ravel()
        soil.add_geom(
            name=f"stone{number}",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=f"stone{number}",
            contype=0,
            conaffinity=0,
            **place,
        )


def _chipped(ball: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Return a ball with flat faces struck off it, whose convex hull MuJoCo makes a mesh of."""
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
