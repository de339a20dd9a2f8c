"""`OtherDrivers`: other publishers of velocities that drive the base, through its twist_mux.

They publish to other inputs of the base's mux, or to the executive's own topic, and are identified
by their messages. Their motion is not commanded here; it is reported.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from executive.values.facts import ForeignMuxInput
from executive.values.reasons import Figure
from executive.values.reports import Severity

MUX_INPUT_HOLD_S: Final = 0.5
"""Timeout of a publisher; twist_mux masks lower inputs for the same time after a message."""


@dataclass(slots=True)
class Driver:
    """A publisher of velocities.

    Attributes:
        input: the newest fact.
        since_s, last_s: when its first and its newest message arrived.
        path_m, turn_rad: how far the rover went and turned while it drove, without signs.
    """

    input: ForeignMuxInput
    since_s: float
    last_s: float
    path_m: float = 0.0
    turn_rad: float = 0.0

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Duration of its publishing, and distance and turn of the rover in that time."""
        return (
            Figure("duration", round(self.last_s - self.since_s, 2), "s"),
            Figure("driven", round(self.path_m, 2), "m"),
            Figure("turned", round(self.turn_rad, 2), "rad"),
        )

    def __str__(self) -> str:
        return ", ".join(map(str, (self.input, *self.figures)))


class OtherDrivers:
    """Publishers of velocities other than the executive."""

    def __init__(self) -> None:
        self._drivers: dict[str, Driver] = {}
        self._reported: list[Driver] = []
        self._path_m = self._turn_rad = 0.0

    def observe(self, fact: ForeignMuxInput, now_s: float) -> None:
        """Add a message of a publisher."""
        driver = self._drivers.get(fact.name)
        if driver is None or now_s - driver.last_s > MUX_INPUT_HOLD_S:
            driver = self._drivers[fact.name] = Driver(fact, now_s, now_s)
        driver.input, driver.last_s = fact, now_s

    def active(self, now_s: float) -> list[Driver]:
        """Return the present publishers."""
        if not self._drivers:
            return []
        return [each for each in self._drivers.values() if now_s - each.last_s <= MUX_INPUT_HOLD_S]

    def update(
        self, active: list[Driver], path_m: float, turn_rad: float, commanding: bool
    ) -> Iterator[tuple[Severity, str, tuple[Figure, ...]]]:
        """Yield events of publishers that begin or end.

        Args:
            active: the present publishers.
            path_m: length of the rover's path by odometry, without signs.
            turn_rad: its accumulated turn, likewise.
            commanding: whether the executive moves it, so that lower inputs are masked.
        """
        for driver in active:
            if driver.input.overrides or not commanding:
                driver.path_m += path_m - self._path_m
                driver.turn_rad += turn_rad - self._turn_rad
            if not any(each is driver for each in self._reported):
                how = (
                    "drives the rover in place of the executive"
                    if driver.input.overrides
                    else "is active; it drives the base while the executive sends nothing"
                )
                yield Severity.WARNING, f"{driver.input} {how}", ()
        for driver in self._reported:
            if not any(each is driver for each in active):
                text = f"the rover is no longer commanded by {driver}"
                yield Severity.INFORMATIONAL, text, driver.figures
        self._reported, self._path_m, self._turn_rad = active, path_m, turn_rad
