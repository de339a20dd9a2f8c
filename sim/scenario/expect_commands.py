"""Expectations of scenarios on commands, events, plans and files, and their evaluation.

Each kind of expectation is a dataclass; its first key identifies it in the file.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from zlib import crc32

from executive.settings import figure
from executive.values.reasons import Reason, UnknownReason
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
class LifecycleExpectation:
    """Expected life cycle of a command.

    Attributes:
        command: its label.
        stages: all its stages, in order, without repeats of reports.
        ends: its last stage; EXPIRED as well if its lifetime ended at the orbiter.
        reason: the reason in its last report.
        answers: answer to each time it was sent.
        within_s: maximum time from RECEIVED to its end, in seconds.
    """

    command: str
    stages: tuple[Stage, ...] | None = None
    ends: Stage | None = None
    reason: Reason | None = None
    answers: tuple[Answer, ...] | None = None
    within_s: float | None = None

    def __post_init__(self) -> None:
        given = (self.stages, self.ends, self.reason, self.answers, self.within_s)
        if all(each is None for each in given):
            raise ValueError("one of stages, ends, reason, answers, within is needed")

    def judge(self, record: Record) -> Check:
        """Compare the life cycle of the command with the expected one."""
        reports = record.reports_of(self.command)
        found = joined(f"command {self.command}", list(self._aspects(reports, record)))
        if found.passed or not reports:
            return found
        return Check(found.subject, found.expected, f"{found.observed}: {reports[-1].text}", False)

    def _aspects(self, reports: Sequence[Report], record: Record) -> Iterator[Check]:
        if self.answers is not None:
            answers = [sent.answer for sent in record.sendings if sent.label == self.command]
            yield _aspect(_answers(self.answers), _answers(answers))
        if self.stages is not None:
            yield _aspect(_stages(self.stages), _stages([report.stage for report in reports]))
        last = reports[-1] if reports else None
        if self.ends is not None:
            expired = Stage.EXPIRED if record.expiry(self.command) else None
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
    """Expected number of events with a reason that belong to no command."""

    event: Reason
    count: int = figure(default=1)

    def judge(self, record: Record) -> Check:
        """Compare the number of events with the expected one."""
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
    """Expected number of the relay's own notifications by severity; with --link relay only."""

    link: Severity
    count: int = figure(default=1)

    def judge(self, record: Record) -> Check:
        """Compare the number of notifications with the expected one."""
        texts = [
            report.text
            for report in record.reports
            if report.kind is ReportKind.LINK and report.severity is self.link
        ]
        return Check(
            f"link {self.link.name}",
            f"{self.count} ×",
            "; ".join([f"{len(texts)} ×", *texts]),
            len(texts) == self.count,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanIs(Scheduled):
    """Expected status of a plan at a time."""

    plan: str
    status: PlanStatus

    def judge(self, record: Record) -> Check:
        """Compare the status of the plan at a time with the expected one."""
        subject, wanted = f"plan {self.plan}", f"{self.status.name} {self.time_text}"
        time_s = record.resolve_time(self)
        if time_s is None:
            return Check(subject, wanted, NEVER, False)
        updates = [
            update
            for update in record.plans
            if update.plan_id == self.plan
            and record.since_start_s(update.utc_s) <= time_s + ALMOST_S
        ]
        if not updates:
            return Check(subject, wanted, "no update", False)
        last = updates[-1]
        seen = f"{last.status.name}, {last.done} of {last.total} leaves"
        return Check(subject, wanted, seen, last.status is self.status)


@dataclass(frozen=True, slots=True, kw_only=True)
class FileEventsExpectation:
    """Expected events of one file aboard.

    Attributes:
        file: its path.
        events: all its events in order, without TRANSFERRED, which `fetched` covers.
    """

    file: str
    events: tuple[FileEventKind, ...]

    def __post_init__(self) -> None:
        if FileEventKind.TRANSFERRED in self.events:
            raise ValueError("events: TRANSFERRED is not allowed, use fetched")

    def judge(self, record: Record) -> Check:
        """Compare the events of the file with the expected ones."""
        kinds = [
            event.kind
            for event in record.file_events
            if event.path == self.file and event.kind is not FileEventKind.TRANSFERRED
        ]
        holds = kinds == list(self.events)
        return Check(f"file {self.file}", _kinds(self.events), _kinds(kinds), holds)


@dataclass(frozen=True, slots=True, kw_only=True)
class FileList:
    """Expected complete list of files."""

    files: tuple[str, ...]
    query: str

    def judge(self, record: Record) -> Check:
        """Compare the listed files with the expected ones."""
        wanted = f"{_path_list(self.files)} listed, query {self.query}"
        answers = [answer.files for answer in record.answers if answer.label == self.query]
        if not answers:
            return Check("files", wanted, "no query", False)
        holds = set(answers[0]) == set(self.files)
        return Check("files", wanted, _path_list(answers[0]), holds)


@dataclass(frozen=True, slots=True, kw_only=True)
class FileFetched:
    """Expected identity of a file each time it is fetched: its octets and its checksum."""

    fetched: str

    def judge(self, record: Record) -> Check:
        """Compare the received octets with the file aboard and with the reported checksum."""
        attempts = [each for each in record.fetched if each.path == self.fetched]
        faults = [fault for each in attempts if (fault := _file_error(each))]
        octets = [f"{len(each.received)} octets" for each in attempts if isinstance(each, Fetched)]
        return Check(
            f"fetched {self.fetched}",
            "octets as aboard, checksum as reported",
            ", ".join([*octets, *faults]) or "never fetched",
            bool(attempts) and not faults,
        )


CommandExpectation = (
    LifecycleExpectation
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


def _reason(reason: Reason | UnknownReason | None) -> str:
    return f"{reason.value} {reason.name}" if reason else "no reason"


def _file_error(attempt: Fetched | FetchFailed) -> str:
    if isinstance(attempt, FetchFailed):
        return attempt.reason
    if attempt.received != attempt.aboard:
        return "octets differ from aboard"
    crc = crc32(attempt.received)
    return "" if crc == attempt.checksum else f"CRC-32 {crc:08x}, reported {attempt.checksum:08x}"


def _kinds(kinds: Iterable[FileEventKind]) -> str:
    return " ".join(kind.name for kind in kinds) or "no event"


def _path_list(paths: Iterable[str]) -> str:
    return ", ".join(sorted(paths)) or "no file"
