"""Times of a scenario, said as seconds from its start or from a stage of a command."""

import re
from dataclasses import dataclass
from typing import Final

from executive.reports import Stage
from sim.scenario.strict import figure

_AFTER: Final = re.compile(r"(\S+)\s+([A-Z]+)(?:\s*\+\s*(\d+(?:\.\d*)?))?")


@dataclass(frozen=True, slots=True)
class After:
    """When a command first reached a stage, and so many seconds on."""

    label: str
    stage: Stage
    delay_s: float = 0.0

    @classmethod
    def parse(cls, text: str) -> "After":
        """Read `LABEL STAGE` or `LABEL STAGE + SECONDS`.

        Raises:
            ValueError: it is neither.
        """
        found = _AFTER.fullmatch(text.strip())
        if found is None or found[2] not in Stage.__members__:
            raise ValueError(
                f"{text!r} is not LABEL STAGE or LABEL STAGE + SECONDS, with a stage of"
                f" {', '.join(Stage.__members__)}"
            )
        return cls(found[1], Stage[found[2]], float(found[3] or 0.0))

    def __str__(self) -> str:
        delay = f" + {self.delay_s:g} s" if self.delay_s else ""
        return f"{self.label} {self.stage.name}{delay}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Timed:
    """Something that has its time: `at`, `after`, or neither."""

    at_s: float | None = figure(default=None)
    after: After | None = None

    def __post_init__(self) -> None:
        if self.at_s is not None and self.after is not None:
            raise ValueError("at and after exclude each other")

    @property
    def at_end(self) -> bool:
        """Whether it has no time of its own."""
        return self.at_s is None and self.after is None

    @property
    def when(self) -> str:
        """The time in words."""
        if self.after is not None:
            return f"after {self.after}"
        return "at the end" if self.at_s is None else f"at {self.at_s:g} s"


@dataclass(frozen=True, slots=True, kw_only=True)
class Lasting(Timed):
    """Something that holds for a while from its time on; without a time, for the last while.

    Attributes:
        for_s: seconds; 0 for the moment alone.
    """

    for_s: float = figure(default=0.0)

    @property
    def period(self) -> str:
        """The while in words."""
        if not self.for_s:
            return self.when
        if self.at_end:
            return f"in the last {self.for_s:g} s"
        return f"{self.when} for {self.for_s:g} s"
