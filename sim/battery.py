"""The battery: voltage from charge, and how it sags under load."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

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
    """A pack of lithium-ion cells, and what hangs on it. A Jackal's has seven in series, 270 Wh.

    Attributes:
        cells: in series.
        capacity_j: energy when full.
        resistance_ohm: of cells, fuse and leads.
        idle_w: what computer, radio and camera draw.
        efficiency: mechanical power out of the motors by electrical power into them.
        heat_w_per_nm2: power that a wheel's motor turns into heat at a torque of 1 N m.
        fault_v: what a voltmeter shows at the fault BATTERY_LOW.
    """

    cells: int = 7
    capacity_j: float = 270 * 3600.0
    resistance_ohm: float = 0.12
    idle_w: float = 30.0
    efficiency: float = 0.7
    heat_w_per_nm2: float = 1.0
    fault_v: float = 21.5


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
        pack = self._pack
        power_w = self._load_j / self._load_s if self._load_s else pack.idle_w
        self._load_j = self._load_s = 0.0
        open_v = pack.cells * _cell_v(self._left_j / pack.capacity_j)
        return open_v - pack.resistance_ohm * power_w / open_v


def _cell_v(charge_ratio: float) -> float:
    """Return the voltage of a cell without load at a charge of 0 to 1."""
    for (low, low_v), (high, high_v) in pairwise(_CELL_CURVE):
        if charge_ratio <= high:
            part = (charge_ratio - low) / (high - low)
            return low_v + part * (high_v - low_v)
    return _CELL_CURVE[-1][1]
