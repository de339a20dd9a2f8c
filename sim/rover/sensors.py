"""The sensors in an asset's settings, read during the physics of a Jackal."""

from collections.abc import Mapping
from math import gcd
from typing import Final

from numpy.random import default_rng

from executive.settings import Sensor, Sensors
from executive.values.facts import Fact
from sim.rover.body import SOON_S, STEP_S, STEPS_PER_PERIOD, SimulatedBody
from sim.rover.instruments import InertialUnit, Instrument, WheelSensors
from sim.rover.surroundings import Laser, VisualOdometry

_KINDS: Final[Mapping[Sensor, type[Instrument]]] = {
    Sensor.IMU: InertialUnit,
    Sensor.JOINTS: WheelSensors,
    Sensor.SECOND_ODOMETRY: VisualOdometry,
    Sensor.LASER: Laser,
}


class SensorSuite:
    """Reads each instrument at its rate, and delays its facts by its latency.

    Each instrument has separate random numbers.

    Attributes:
        every: steps of physics between two calls of `read`, a part of a period.
    """

    def __init__(self, sensors: Sensors, seed: int, rover: SimulatedBody) -> None:
        self._instruments = tuple(
            _KINDS[each](rover, getattr(sensors, each.value).rate_hz, default_rng([seed, number]))
            for number, each in enumerate(Sensor, 1)
            if each in sensors.present
        )
        self._due_s = dict.fromkeys(self._instruments, 0.0)
        self._delayed: list[tuple[float, Fact]] = []
        self.every = gcd(STEPS_PER_PERIOD, *(each.every for each in self._instruments))

    def read(self, steps: int) -> list[Fact]:
        """Return the facts published at a step of physics."""
        time_s = steps * STEP_S
        published = self._arrived(time_s)
        for instrument in self._instruments:
            if steps % instrument.every:
                continue
            fact = instrument.measure(time_s)
            if fact is None:
                continue
            if not instrument.latency_s:
                published.append(fact)
                continue
            due_s = max(time_s + instrument.latency_s, self._due_s[instrument])
            self._due_s[instrument] = due_s
            self._delayed.append((due_s, fact))
        return published

    def _arrived(self, time_s: float) -> list[Fact]:
        pending, until_s = self._delayed, time_s + SOON_S
        self._delayed = [each for each in pending if each[0] > until_s]
        return [fact for due_s, fact in pending if due_s <= until_s]
