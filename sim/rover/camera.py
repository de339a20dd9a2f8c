"""`Camera` of a simulated rover: pictures by OpenGL if available, else by ray casting.

Ray casting needs no graphics library and gives the same bits every time.
"""

import ctypes
import io
import logging
from dataclasses import dataclass
from enum import Enum
from importlib.util import find_spec
from math import radians, tan
from typing import TYPE_CHECKING, Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from executive.settings import figure
from sim.rover import scenery
from sim.rover.scenery import Image

if TYPE_CHECKING:
    from sim.rover.egl import EglRenderer

Floats = NDArray[np.float64]

_SEEN_GROUPS: Final = np.array([1, 1, 1, 0, 0, 0], np.uint8)
_SUN_M: Final = 200.0
_SHADOWS_WITHIN_M: Final = 40.0
_GRAZE_M: Final = 0.03


def focal_px(model: mujoco.MjModel, height_px: int) -> float:
    """Return the focal length of the rover's camera in pixels, for a picture height."""
    fovy_rad = radians(float(model.cam_fovy[model.camera("camera").id]))
    return height_px / 2 / tan(fovy_rad / 2)


class RayRenderer:
    """Casts one ray through every pixel, and one from the sun to its hit point."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        self._model = model
        self._shape = (height, width, 3)
        self._camera = model.camera("camera").id
        self._head = int(model.cam_bodyid[self._camera])
        self._terrain = model.body("terrain").id
        half = tan(radians(float(model.cam_fovy[self._camera])) / 2)
        right = (np.arange(width) + 0.5 - width / 2) * (2 * half / height)
        up = (height / 2 - 0.5 - np.arange(height)) * (2 * half / height)
        rays = np.stack(
            [*np.broadcast_arrays(right[None, :], up[:, None]), np.full((height, width), -1.0)], -1
        ).reshape(-1, 3)
        self._rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        self._sun = np.array(scenery.SUN_DIRECTION) / np.linalg.norm(scenery.SUN_DIRECTION)
        self._colours = _geom_colours(model)
        self._textures = {
            model.material("soil").id: (scenery.soil_texture(), scenery.TILE_M),
            model.material("rock").id: (scenery.rock_texture(), 1.0),
        }

    def render(self, data: mujoco.MjData) -> scenery.Image:
        """Return the picture of the rover's camera: shape (height, width, 3)."""
        rays = _turned(self._rays, data.cam_xmat[self._camera])
        origin = data.cam_xpos[self._camera].copy()
        geoms, distances, normals = self._cast(data, origin, rays, self._head)
        picture = _sky(rays)
        hit = np.flatnonzero(geoms >= 0)
        points = origin + rays[hit] * distances[hit, None]
        colours = self._surface(data, points, geoms[hit])
        light = self._light(data, origin, points, normals[hit], distances[hit])
        haze = np.clip(
            (distances[hit] - scenery.HAZE_START_M) / (scenery.HAZE_END_M - scenery.HAZE_START_M),
            0,
            1,
        )[:, None]
        picture[hit] = (1 - haze) * colours * light[:, None] + haze * scenery.HORIZON
        pixels = (np.clip(picture, 0, 1) * 255).astype(np.uint8)
        return np.asarray(pixels.reshape(self._shape))

    def _cast(
        self, data: mujoco.MjData, origin: Floats, rays: Floats, without: int
    ) -> tuple[NDArray[np.int32], Floats, Floats]:
        """Return geom, distance and normal of each ray's hit; geom -1 is none."""
        count = len(rays)
        geoms = np.empty(count, np.int32)
        distances = np.empty(count)
        normals = np.empty((count, 3))
        mujoco.mj_multiRay(
            self._model,
            data,
            origin,
            rays.ravel(),
            _SEEN_GROUPS,
            True,
            without,
            geoms,
            distances,
            normals.ravel(),
            count,
            1e4,
        )
        return geoms, distances, normals

    def _surface(self, data: mujoco.MjData, points: Floats, geoms: NDArray[np.int32]) -> Floats:
        """Return the colours of points on geoms, from their texture if they have one."""
        colours = self._colours[geoms]
        materials = self._model.geom_matid[geoms]
        level = _turned(points, data.xmat[self._terrain].reshape(3, 3).T)
        for material, (texture, tile_m) in self._textures.items():
            here = np.flatnonzero(materials == material)
            along = level[here, :2] + level[here, 2:]
            colours[here] = _sampled(texture, along * (texture.shape[0] / tile_m))
        return colours

    def _light(
        self,
        data: mujoco.MjData,
        origin: Floats,
        points: Floats,
        normals: Floats,
        distances: Floats,
    ) -> Floats:
        """Return the brightness of the points: ambient light, and the sun if it reaches them."""
        facing = np.clip(np.einsum("ni,i->n", normals, -self._sun), 0, None)
        near = np.flatnonzero((distances < _SHADOWS_WITHIN_M) & (facing > 0))
        sun = origin - _SUN_M * self._sun
        towards = points[near] - sun
        reach = np.linalg.norm(towards, axis=1)
        _, met, _ = self._cast(data, sun, towards / reach[:, None], -1)
        facing[near[(met >= 0) & (met < reach - _GRAZE_M)]] = 0
        return np.asarray(scenery.AMBIENT + scenery.SUNLIGHT * facing)


