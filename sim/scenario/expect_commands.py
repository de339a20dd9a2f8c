"""What can be expected of commands, events, plans and files, and what came of it.

Each kind of expectation is a dataclass, told apart in the file by its first key.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from zlib import crc32

from executive.settings import figure
from executive.values.reasons import Reason
from executive.values.reports import FileEventKind, PlanStatus, Report, ReportKind, Severity, Stage
from sim.scenario.record import (
    ALMOST_S,
    NEVER,
    Answer,
    Check,
    Fetched,
    FetchFailed,
    Record,
    Scheduled,
    joined,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedLife:
    """How a command lives.

    Attributes:
        command: its label.
        stages: all its stages, in order, without repeats of reports.
        ends: its last stage; EXPIRED as well if its lifetime ended at the orbiter.
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

    def judge(self, record: Record) -> Check:
        """Compare the life of a command."""
        reports = record.life(self.command)
        found = joined(f"command {self.command}", list(self._aspects(reports, record)))
        if found.holds or not reports:
            return found
        return Check(found.subject, found.expected, f"{found.seen}: {reports[-1].text}", False)

    def _aspects(self, reports: Sequence[Report], record: Record) -> Iterator[Check]:
        if self.answers is not None:
            answers = [sent.answer for sent in record.sendings if sent.label == self.command]
            yield _aspect(_answers(self.answers), _answers(answers))
        if self.stages is not None:
            yield _aspect(_stages(self.stages), _stages([report.stage for report in reports]))
        last = reports[-1] if reports else None
        if self.ends is not None:
            expired = Stage.EXPIRED if record.given_up(self.command) else None
            ends = last.stage if last else expired
            yield _aspect(f"ends {self.ends.name}", f"ends {ends.name}" if ends else "no report")
        if self.reason is not None:
            yield _aspect(_reason(self.reason), _reason(last.reason if last else None))
        if self.within_s is not None:
            ended = bool(last and last.stage and last.stage.terminal)
            took_s = record.time_of(reports[-1]) - record.time_of(reports[0]) if ended else 0.0
            yield Check(
                "",
                f"within {self.within_s:g} s",
                f"after {took_s:.2f} s" if ended else "no end",
                ended and took_s <= self.within_s,
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Events:
    """How often the rover reports an event with a reason, of no command."""

    event: Reason
    count: int = figure(default=1)

    def judge(self, record: Record) -> Check:
        """Count the events with a reason."""
        count = len(
            {
                report.sequence
                for report in record.reports
                if report.kind is ReportKind.EVENT and report.reason is self.event
            }
        )
        return Check(
            f"event {_reason(self.event)}", f"{self.count} ×", f"{count} ×", count == self.count
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkNotificationCount:
    """How often the relay tells something of itself, of a severity; with --link relay only."""

    link: Severity
    count: int = figure(default=1)

    def judge(self, record: Record) -> Check:
        """Count what the relay told of itself, with a severity."""
        told = [
            report.text
            for report in record.reports
            if report.kind is ReportKind.LINK and report.severity is self.link
        ]
        return Check(
            f"link {self.link.name}",
            f"{self.count} ×",
            "; ".join([f"{len(told)} ×", *told]),
            len(told) == self.count,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanIs(Scheduled):
    """Where a plan is in its life."""

    plan: str
    status: PlanStatus

    def judge(self, record: Record) -> Check:
        """Compare where a plan was in its life at a time."""
        subject, wanted = f"plan {self.plan}", f"{self.status.name} {self.when}"
        time_s = record.moment(self)
        if time_s is None:
            return Check(subject, wanted, NEVER, False)
        told = [
            update
            for update in record.plans
            if update.plan_id == self.plan
            and record.since_start_s(update.utc_s) <= time_s + ALMOST_S
        ]
        if not told:
            return Check(subject, wanted, "nothing told", False)
        last = told[-1]
        seen = f"{last.status.name}, {last.done} of {last.total} leaves"
        return Check(subject, wanted, seen, last.status is self.status)


@dataclass(frozen=True, slots=True, kw_only=True)
class FileEventsExpectation:
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

    def judge(self, record: Record) -> Check:
        """Compare everything that was told of a file."""
        told = [
            event.kind
            for event in record.file_events
            if event.path == self.file and event.kind is not FileEventKind.TRANSFERRED
        ]
        holds = told == list(self.events)
        return Check(f"file {self.file}", _kinds(self.events), _kinds(told), holds)


@dataclass(frozen=True, slots=True, kw_only=True)
class FileList:
    """Which files there are, all of them."""

    files: tuple[str, ...]
    asked: str

    def judge(self, record: Record) -> Check:
        """Compare the files that were listed."""
        wanted = f"{_paths(self.files)} listed, asked by {self.asked}"
        answers = [asked.files for asked in record.answers if asked.label == self.asked]
        if not answers:
            return Check("files", wanted, "not asked", False)
        holds = set(answers[0]) == set(self.files)
        return Check("files", wanted, _paths(answers[0]), holds)


@dataclass(frozen=True, slots=True, kw_only=True)
class FileFetched:
    """Every time a file was fetched, it came octet for octet, of the checksum that was told."""

    fetched: str

    def judge(self, record: Record) -> Check:
        """Compare what came with what was aboard, octet for octet, and with the checksum told."""
        attempts = [each for each in record.fetched if each.path == self.fetched]
        faults = [fault for each in attempts if (fault := _fault(each))]
        octets = [f"{len(each.came)} octets" for each in attempts if isinstance(each, Fetched)]
        return Check(
            f"fetched {self.fetched}",
            "octet for octet, of the checksum told",
            ", ".join([*octets, *faults]) or "never fetched",
            bool(attempts) and not faults,
        )


CommandExpectation = (
    ExpectedLife
    | Events
    | LinkNotificationCount
    | PlanIs
    | FileEventsExpectation
    | FileList
    | FileFetched
)


def _aspect(expected: str, seen: str) -> Check:
    return Check("", expected, seen, expected == seen)


def _answers(answers: Sequence[Answer]) -> str:
    return " ".join(answer.value for answer in answers) or "not sent"


def _stages(stages: Sequence[Stage | None]) -> str:
    return " ".join(stage.name for stage in stages if stage is not None) or "no report"


def _reason(reason: Reason | None) -> str:
    return f"{reason.value} {reason.name}" if reason else "no reason"


def _fault(attempt: Fetched | FetchFailed) -> str:
    if isinstance(attempt, FetchFailed):
        return attempt.why
    if attempt.came != attempt.aboard:
        return "other octets than aboard"
    came = crc32(attempt.came)
    return "" if came == attempt.checksum else f"CRC-32 {came:08x}, told {attempt.checksum:08x}"


def _kinds(kinds: Iterable[FileEventKind]) -> str:
    return " ".join(kind.name for kind in kinds) or "nothing told"


def _paths(paths: Iterable[str]) -> str:
    return ", ".join(sorted(paths)) or "no file"
