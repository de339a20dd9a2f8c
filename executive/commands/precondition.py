"""`Precondition`: the pose, earlier command and mode that a command needs.

A relative motion after a lost command starts at another pose than its sender expects. With a
precondition it is refused instead.
"""

import re
from dataclasses import dataclass
from math import isfinite, pi
from operator import index
from typing import Final, Self

from executive.commands.declaration import Mode
from executive.values.quantities import angle_text, read_quantity

_NUMBER: Final = r"-?[0-9]{1,20}(?:\.[0-9]{1,20})?(?:e[+-]?[0-9]{1,3})?"
_AT: Final = re.compile(f"{_NUMBER}(?: {_NUMBER}){{2}}(?:(?: {_NUMBER}){{2}})?")
_TYPED: Final = "X,Y,WITHIN,HEADING,WITHIN, e.g. 3,2,0.5,90deg,10deg"
_MODES: Final = Mode.__members__


@dataclass(frozen=True, slots=True)
class OnlyAt:
    """Bounds of the pose of base_link, in the frame of the parameters POS_X and POS_Y.

    Attributes:
        within_m: maximum distance from x and y, in the plane.
        heading_rad: heading; None for any.
        heading_within_rad: maximum angle from it, up to pi.

    Raises:
        ValueError: a number is not finite, a bound is not above zero, or the heading or its bound
            is missing.
    """

    x_m: float
    y_m: float
    within_m: float
    heading_rad: float | None = None
    heading_within_rad: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        within_rad = self.heading_within_rad
        if (self.heading_rad is None) != (within_rad is None):
            raise ValueError("a heading needs a bound")
        if not all(map(isfinite, self._numbers)):
            raise ValueError("a number is not finite")
        if self.within_m <= 0.0 or (within_rad is not None and not 0.0 < within_rad <= pi):
            raise ValueError("a bound is not above zero, or the heading's is above 180°")

    @property
    def _numbers(self) -> tuple[float, ...]:
        found = (self.x_m, self.y_m, self.within_m, self.heading_rad, self.heading_within_rad)
        return tuple(each for each in found if each is not None)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the bounds of their text on a link, in m and rad; raise ValueError for others."""
        if not _AT.fullmatch(text):
            raise ValueError("not X Y WITHIN [HEADING WITHIN]")
        return cls(*map(float, text.split(" ")))

    @classmethod
    def read(cls, text: str) -> Self:
        """Return the bounds as a person types them: `3,2,0.5,90deg,10deg`; else a ValueError."""
        parts = text.split(",")
        if len(parts) not in (3, 5):
            raise ValueError(f"{text!r} is no pose with bounds: write X,Y,WITHIN or {_TYPED}")
        units = ("m", "m", "m", "rad", "rad")
        read = (
            read_quantity(part, unit, bare=unit == "m")
            for part, unit in zip(parts, units, strict=False)
        )
        return cls(*read)

    @property
    def wire_text(self) -> str:
        """The text on a link: `X Y WITHIN [HEADING WITHIN]`, in m and rad."""
        return " ".join(map(repr, map(float, self._numbers)))

    def __str__(self) -> str:
        text = f"at x {self.x_m:.2f} m, y {self.y_m:.2f} m within {self.within_m:g} m"
        if self.heading_rad is None or self.heading_within_rad is None:
            return text
        return (
            f"{text}, {angle_text(self.heading_rad)} within {angle_text(self.heading_within_rad)}"
        )


@dataclass(frozen=True, slots=True)
class Precondition:
    """Conditions of a command; each is checked on arrival and at its start. A stop has none.

    Attributes:
        at: bounds of the pose.
        after: number of a command of the same source that must have ended EXECUTED.
        mode: mode of the asset.
    """

    at: OnlyAt | None = None
    after: int | None = None
    mode: Mode | None = None

    def __post_init__(self) -> None:
        """Raise ValueError for a number that no command has, TypeError for no integer."""
        if self.after is not None and not 0 < index(self.after) < 1 << 63:
            raise ValueError("a command number is an integer from 1")

    def __bool__(self) -> bool:
        """Whether there is any condition."""
        return (self.at, self.after, self.mode) != (None, None, None)

    @classmethod
    def from_wire(
        cls, at: str | None, after: int | None = None, mode: str | None = None
    ) -> "Self | None":
        """Return the precondition of its values on a link; None without one.

        Raises:
            ValueError: a value is none of its kind.
        """
        if (at, after, mode) == (None, None, None):
            return None
        if mode is not None and mode not in _MODES:
            raise ValueError(f"{mode[:20]!r} is no mode: {', '.join(_MODES)}")
        return cls(
            None if at is None else OnlyAt.parse(at), after, None if mode is None else Mode[mode]
        )

    @property
    def wire_values(self) -> tuple[str | None, int | None, str | None]:
        """The values on a link: bounds of the pose as text, command number, name of the mode."""
        at = None if self.at is None else self.at.wire_text
        return at, self.after, None if self.mode is None else self.mode.name

    def __str__(self) -> str:
        parts = (
            None if self.at is None else f"only {self.at}",
            None if self.after is None else f"only after number {self.after}",
            None if self.mode is None else f"only in mode {self.mode.name}",
        )
        return ", ".join(filter(None, parts))
