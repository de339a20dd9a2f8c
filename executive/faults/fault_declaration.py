"""`FaultDeclaration` of a fault; `FaultResponse`: an asset's bounds and reaction for it."""

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass, field
from enum import Enum, unique
from math import radians
from typing import Final

from executive.values.reasons import Reason


@unique
class MonitoredWhen(Enum):
    """When a fault is monitored."""

    MOVING = "moving"
    ALWAYS = "always"


@unique
class Reaction(Enum):
    """Reaction of the rover to a fault, in increasing order."""

    IGNORE = "ignore"
    WARN = "warn"
    SLOW_DOWN = "slow_down"
    PAUSE = "pause"
    STOP = "stop"
    SAFE = "safe"


@unique
class ClearPolicy(Enum):
    """How a fault clears: with its cause, or by a resume after its cause has ended."""

    AUTO = "auto"
    ON_RESUME = "on_resume"


@unique
class Disproves(Enum):
    """Sources that still bound the pose error, once a fault has made the pose uncertain."""

    SENSORS = "sensors"
    """The velocity of the odometry itself, the wheels, the gyro."""
    COMMANDS = "commands"
    """Also the commanded velocity."""
    DISTANCE = "distance"
    """None: the result of all recent motion is unknown."""


@dataclass(frozen=True, slots=True)
class FaultParameter:
    """Description of one figure of a row.

    Attributes:
        description: human-readable description of the compared figure.
        unit: unit of the figure, empty for a count or a ratio.
        low, high: bounds of the value in a file.
    """

    description: str
    unit: str
    low: float
    high: float

    def check(self, value: float) -> str | None:
        """Return the error of a value, or None."""
        if self.low <= value <= self.high:
            return None
        text = f"{value:g} is not in {self.low:g} .. {self.high:g} {self.unit}".rstrip()
        if self.unit.startswith("rad") and self.low <= radians(value) <= self.high:
            text += f": were degrees meant? Write {value:g}deg, or {radians(value):.4g}"
        return text


@dataclass(frozen=True, slots=True)
class Window:
    """Window and bounds of a fault's evidence. Figures that the fault does not use are None.

    Attributes:
        name: name of one of several windows, in files; the only window of a fault has none.
        for_s: debounce time: how long the evidence must last before the fault begins.
        above, below: the bound of the compared figure.
        ratio: ratio of the path, the turn or the speed in the window, added to `above`.
        window_s: the interval over which the figure is computed.
    """

    name: str = ""
    _: KW_ONLY
    for_s: float = 0.0
    above: float | None = field(default=None, metadata={"angle": True})
    below: float | None = None
    ratio: float | None = None
    window_s: float | None = None

    @property
    def bound(self) -> float:
        """The bound of a window that has one."""
        found = self.above if self.below is None else self.below
        assert found is not None
        return found

    @property
    def length_s(self) -> float:
        """The interval of a window that has one."""
        assert self.window_s is not None
        return self.window_s

    def allowed(self, amount: float) -> float:
        """Return the bound for this distance, turn or command in the window."""
        return self.bound + (self.ratio or 0.0) * abs(amount)


@dataclass(frozen=True, slots=True)
class FaultResponse:
    """Response of an asset to one fault, which begins if one of its windows shows it."""

    when: MonitoredWhen
    reaction: Reaction
    clears: ClearPolicy
    windows: tuple[Window, ...] = (Window(),)

    @property
    def window(self) -> Window:
        """The window of a fault with exactly one."""
        (found,) = self.windows
        return found

    @property
    def bound(self) -> float:
        """The bound of a fault with exactly one window."""
        return self.window.bound


@dataclass(frozen=True, slots=True)
class FaultDeclaration:
    """Declaration of a fault.

    Attributes:
        name: name in files, reports and at the command line.
        summary: one sentence that describes the fault.
        row: the response unless an asset sets another.
        source: measurement behind the figures of the row, or a statement that there is none.
        disproves: sources of the remaining pose uncertainty; None if the pose stays valid.
        above, below, ratio, window: descriptions of these figures; None if unused.
    """

    name: str
    reason: Reason
    summary: str
    row: FaultResponse
    source: str
    disproves: Disproves | None = None
    above: FaultParameter | None = None
    below: FaultParameter | None = None
    ratio: FaultParameter | None = None
    window: FaultParameter | None = None

    def check(self, row: FaultResponse) -> None:
        """Raise ValueError unless a row fits this fault.

        Raises:
            ValueError: a figure is out of its bounds, missing, or not used by this fault.
        """
        for window in row.windows:
            self._check(window)

    def _check(self, window: Window) -> None:
        path = ".".join(filter(None, (self.name, window.name)))
        meant = (self.above, self.below, self.ratio, self.window, _FOR)
        given = (window.above, window.below, window.ratio, window.window_s, window.for_s)
        for key, bound, value in zip(FIGURES, meant, given, strict=True):
            if (bound is None) != (value is None):
                had = [each for each, its in zip(FIGURES, meant, strict=True) if its is not None]
                lack = (
                    "is missing" if value is None else f"is not known; known are {', '.join(had)}"
                )
                raise ValueError(f"{path}.{key} {lack}")
            if bound is not None and value is not None and (wrong := bound.check(value)):
                raise ValueError(f"{path}.{key}: {wrong} ({bound.description})")


FIGURES: Final = ("above", "below", "ratio", "window", "for")
_FOR: Final = FaultParameter("duration of the evidence before the fault begins", "s", 0.0, 60.0)


@dataclass(frozen=True, slots=True)
class Unmonitored:
    """A quantity that is not monitored.

    Attributes:
        quantity: its name, for display, without a verb.
        cause: the missing sensor or the setting.
        faults: the faults of the table that cannot begin.
    """

    quantity: str
    cause: str
    faults: tuple[str, ...]

    def __str__(self) -> str:
        return f"not monitored: {self.quantity}: {self.cause}"


def summary(gaps: Iterable[Unmonitored]) -> str:
    """Return the unmonitored quantities in one line, grouped by cause."""
    by_cause: dict[str, list[str]] = {}
    for each in gaps:
        by_cause.setdefault(each.cause, []).append(each.quantity)
    parts = (f"{', '.join(names)} ({cause})" for cause, names in by_cause.items())
    return "; ".join(parts) or "nothing"
