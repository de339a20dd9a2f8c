"""`Record` of a run, lock step or live, the only input of its evaluation, in scenario time."""

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
"""Any terminal stage."""
_STAGES: Final = {
    **{stage.name: (stage,) for stage in Stage},
    ENDED: tuple(stage for stage in Stage if stage.terminal),
}
_AFTER: Final = re.compile(r"(\S+)\s+([A-Z]+)(?:\s*\+\s*(\d+(?:\.\d*)?))?")


@dataclass(frozen=True, slots=True)
class StageTime:
    """Time when a command first reaches a stage, plus a delay.

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
            ValueError: the text has neither form.
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

    def matches(self, report: Report) -> bool:
        """Return whether this report has the stage; a report of the orbiter counts as EXPIRED."""
        stage = Stage.EXPIRED if report.kind is ReportKind.LINK else report.stage
        return stage in _STAGES[self.stage]


@dataclass(frozen=True, slots=True)
class Near:
    """Circle that the rover must enter."""

    x_m: float
    y_m: float
    within_m: float = figure(0.01)

    def __str__(self) -> str:
        return f"within {self.within_m:g} m of x {self.x_m:g} y {self.y_m:g}"

    def reached(self, pose: Pose) -> bool:
        """Return whether a pose lies in the circle."""
        return pose.point.distance_m(Point(self.x_m, self.y_m)) <= self.within_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Scheduled:
    """An item with a time: `at`, `after`, or neither.

    Attributes:
        near: circle that the rover must enter after that time; the item is due then.
    """

    at_s: float | None = figure(default=None)
    after: StageTime | None = None
    near: Near | None = None

    def __post_init__(self) -> None:
        if self.at_s is not None and self.after is not None:
            raise ValueError("at and after exclude each other")

    @property
    def at_end(self) -> bool:
        """Whether the item has no time and is due at the end of the run."""
        return self.at_s is None and self.after is None and self.near is None

    @property
    def time_text(self) -> str:
        """Time as text."""
        if self.at_end:
            return "at the end"
        at = None if self.at_s is None else f"at {self.at_s:g} s"
        after = None if self.after is None else f"after {self.after}"
        return ", ".join(str(each) for each in (at, after, self.near) if each is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScheduledInterval(Scheduled):
    """An item with an interval from its time on; without a time, up to the end of the run.

    Attributes:
        for_s: length of the interval in seconds; 0 for a single instant.
    """

    for_s: float = figure(default=0.0)

    @property
    def interval_text(self) -> str:
        """Interval as text."""
        if not self.for_s:
            return self.time_text
        if self.at_end:
            return f"in the last {self.for_s:g} s"
        return f"{self.time_text} for {self.for_s:g} s"


NEVER: Final = "time not reached"
ALMOST_S: Final = 1e-6
"""Tolerance of equal times: stamps in UTC have no finer digits."""


@dataclass(frozen=True, slots=True)
class Check:
    """Expected and observed value, and whether they agree.

    Attributes:
        subject: checked object, such as a command, the pose, a parameter.
    """

    subject: str
    expected: str
    observed: str
    passed: bool


def joined(subject: str, aspects: Sequence[Check]) -> Check:
    """Return several checks of one subject as one."""
    return Check(
        subject,
        ", ".join(aspect.expected for aspect in aspects),
        ", ".join(aspect.observed for aspect in aspects),
        all(aspect.passed for aspect in aspects),
    )


@unique
class Answer(Enum):
    """Immediate answer to a submitted command on its link."""

    ACCEPTED = "accepted"
    REJECTED = "rejected"
    DUPLICATE = "duplicate"
    """The number was used before, by this command or another."""
    LOST = "lost"
    """No contact: no answer."""


@dataclass(frozen=True, slots=True)
class TruePose:
    """True pose of the rover at a time."""

    time_s: float
    pose: Pose


@dataclass(frozen=True, slots=True)
class ValueSample:
    """A parameter value received on the ground, with its sampling time aboard."""

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
    """A command that was sent, or sent again, and its answer.

    Attributes:
        text: text of the answer, if it is an error.
        answered_s: time of receipt of the answer.
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
    """A report received on the ground, with its link and time of receipt.

    Attributes:
        made_s: creation time aboard.
    """

    time_s: float
    made_s: float
    link: str
    report: Report


@dataclass(frozen=True, slots=True)
class SeenStatus:
    """Received status of the rover; over the relay also of the orbiter.

    Attributes:
        age_s: time from its creation by the sender to its reception, s.
        values: values of the known parameters by their names.
    """

    time_s: float
    age_s: float
    link: str
    mode: Mode | None
    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class AdmittedRequest:
    """Request of a received command, sent by the ground or by a plan."""

    identity: Identity
    request: Request


@dataclass(frozen=True, slots=True)
class FaultChange:
    """Begin or end of a simulated fault.

    Attributes:
        name: its name in scenario files.
    """

    time_s: float
    name: str
    begins: bool


@dataclass(frozen=True, slots=True)
class QueryAnswer:
    """Answer to a query: values, and paths of files."""

    label: str
    values: tuple[ValueSample, ...]
    files: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Fetched:
    """A file that was fetched.

    Attributes:
        aboard: octets of the file aboard at that time.
        checksum: CRC-32 reported by the rover.
    """

    path: str
    received: bytes
    aboard: bytes
    checksum: int


@dataclass(frozen=True, slots=True)
class FetchFailed:
    """A file that could not be fetched, with the reason."""

    path: str
    reason: str


@dataclass(frozen=True, slots=True)
class Datagram:
    """A received datagram of the video stream.

    Attributes:
        picture: JPEG file completed by it, or None.
    """

    time_s: float
    picture: bytes | None


S = TypeVar("S", TruePose, ValueSample, ModeSample, Datagram)
"""Sample with a time."""


