"""The sensors that an asset's settings name, read as the physics of a Jackal goes on."""

from dataclasses import dataclass
from math import gcd
from typing import Final

import numpy as np

from executive.settings import Sensor, Sensors
from executive.values.facts import Fact
from sim.rover.body import STEP_S, STEPS_PER_PERIOD, SimulatedBody
from sim.rover.instruments import FaultLookup, InertialUnit, Instrument, WheelSensors
from sim.rover.surroundings import Laser, VisualOdometry

_SOON_S: Final = STEP_S / 2
"""Times are sums of steps; what is due within half a step is due."""


@dataclass(frozen=True, slots=True)
class _OnItsWay:
    due_s: float
    fact: Fact


class SensorSuite:
    """Reads each instrument at its rate, and holds back what is not published at once.

    Attributes:
        every: it is to be read each so many steps of physics, a part of a period.
    """

    def __init__(
        self, sensors: Sensors, seed: int, rover: SimulatedBody, fault: FaultLookup
    ) -> None:
        self._instruments = tuple(_instruments(sensors, seed, rover, fault))
        self._due_s = dict.fromkeys(self._instruments, 0.0)
        self._on_their_way: list[_OnItsWay] = []
        self.every = gcd(STEPS_PER_PERIOD, *(each.every for each in self._instruments))

    def read(self, steps: int) -> list[Fact]:
        """Return what is published after so many steps of physics."""
        time_s = steps * STEP_S
        published = self._arrived(time_s) if self._on_their_way else []
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
            self._on_their_way.append(_OnItsWay(due_s, fact))
        return published

    def _arrived(self, time_s: float) -> list[Fact]:
        arrived = [each for each in self._on_their_way if each.due_s <= time_s + _SOON_S]
        if arrived:
            self._on_their_way = [each for each in self._on_their_way if each not in arrived]
        return [each.fact for each in arrived]


def _instruments(
    sensors: Sensors, seed: int, rover: SimulatedBody, fault: FaultLookup
) -> list[Instrument]:
    """Return the instruments; each has random numbers that no other has."""
    random = {each: np.random.default_rng([seed, at]) for at, each in enumerate(Sensor, 1)}
    made: list[Instrument] = []
    if (imu := sensors.imu) is not None:
        made.append(InertialUnit(imu.rate_hz, fault, random[Sensor.IMU], rover.data))
    if (joints := sensors.joints) is not None:
        made.append(WheelSensors(joints.rate_hz, fault, random[Sensor.JOINTS], rover.data))
    if (second := sensors.second_odometry) is not None:
        made.append(VisualOdometry(second.rate_hz, fault, random[Sensor.SECOND_ODOMETRY], rover))
    if (laser := sensors.laser) is not None:
        made.append(Laser(laser.rate_hz, fault, random[Sensor.LASER], rover))
    return made
