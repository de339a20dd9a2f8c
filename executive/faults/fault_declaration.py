"""What is declared of a fault, and the row that says what an asset does about it."""

from dataclasses import KW_ONLY, dataclass, field
from enum import Enum, unique
from math import radians
from typing import Final

from executive.values.reasons import Reason


@unique
class MonitoredWhen(Enum):
    """When a fault is watched for."""

    MOVING = "moving"
    ALWAYS = "always"


@unique
class Reaction(Enum):
    """What the rover does about a fault, from nothing to the most."""

    IGNORE = "ignore"
    WARN = "warn"
    SLOW_DOWN = "slow_down"
    PAUSE = "pause"
    STOP = "stop"
    SAFE = "safe"


@unique
class ClearPolicy(Enum):
    """How a fault ends: with its cause, or by a resume once its cause is gone."""

    ITSELF = "itself"
    ON_RESUME = "on_resume"


@unique
class Disproves(Enum):
    """Which sources show how wrong the pose may be, once a fault has shown that it may be wrong."""

    SENSORS = "sensors"
    """The velocity of the odometry itself, the wheels, the gyro."""
    COMMANDS = "commands"
    """What was commanded besides."""
    DISTANCE = "distance"
    """None: of all that was driven lately it is not known where it led."""


@dataclass(frozen=True, slots=True)
class FaultParameter:
    """What one figure of a row means.

    Attributes:
        what: the figure that is compared, for people.
        unit: of the figure, empty for a count or a ratio.
        low, high: what a file may say.
    """

    what: str
    unit: str
    low: float
    high: float

    def fault_of(self, value: float) -> str | None:
        """Return what is wrong with a value, or None."""
        if self.low <= value <= self.high:
            return None
        text = f"{value:g} is not in {self.low:g} .. {self.high:g} {self.unit}".rstrip()
        if self.unit.startswith("rad") and self.low <= radians(value) <= self.high:
            text += f": were degrees meant? Write {value:g}deg, or {radians(value):.4g}"
        return text


@dataclass(frozen=True, slots=True)
class Window:
    """By which figures a fault shows. One that the fault does not have is None.

    Attributes:
        name: of one of several, in files; the only window of a fault has none.
        for_s: how long the evidence must last before the fault begins.
        beyond, below: the bound of the figure that is compared.
        ratio: of the way, the turn or the speed in the window, added to `beyond`.
        within_s: the time over which the figure is taken.
    """

    name: str = ""
    _: KW_ONLY
    for_s: float = 0.0
    beyond: float | None = field(default=None, metadata={"angle": True})
    below: float | None = None
    ratio: float | None = None
    within_s: float | None = None

    @property
    def bound(self) -> float:
        """The bound of a window that has one."""
        found = self.beyond if self.below is None else self.below
        assert found is not None
        return found

    @property
    def length_s(self) -> float:
        """The time of a window that has one."""
        assert self.within_s is not None
        return self.within_s

    def allowed(self, amount: float) -> float:
        """Return the bound where this much was driven, turned or commanded in the window."""
        return self.bound + (self.ratio or 0.0) * abs(amount)


@dataclass(frozen=True, slots=True)
class FaultResponse:
    """What an asset does about one fault, which begins where one of its windows shows it."""

    when: MonitoredWhen
    then: Reaction
    clears: ClearPolicy
    windows: tuple[Window, ...] = (Window(),)

    @property
    def window(self) -> Window:
        """The window of a fault that has one."""
        (found,) = self.windows
        return found

    @property
    def bound(self) -> float:
        """The bound of a fault that has one window."""
        return self.window.bound


@dataclass(frozen=True, slots=True)
class FaultDeclaration:
    """What is known of a fault.

    Attributes:
        name: in files, reports and at the command line.
        summary: one sentence on what is wrong.
        row: what is done about it unless an asset says otherwise.
        source: which measurement gave the figures of the row, or that none is known.
        disproves: by what the pose may be wrong then; None where it may not.
        beyond, below, ratio, within: what these figures mean; None where its windows have none.
    """

    name: str
    reason: Reason
    summary: str
    row: FaultResponse
    source: str
    disproves: Disproves | None = None
    beyond: FaultParameter | None = None
    below: FaultParameter | None = None
    ratio: FaultParameter | None = None
    within: FaultParameter | None = None

    def check(self, row: FaultResponse) -> None:
        """Do nothing where a row fits.

        Raises:
            ValueError: a figure is out of its bounds, missing, or not one of this fault.
        """
        for window in row.windows:
            self._check(window)

    def _check(self, window: Window) -> None:
        path = ".".join(filter(None, (self.name, window.name)))
        meant = (self.beyond, self.below, self.ratio, self.within, _FOR)
        given = (window.beyond, window.below, window.ratio, window.within_s, window.for_s)
        for key, bound, value in zip(FIGURES, meant, given, strict=True):
            if (bound is None) != (value is None):
                had = [each for each, its in zip(FIGURES, meant, strict=True) if its is not None]
                lack = (
                    "is missing" if value is None else f"is not known; known are {', '.join(had)}"
                )
                raise ValueError(f"{path}.{key} {lack}")
            if bound is not None and value is not None and (wrong := bound.fault_of(value)):
                raise ValueError(f"{path}.{key}: {wrong} ({bound.what})")


FIGURES: Final = ("beyond", "below", "ratio", "within", "for")
_FOR: Final = FaultParameter("how long it lasts before it counts", "s", 0.0, 60.0)