@dataclass(slots=True)
class Record:
    """Record of one run.

    Attributes:
        start_utc_s: UTC of the rover's clock at scenario time 0.
        files: folder aboard that mission control can read.
        clock: maps a UTC to seconds of the scenario's clock.
        reports: received reports in order, repeats included. A command's reports are those on the
            link of its first transmission: on the other link MOCUP's brick uses its own numbers.
        receipts: receipts of all reports of a live run, on each link.
        main_link: link of the commands that name none.
        first_links: link of each command's first transmission, in a live run.
        statuses: statuses of each link of a live run, in the order of receipt.
        odometry: poses of odometry; empty in lock step, where telemetry has all of them.
        requested: requests of the received commands, as far as known.
        played: number of executed entries of the timeline.
        energy_j: energy drawn from the battery; None if the simulation does not provide it.
        contacts: number of new contacts with a rock, a wall or a step; None likewise.
        seen: obstacles scanned by the laser up to the end, as far as known.
        simulated_s, wall_s: duration in simulated and in wall-clock time, from the rover's
            placement in its world.
    """

    start_utc_s: float
    files: Path
    clock: Callable[[float], float] = float
    reports: list[Report] = field(default_factory=list)
    receipts: list[Receipt] = field(default_factory=list)
    main_link: str = "direct"
    first_links: dict[Identity, str] = field(default_factory=dict)
    statuses: list[SeenStatus] = field(default_factory=list)
    values: list[ValueSample] = field(default_factory=list)
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
        """Return the scenario time of a UTC."""
        return self.clock(utc_s) - self.clock(self.start_utc_s)

    def received_values(self, values: Sequence[ParameterValue]) -> tuple[ValueSample, ...]:
        """Return values with scenario times."""
        return tuple(
            ValueSample(self.since_start_s(value.utc_s), value.parameter, value.value)
            for value in values
        )

    def receive(self, reports: Iterable[Report], link: str, utc_s: float) -> None:
        """Add reports received on a link at a UTC."""
        for report in reports:
            first = self.first_links.get(report.identity) if report.identity else None
            if link == (first or self.main_link):
                self.reports.append(report)
            receipt = Receipt(self.since_start_s(utc_s), self.time_of(report), link, report)
            self.receipts.append(receipt)

    def time_of(self, report: Report) -> float:
        """Return the scenario time of a report's creation."""
        return self.since_start_s(report.utc_s)

    def identity(self, label: str) -> Identity | None:
        """Return the identity of the command with a label; None if it was not sent."""
        return next((sent.identity for sent in self.sendings if sent.label == label), None)

    def label(self, identity: Identity) -> str:
        """Return the label of a command; its identity if the ground did not send it."""
        labels = (sent.label for sent in self.sendings if sent.identity == identity)
        return next(labels, str(identity))

    def reports_of(self, label: str) -> tuple[Report, ...]:
        """Return the reports of the stages of a command, each once, in order."""
        identity = self.identity(label)
        entry = None if identity is None else self.all_lifecycles().get(identity)
        return () if entry is None else entry.stages

    def expiry(self, label: str) -> Report | None:
        """Return the orbiter's report that a command's lifetime ended there, or None."""
        identity = self.identity(label)
        return next((each for each in self.reports if reports_expiry(each, identity)), None)

    def all_lifecycles(self) -> dict[Identity, CommandHistory]:
        """Return the history of each command with reports."""
        once = {(report.sequence, report.identity): report for report in self.reports}
        reports = tuple(sorted(once.values(), key=lambda report: report.sequence))
        return RunHistory(self.start_utc_s, reports).command_histories()

    def resolve_time(self, timed: Scheduled) -> float | None:
        """Return the due time of an item, or None while unknown.

        An item without a time is due at the end.
        """
        begin_s, near = self._begin_s(timed), timed.near
        if near is None or begin_s is None:
            return begin_s
        from_then_on = between(self.poses, begin_s, inf)
        return next((seen.time_s for seen in from_then_on if near.reached(seen.pose)), None)

    def _begin_s(self, timed: Scheduled) -> float | None:
        """Return the due time of an item regardless of the rover's position."""
        after = timed.after
        if after is None:
            last_s = self.simulated_s if timed.at_end else 0.0
            return last_s if timed.at_s is None else timed.at_s
        expiry = self.expiry(after.label)
        for report in (*self.reports_of(after.label), *([expiry] if expiry else ())):
            if after.matches(report):
                return self.time_of(report) + after.delay_s
        return None

    def sample(self, samples: Sequence[S], timed: Scheduled) -> S | None:
        """Return the first sample after the due time; the last one for an item at the end."""
        if timed.at_end:
            return samples[-1] if samples else None
        time_s = self.resolve_time(timed)
        if time_s is None:
            return None
        return next((each for each in samples if each.time_s > time_s + ALMOST_S), None)

    def during(self, samples: Sequence[S], lasting: ScheduledInterval) -> Sequence[S]:
        """Return the samples of an interval, which for an item at the end is the last one."""
        start_s = self.resolve_time(lasting)
        if start_s is None:
            return ()
        if lasting.at_end:
            start_s -= lasting.for_s
        return between(samples, start_s, start_s + lasting.for_s)


def reports_expiry(report: Report, identity: Identity | None) -> bool:
    """Return whether the orbiter reports that it no longer forwards this command."""
    alarm = (report.kind, report.severity) == (ReportKind.LINK, Severity.ALARM)
    return alarm and identity is not None and report.identity == identity


def between(samples: Sequence[S], start_s: float, end_s: float) -> Sequence[S]:
    """Return the samples with start_s < time <= end_s."""
    return [each for each in samples if start_s + ALMOST_S < each.time_s <= end_s + ALMOST_S]
