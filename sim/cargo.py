"""What a simulated rover carries: a block on its deck that has mass while it is laden."""

from math import isfinite
from typing import Final

import mujoco

MOST_KG: Final = 50.0
_BLOCK: Final = "cargo"
_SEEN: Final = 1
_UNSEEN: Final = 5
"""Groups of geoms; pictures show the first three."""


def set_cargo(model: mujoco.MjModel, mass_kg: float) -> None:
    """Give the block on the deck a mass, spread evenly; with 0 it is gone.

    The rover's state stays as it is. Call it between two steps.

    Raises:
        ValueError: it is no mass, or more than 50 kg.
    """
    if not (isfinite(mass_kg) and 0 <= mass_kg <= MOST_KG):
        raise ValueError(f"a cargo of {mass_kg:g} kg is not in 0 .. {MOST_KG:g} kg")
    body, geom = model.body(_BLOCK), model.geom(_BLOCK)
    x2, y2, z2 = (half_m * half_m for half_m in geom.size)
    body.mass[:] = mass_kg
    body.inertia[:] = [mass_kg / 3 * each for each in (y2 + z2, x2 + z2, x2 + y2)]
    geom.group[:] = _SEEN if mass_kg else _UNSEEN
    mujoco.mj_setConst(model, mujoco.MjData(model))
