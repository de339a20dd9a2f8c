"""What can be expected of a run, and when: times from the start or from a stage of a command.

Each kind of expectation is a dataclass, told apart in the file by its first key.
"""

import re
from dataclasses import dataclass, field
from enum import Enum, unique
from typing import Final

from executive.commands import Mode
from executive.reasons import Reason
from executive.reports import PlanStatus, Severity, Stage
from executive.state import FileEventKind, Parameter
from sim.scenario.strict import ANGLE

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

    at_s: float | None = None
    after: After | None = None

    def __post_init__(self) -> None:
        if self.at_s is not None and self.after is not None:
            raise ValueError("at and after exclude each other")
        if self.at_s is not None and self.at_s < 0:
            raise ValueError(f"at: {self.at_s:g} is below 0")

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

    for_s: float = 0.0

    def __post_init__(self) -> None:
        Timed.__post_init__(self)
        if self.for_s < 0:
            raise ValueError(f"for: {self.for_s:g} is below 0")

    @property
    def period(self) -> str:
        """The while in words."""
        if not self.for_s:
            return self.when
        if self.at_end:
            return f"in the last {self.for_s:g} s"
        return f"{self.when} for {self.for_s:g} s"


def _not_below(least: float, name: str, value: float) -> None:
    if value < least:
        raise ValueError(f"{name}: {value:g} is below {least:g}")


@unique
class Answer(Enum):
    """What the link that brought a command is told at once."""

    ADMITTED = "admitted"
    REFUSED = "refused"
    DUPLICATE = "duplicate"
    """The number was used before, by this command or another."""
    LOST = "lost"
    """Nobody was there to answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandLife:
    """How a command lives.

    Attributes:
        command: its label.
        stages: all its stages, in order, without repeats of reports.
        ends: its last stage.
        reason: the reason in its last report.
        answers: what was answered each time it was sent.
        within_s: seconds from RECEIVED to its end at most.
    """

    command: str
    stages: tuple[Stage, ...] | None = None
    ends: Stage | None = None
    reason: Reason | None = None
    answers: tuple[Answer, ...] | None = None
    within_s: float | None = None

    def __post_init__(self) -> None:
        said = (self.stages, self.ends, self.reason, self.answers, self.within_s)
        if all(each is None for each in said):
            raise ValueError("one of stages, ends, reason, answers, within is needed")


@dataclass(frozen=True, slots=True)
class Place:
    """Where base_link is, in the frame of the world; the heading may be left open."""

    x_m: float
    y_m: float
    heading_rad: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseIs(Timed):
    """Where the rover truly is.

    Attributes:
        tolerance_m: greatest distance from the place.
        heading_tolerance_rad: greatest angle from the heading.
    """

    pose: Place
    tolerance_m: float
    heading_tolerance_rad: float = 0.05

    def __post_init__(self) -> None:
        Timed.__post_init__(self)
        _not_below(0, "tolerance", self.tolerance_m)
        _not_below(0, "heading_tolerance", self.heading_tolerance_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterIs(Lasting):
    """What a telemetry parameter says: the first value after the time, or all in a while.

    Attributes:
        asked: the label of a question; its answer is looked at instead of telemetry.
    """

    parameter: Parameter
    value: float = field(metadata=ANGLE)
    tolerance: float = field(default=0.0, metadata=ANGLE)
    asked: str | None = None

    def __post_init__(self) -> None:
        Lasting.__post_init__(self)
        _not_below(0, "tolerance", self.tolerance)


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetryCount(Lasting):
    """How often each of the twelve parameters arrives in a while."""

    telemetry: int
    tolerance: int = 0

    def __post_init__(self) -> None:
        Lasting.__post_init__(self)
        _not_below(0, "telemetry", self.telemetry)
        _not_below(0, "tolerance", self.tolerance)


@unique
class Movement(Enum):
    """Whether the rover goes anywhere."""

    STANDS = "stands"
    MOVES = "moves"


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverMoves(Lasting):
    """Whether the rover truly stands throughout a while, or moves within it."""

    rover: Movement

    def __post_init__(self) -> None:
        Lasting.__post_init__(self)
        if not self.for_s:
            raise ValueError("for: missing, or 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeIs(Timed):
    """The asset's mode."""

    mode: Mode


@dataclass(frozen=True, slots=True, kw_only=True)
class Pictures:
    """Pictures that the rover has stored by the end: JPEG files that decode and show something.

    Attributes:
        width_px, height_px: the size of each; None for any.
    """

    pictures: int
    width_px: int | None = None
    height_px: int | None = None

    def __post_init__(self) -> None:
        _not_below(0, "pictures", self.pictures)


@dataclass(frozen=True, slots=True, kw_only=True)
class Events:
    """How often the rover reports an event with a reason, of no command."""

    event: Reason
    count: int = 1

    def __post_init__(self) -> None:
        _not_below(0, "count", self.count)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkTells:
    """How often the relay tells something of itself, of a severity; with --link relay only."""

    link: Severity
    count: int = 1

    def __post_init__(self) -> None:
        _not_below(0, "count", self.count)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanIs(Timed):
    """Where a plan is in its life.

    Attributes:
        plan: its id.
    """

    plan: str
    status: PlanStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class FileLife:
    """Everything that is told of one file aboard.

    Attributes:
        file: its path.
        events: what happened to it aboard, in order; TRANSFERRED is what `fetched` is about.
    """

    file: str
    events: tuple[FileEventKind, ...]

    def __post_init__(self) -> None:
        if FileEventKind.TRANSFERRED in self.events:
            raise ValueError("events: whether it was TRANSFERRED, fetched says")


@dataclass(frozen=True, slots=True, kw_only=True)
class FileList:
    """Which files there are, all of them.

    Attributes:
        files: their paths.
        asked: the label of a question; its answer is looked at.
    """

    files: tuple[str, ...]
    asked: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FileFetched:
    """Every time a file was fetched, it came octet for octet, of the checksum that was told."""

    fetched: str


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoComes(Lasting):
    """Pictures of the video stream that arrive on the ground while it lasts; with --live only.

    Attributes:
        video: how many whole ones at least, each showing something; 0 for no datagram at all.
    """

    video: int

    def __post_init__(self) -> None:
        Lasting.__post_init__(self)
        _not_below(0, "video", self.video)
        if not self.for_s:
            raise ValueError("for: missing, or 0")


Expectation = (
    CommandLife
    | PoseIs
    | ParameterIs
    | TelemetryCount
    | RoverMoves
    | ModeIs
    | Pictures
    | Events
    | LinkTells
    | PlanIs
    | FileLife
    | FileList
    | FileFetched
    | VideoComes
)
