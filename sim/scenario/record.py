"""What was seen in a run, whoever ran it: all that a verdict goes by. Times are of the scenario."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, unique
from math import inf
from pathlib import Path
from typing import Final, TypeVar

from executive.commands import Mode, Request
from executive.history import CommandHistory, RunHistory
from executive.obstacles.zones import ScannedObstacle
from executive.settings import figure
from executive.values.geometry import Point, Pose
from executive.values.parameters import Parameter, ParameterValue
from executive.values.reports import (
    FileEvent,
    Identity,
    PlanUpdate,
    Report,
    ReportKind,
    Severity,
    Stage,
)

ENDED: Final = "ENDED"
"""In place of a stage: whichever way the command ends."""
_STAGES: Final = {
    **{stage.name: (stage,) for stage in Stage},
    ENDED: tuple(stage for stage in Stage if stage.terminal),
}
_AFTER: Final = re.compile(r"(\S+)\s+([A-Z]+)(?:\s*\+\s*(\d+(?:\.\d*)?))?")


@dataclass(frozen=True, slots=True)
class StageTime:
    """When a command first reached a stage, and so many seconds on.

    Attributes:
        stage: the name of a stage, or `ENDED`.
    """

    label: str
    stage: str
    delay_s: float = 0.0

    @classmethod
    def parse(cls, text: str) -> "StageTime":
        """Read `LABEL STAGE` or `LABEL STAGE + SECONDS`.

        Raises:
            ValueError: it is neither.
        """
        found = _AFTER.fullmatch(text.strip())
        if found is None or found[2] not in _STAGES:
            raise ValueError(
                f"{text!r} is not LABEL STAGE or LABEL STAGE + SECONDS, with a stage of"
                f" {', '.join(_STAGES)}"
            )
        return cls(found[1], found[2], float(found[3] or 0.0))

    def __str__(self) -> str:
        delay = f" + {self.delay_s:g} s" if self.delay_s else ""
        return f"{self.label} {self.stage}{delay}"

    def comes_with(self, report: Report) -> bool:
        """Return whether it is the stage of this report; by the orbiter it can only be EXPIRED."""
        stage = Stage.EXPIRED if report.kind is ReportKind.LINK else report.stage
        return stage in _STAGES[self.stage]


@dataclass(frozen=True, slots=True)
class Near:
    """Where the rover has to come: so near to a place."""

    x_m: float
    y_m: float
    within_m: float = figure(0.01)

    def __str__(self) -> str:
        return f"within {self.within_m:g} m of x {self.x_m:g} y {self.y_m:g}"

    def reached(self, pose: Pose) -> bool:
        """Return whether a pose is so near."""
        return pose.point.distance_m(Point(self.x_m, self.y_m)) <= self.within_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Scheduled:
    """Something that has its time: `at`, `after`, or neither.

    Attributes:
        near: where the rover must come, from that time on, before it is time.
    """

    at_s: float | None = figure(default=None)
    after: StageTime | None = None
    near: Near | None = None

    def __post_init__(self) -> None:
        if self.at_s is not None and self.after is not None:
            raise ValueError("at and after exclude each other")

    @property
    def at_end(self) -> bool:
        """Whether it has no time of its own."""
        return self.at_s is None and self.after is None and self.near is None

    @property
    def when(self) -> str:
        """The time in words."""
        if self.at_end:
            return "at the end"
        at = None if self.at_s is None else f"at {self.at_s:g} s"
        after = None if self.after is None else f"after {self.after}"
        return ", ".join(str(said) for said in (at, after, self.near) if said is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScheduledInterval(Scheduled):
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


NEVER: Final = "that time never came"
ALMOST_S: Final = 1e-6
"""Times that differ by less are the same: stamps in UTC have no more digits."""


@dataclass(frozen=True, slots=True)
class Check:
    """What was expected, what was seen, and whether the one holds of the other.

    Attributes:
        subject: what it is about: a command, the pose, a parameter.
    """

    subject: str
    expected: str
    seen: str
    holds: bool


def joined(subject: str, aspects: Sequence[Check]) -> Check:
    """Return several findings about one subject as one."""
    return Check(
        subject,
        ", ".join(aspect.expected for aspect in aspects),
        ", ".join(aspect.seen for aspect in aspects),
        all(aspect.holds for aspect in aspects),
    )


@unique
class Answer(Enum):
    """What the link that brought a command is told at once."""

    ADMITTED = "admitted"
    REFUSED = "refused"
    DUPLICATE = "duplicate"
    """The number was used before, by this command or another."""
    LOST = "lost"
    """Nobody was there to answer."""


@dataclass(frozen=True, slots=True)
class TruePose:
    """Where the rover truly was."""

    time_s: float
    pose: Pose


@dataclass(frozen=True, slots=True)
class ReceivedValue:
    """A parameter value that reached the ground, with the time aboard when it was sampled."""

    time_s: float
    parameter: Parameter
    value: float | None


@dataclass(frozen=True, slots=True)
class ModeSample:
    """The mode at a time."""

    time_s: float
    mode: Mode


@dataclass(frozen=True, slots=True)
class SentCommand:
    """A command that was sent, or sent again, and what was answered.

    Attributes:
        text: of the answer, if it is an error.
        answered_s: when the answer was received.
    """

    label: str
    identity: Identity
    time_s: float
    answer: Answer
    link: str = "direct"
    text: str = ""
    answered_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Receipt:
    """A report that was received on the ground: when, and by which link.

    Attributes:
        made_s: when it was made aboard.
    """

    time_s: float
    made_s: float
    link: str
    report: Report


@dataclass(frozen=True, slots=True)
class SeenStatus:
    """The status of the rover, or by the relay of the orbiter too, when it was received.

    Attributes:
        values: of the parameters that are known, by their names.
    """

    time_s: float
    link: str
    mode: Mode | None
    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class AdmittedRequest:
    """What a command that was received asks for, whether the ground sent it or a plan gave it."""

    identity: Identity
    request: Request


@dataclass(frozen=True, slots=True)
class FaultChange:
    """A fault that began, or ended.

    Attributes:
        name: as files write it.
    """

    time_s: float
    name: str
    begins: bool


@dataclass(frozen=True, slots=True)
class QueryAnswer:
    """A question, and the values and paths of files that answered it."""

    label: str
    values: tuple[ReceivedValue, ...]
    files: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Fetched:
    """A file that was fetched.

    Attributes:
        came: what is on the ground.
        aboard: what was there then.
        checksum: the CRC-32 that the rover told.
    """

    path: str
    came: bytes
    aboard: bytes
    checksum: int


@dataclass(frozen=True, slots=True)
class FetchFailed:
    """A file that could not be fetched, and why."""

    path: str
    why: str


@dataclass(frozen=True, slots=True)
class Datagram:
    """One of the video stream, on the ground.

    Attributes:
        picture: the JPEG file that it completes, if it does.
    """

    time_s: float
    picture: bytes | None


S = TypeVar("S", TruePose, ReceivedValue, ModeSample, Datagram)
"""Something seen at a time."""


@dataclass(slots=True)
class Record:
    """One run.

    Attributes:
        start_utc_s: UTC of the rover's clock at the scenario's time 0.
        files: the folder aboard that mission control sees.
        clock: what a clock shows at a UTC whose seconds are those of the scenario.
        reports: in the order heard, repeats included.
            Of a command they are those by the link by which it was sent first: by another MOCUP's
            brick reports under numbers of its own.
        receipts: of all reports of a live run, by each link.
        main_link: by which commands went that named none.
        first_links: of a live run, by which link each command was sent first.
        statuses: of each link of a live run, in the order received.
        odometry: where it was by odometry; empty in lock step, where telemetry has all of it.
        requested: what each command that was received asks for, as far as that is known.
        played: how many entries of the timeline were carried out.
        energy_j: drawn from the battery; None where the simulation does not tell.
        contacts: how often the rover began to touch a rock, a wall or a step; None likewise.
        seen: what its laser had seen around it at the end, as far as that is known.
        simulated_s, wall_s: how long it lasted aboard and here, once the rover stood in its world.
    """

    start_utc_s: float
    files: Path
    clock: Callable[[float], float] = float
    reports: list[Report] = field(default_factory=list)
    receipts: list[Receipt] = field(default_factory=list)
    main_link: str = "direct"
    first_links: dict[Identity, str] = field(default_factory=dict)
    statuses: list[SeenStatus] = field(default_factory=list)
    values: list[ReceivedValue] = field(default_factory=list)
    answers: list[QueryAnswer] = field(default_factory=list)
    poses: list[TruePose] = field(default_factory=list)
    odometry: list[Pose] = field(default_factory=list)
    modes: list[ModeSample] = field(default_factory=list)
    sendings: list[SentCommand] = field(default_factory=list)
    requested: list[AdmittedRequest] = field(default_factory=list)
    faults: list[FaultChange] = field(default_factory=list)
    file_events: list[FileEvent] = field(default_factory=list)
    plans: list[PlanUpdate] = field(default_factory=list)
    fetched: list[Fetched | FetchFailed] = field(default_factory=list)
    video: list[Datagram] = field(default_factory=list)
    played: int = 0
    energy_j: float | None = None
    contacts: int | None = None
    seen: tuple[ScannedObstacle, ...] = ()
    simulated_s: float = 0.0
    wall_s: float = 0.0

    def since_start_s(self, utc_s: float) -> float:
        """Return the time of the scenario at which it was this UTC."""
        return self.clock(utc_s) - self.clock(self.start_utc_s)

    def heard(self, values: Sequence[ParameterValue]) -> tuple[ReceivedValue, ...]:
        """Return values with times of the scenario."""
        return tuple(
            ReceivedValue(self.since_start_s(value.utc_s), value.parameter, value.value)
            for value in values
        )

    def receive(self, reports: Iterable[Report], link: str, utc_s: float) -> None:
        """Add reports that were received by a link."""
        for report in reports:
            first = self.first_links.get(report.identity) if report.identity else None
            if link == (first or self.main_link):
                self.reports.append(report)
            receipt = Receipt(self.since_start_s(utc_s), self.time_of(report), link, report)
            self.receipts.append(receipt)

    def time_of(self, report: Report) -> float:
        """Return when a report was made."""
        return self.since_start_s(report.utc_s)

    def identity(self, label: str) -> Identity | None:
        """Return under which identity a command was sent, if it was."""
        return next((sent.identity for sent in self.sendings if sent.label == label), None)

    def label(self, identity: Identity) -> str:
        """Return the label of a command; the identity, of one that the ground did not send."""
        labels = (sent.label for sent in self.sendings if sent.identity == identity)
        return next(labels, str(identity))

    def life(self, label: str) -> tuple[Report, ...]:
        """Return the reports of the stages of a command, each once, in order."""
        identity = self.identity(label)
        life = None if identity is None else self.lives().get(identity)
        return () if life is None else life.stages

    def given_up(self, label: str) -> Report | None:
        """Return what the orbiter reported if a command's lifetime ended there."""
        identity = self.identity(label)
        return next((each for each in self.reports if gives_up(each, identity)), None)

    def lives(self) -> dict[Identity, CommandHistory]:
        """Return what became of each command that was reported on."""
        once = {(report.sequence, report.identity): report for report in self.reports}
        reports = tuple(sorted(once.values(), key=lambda report: report.sequence))
        return RunHistory(self.start_utc_s, reports).lives()

    def moment(self, timed: Scheduled) -> float | None:
        """Return when something is or was to be, or None while that is not known.

        What has no time of its own is at the end.
        """
        begin_s, near = self._begin_s(timed), timed.near
        if near is None or begin_s is None:
            return begin_s
        from_then_on = between(self.poses, begin_s, inf)
        return next((seen.time_s for seen in from_then_on if near.reached(seen.pose)), None)

    def _begin_s(self, timed: Scheduled) -> float | None:
        """Return when something is to be, wherever the rover is then."""
        after = timed.after
        if after is None:
            last_s = self.simulated_s if timed.at_end else 0.0
            return last_s if timed.at_s is None else timed.at_s
        given_up = self.given_up(after.label)
        for report in (*self.life(after.label), *([given_up] if given_up else ())):
            if after.comes_with(report):
                return self.time_of(report) + after.delay_s
        return None

    def sample(self, samples: Sequence[S], timed: Scheduled) -> S | None:
        """Return the first sample after a time; the last one, for what is at the end."""
        if timed.at_end:
            return samples[-1] if samples else None
        time_s = self.moment(timed)
        if time_s is None:
            return None
        return next((each for each in samples if each.time_s > time_s + ALMOST_S), None)

    def during(self, samples: Sequence[S], lasting: ScheduledInterval) -> Sequence[S]:
        """Return the samples of a while; of the last while, for what is at the end."""
        start_s = self.moment(lasting)
        if start_s is None:
            return ()
        if lasting.at_end:
            start_s -= lasting.for_s
        return between(samples, start_s, start_s + lasting.for_s)


def gives_up(report: Report, identity: Identity | None) -> bool:
    """Return whether the orbiter reports that it does not forward this command any more."""
    alarm = (report.kind, report.severity) == (ReportKind.LINK, Severity.ALARM)
    return alarm and identity is not None and report.identity == identity


def between(samples: Sequence[S], start_s: float, end_s: float) -> Sequence[S]:
    """Return the samples after a time and until another."""
    return [each for each in samples if start_s + ALMOST_S < each.time_s <= end_s + ALMOST_S]
