"""Pictures of what the rover's camera sees, as JPEG.

Two backends see the same scene: OpenGL through EGL where the machine has it, and ray casting on
the processor, which needs nothing and repeats bit for bit.
"""

import ctypes
import io
import logging
from dataclasses import dataclass
from enum import Enum
from importlib.util import find_spec
from typing import Protocol, assert_never

import mujoco
from PIL import Image as Pillow

from sim.rays import RayRenderer
from sim.scenery import Image

_LOG = logging.getLogger(__name__)

Pillow.preinit()  # Else the first picture pays for loading its encoders.


class Backend(Enum):
    """How a picture is made."""

    EGL = "egl"
    RAYS = "rays"


@dataclass(frozen=True, slots=True)
class PictureSettings:
    """Size and quality of pictures."""

    width: int = 320
    height: int = 240
    quality: int = 85
    backend: Backend = Backend.RAYS


class Renderer(Protocol):
    """Makes pictures of a model's states."""

    def render(self, data: mujoco.MjData) -> Image:
        """Return what the rover's camera sees: shape (height, width, 3)."""
        ...


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
    """The rover's camera. Must be used by one thread only, as OpenGL demands."""

    def __init__(self, model: mujoco.MjModel, settings: PictureSettings) -> None:
        """Remember how pictures shall be; the renderer is made for the first one."""
        self._model = model
        self._settings = settings
        self._renderer: Renderer | None = None

    def jpeg(self, data: mujoco.MjData) -> bytes:
        """Return the picture of a state."""
        return encode_jpeg(self.image(data), self._settings.quality)

    def image(self, data: mujoco.MjData) -> Image:
        """Return the picture of a state: shape (height, width, 3)."""
        if self._renderer is None:
            self._renderer = self._make_renderer()
        return self._renderer.render(data)

    def _make_renderer(self) -> Renderer:
        size = (self._settings.width, self._settings.height)
        match self._settings.backend:
            case Backend.EGL:
                from sim.egl import NoGraphicsError, make_egl_renderer

                try:
                    return make_egl_renderer(self._model, *size)
                except NoGraphicsError as error:
                    _LOG.warning("No OpenGL (%s): pictures come by ray casting", error)
                    return RayRenderer(self._model, *size)
            case Backend.RAYS:
                return RayRenderer(self._model, *size)
            case other:
                assert_never(other)


def encode_jpeg(image: Image, quality: int) -> bytes:
    """Return a picture of shape (height, width, 3) as JPEG."""
    buffer = io.BytesIO()
    Pillow.fromarray(image).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()
