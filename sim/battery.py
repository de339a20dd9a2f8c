"""The battery: voltage from charge, and how it sags under load."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

CELLS: Final = 7
_CELL_CURVE: Final = (
    (0.0, 3.00),
    (0.05, 3.35),
    (0.2, 3.55),
    (0.5, 3.70),
    (0.8, 3.97),
    (1.0, 4.16),
)
"""Open-circuit voltage of a lithium-ion cell over its charge."""


@dataclass(frozen=True, slots=True)
class Pack:
    """A Jackal's pack: seven lithium-ion cells in series, 270 Wh.

    Attributes:
        capacity_j: energy when full.
        resistance_ohm: of cells, fuse and leads.
        idle_w: what computer, radio and camera draw.
        efficiency: mechanical power out of the motors by electrical power into them.
    """

    capacity_j: float = 270 * 3600.0
    resistance_ohm: float = 0.12
    idle_w: float = 30.0
    efficiency: float = 0.7


class BatteryModel:
    """Charge that goes down with the load, and the voltage that is left."""

    def __init__(self, pack: Pack, charge_ratio: float) -> None:
        """Start with a charge of 0 to 1."""
        self._pack = pack
        self._left_j = pack.capacity_j * charge_ratio
        self._load_j = 0.0
        self._load_s = 0.0
        self.used_j = 0.0

    def draw(self, mechanical_j: float, period_s: float) -> None:
        """Take what a period costs: the motors' work and the idle load."""
        pack = self._pack
        energy_j = mechanical_j / pack.efficiency + pack.idle_w * period_s
        self.used_j += energy_j
        self._left_j = max(0.0, self._left_j - energy_j)
        self._load_j += energy_j
        self._load_s += period_s

    def voltage_v(self) -> float:
        """Return the voltage at the terminals under the mean load since the last call."""
        power_w = self._load_j / self._load_s if self._load_s else self._pack.idle_w
        self._load_j = self._load_s = 0.0
        open_v = open_circuit_v(self._left_j / self._pack.capacity_j)
        return open_v - self._pack.resistance_ohm * power_w / open_v


def open_circuit_v(charge_ratio: float) -> float:
    """Return the voltage of the pack without load at a charge of 0 to 1."""
    for (low, low_v), (high, high_v) in pairwise(_CELL_CURVE):
        if charge_ratio <= high:
            part = (charge_ratio - low) / (high - low)
            return CELLS * (low_v + part * (high_v - low_v))
    return CELLS * _CELL_CURVE[-1][1]
