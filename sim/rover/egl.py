"""`EglRenderer`: pictures by OpenGL without a display, through EGL.

The context is created here and not by `mujoco.Renderer`, which needs an environment variable
before the first import of mujoco.
"""

import weakref

import mujoco
import numpy as np
from mujoco.egl import GLContext
from OpenGL.error import Error

from sim.rover.scenery import Image

_GEOMS = 2000


class EglRenderer:
    """Renders with MuJoCo's OpenGL renderer; belongs to the thread that created it."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        self._model = model
        self._context = GLContext(width, height)
        self._context.make_current()
        self._gpu = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._gpu)
        weakref.finalize(self, _release, self._context, self._gpu).atexit = False
        self._scene = mujoco.MjvScene(model, _GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = True
        self._scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = False
        self._options = mujoco.MjvOption()
        self._options.geomgroup[:] = (1, 1, 1, 0, 0, 0)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = model.camera("camera").id
        self._view = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.empty((height, width, 3), np.uint8)

    def render(self, data: mujoco.MjData) -> Image:
        """Return the picture of the rover's camera: shape (height, width, 3)."""
        self._context.make_current()
        mujoco.mjv_updateScene(
            self._model,
            data,
            self._options,
            None,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        mujoco.mjr_render(self._view, self._scene, self._gpu)
        mujoco.mjr_readPixels(self._pixels, None, self._view, self._gpu)
        return self._pixels[::-1].copy()


def make_egl_renderer(model: mujoco.MjModel, width: int, height: int) -> EglRenderer:
    """Return a renderer for pictures of this size.

    Raises:
        RuntimeError: the libraries are installed, but none of their devices can draw.
    """
    try:
        return EglRenderer(model, width, height)
    except (Error, mujoco.FatalError) as error:
        raise RuntimeError(str(error)) from error


def _release(context: GLContext, gpu: mujoco.MjrContext) -> None:
    """Free the resources of a renderer, in its own context and not in another renderer's."""
    with context.as_current():
        gpu.free()
    context.free()