def _turned(vectors: Floats, rotation: Floats) -> Floats:
    """Return vectors, shape (n, 3), rotated by a rotation matrix.

    BLAS would wake a thread per core for this product, and its rounding depends on the machine.
    """
    return np.asarray(np.einsum("ni,ji->nj", vectors, rotation.reshape(3, 3)))


def _sampled(texture: scenery.Image, positions: Floats) -> Floats:
    """Return the colours of a repeated texture, interpolated between pixels: shape (n, 3)."""
    size = texture.shape[0]
    corner = np.floor(positions).astype(np.int64)
    right, up = (positions - corner).T[:, :, None]
    x, y = (corner % size).T
    beside, above = (x + 1) % size, (y + 1) % size
    low = (1 - right) * texture[y, x] + right * texture[y, beside]
    high = (1 - right) * texture[above, x] + right * texture[above, beside]
    return np.asarray(((1 - up) * low + up * high) / 255)


def _geom_colours(model: mujoco.MjModel) -> Floats:
    """Return the plain colour of each geom: shape (ngeom, 3)."""
    colours: Floats = model.geom_rgba[:, :3].astype(np.float64)
    painted = model.geom_matid >= 0
    colours[painted] = model.mat_rgba[model.geom_matid[painted], :3]
    return colours


def _sky(rays: Floats) -> Floats:
    """Return the colour of the sky in each direction."""
    up = np.clip(rays[:, 2:], 0, 1) ** 0.6
    return np.asarray((1 - up) * scenery.HORIZON + up * scenery.ZENITH)


_LOG = logging.getLogger(__name__)

Pillow.preinit()  # Else the first picture includes the loading of its encoders.


class Backend(Enum):
    """Renderer of pictures."""

    EGL = "egl"
    RAYS = "rays"


@dataclass(frozen=True, slots=True)
class PictureSettings:
    """Size and renderer of pictures."""

    width: int = figure(1, 1280, default=320)
    height: int = figure(1, 960, default=240)
    backend: Backend = Backend.RAYS


def best_backend() -> Backend:
    """Return EGL if its libraries load and PyOpenGL is installed, else ray casting."""
    try:
        ctypes.CDLL("libEGL.so.1")
        try:
            ctypes.CDLL("libGL.so.1")
        except OSError:
            ctypes.CDLL("libOpenGL.so.0")
    except OSError:
        return Backend.RAYS
    return Backend.EGL if find_spec("OpenGL") else Backend.RAYS


class Camera:
    """The rover's camera. Must be used by one thread only, as OpenGL requires.

    Attributes:
        backend: renderer of the pictures; ray casting from the first on if OpenGL fails.
    """

    def __init__(self, model: mujoco.MjModel, settings: PictureSettings) -> None:
        self._model = model
        self._settings = settings
        self.backend = settings.backend
        self._renderer: RayRenderer | EglRenderer | None = None

    def jpeg(self, data: mujoco.MjData) -> bytes:
        """Return the picture of a state."""
        return encode_jpeg(self.image(data))

    def image(self, data: mujoco.MjData) -> Image:
        """Return the picture of a state: shape (height, width, 3)."""
        if self._renderer is None:
            self._renderer = self._make_renderer()
        return self._renderer.render(data)

    def _make_renderer(self) -> "RayRenderer | EglRenderer":
        size = (self._settings.width, self._settings.height)
        if self.backend is Backend.EGL:
            try:
                from sim.rover.egl import make_egl_renderer

                return make_egl_renderer(self._model, *size)
            except (ImportError, RuntimeError) as error:
                _LOG.warning("No OpenGL (%s): pictures by ray casting", error)
                self.backend = Backend.RAYS
        return RayRenderer(self._model, *size)


def encode_jpeg(image: Image) -> bytes:
    """Return a picture of shape (height, width, 3) as JPEG."""
    buffer = io.BytesIO()
    Pillow.fromarray(image).save(buffer, "JPEG", quality=85)
    return buffer.getvalue()
