"""Each check of the kills can fail: a whole story, spoilt each way."""

from collections.abc import Callable
from dataclasses import replace
from enum import Enum
from hashlib import sha256
from pathlib import Path

import pytest

from executive.commands.catalogue import (
    Command,
    MoveForward,
    PreemptionPolicy,
    Request,
    Resume,
    Stop,
    TakePicture,
)
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from tests.stress.command_generator import random_command
from tests.stress.findings import LifecycleFault
from tests.stress.kills_journal import (
    Answer,
    Answered,
    Entry,
    Fetched,
    Fetching,
    Received,
    Route,
    Sent,
    View,
    read_entries,
)
from tests.stress.kills_judge import Evidence, Fault, judge, stops
from tests.stress.pose_log import TruePose

STAGES = (Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED)
REQUESTS: dict[int, Request] = {1: MoveForward(1.0), 2: Stop(), 3: Resume(), 4: TakePicture()}
START_S = 1000.0
Spoil = Callable[[Evidence], Evidence]


def one(number: int) -> Identity:
    return Identity("KILLS", number)


def reported(sequence: int, number: int, stage: Stage) -> Report:
    return Report(
        sequence=sequence,
        utc_s=START_S + sequence,
        kind=ReportKind.COMMAND,
        severity=Severity.INFORMATIONAL,
        text=stage.name,
        identity=one(number),
        stage=stage,
        link="direct",
    )


@pytest.fixture
def story(tmp_path: Path) -> Evidence:
    files = tmp_path / "files"
    for folder in (files / "pictures", files / "samples"):
        folder.mkdir(parents=True)
    (files / "pictures/KILLS-4.jpg").write_bytes(b"\xff\xd8picture\xff\xd9")
    (files / "samples/0.bin").write_bytes(b"sample")
    journal: list[Entry] = []
    reports: list[Report] = []
    for number, request in REQUESTS.items():
        journal.append(Sent(Command(one(number), request, "direct")))
        journal.append(Answered(one(number), Answer.TAKEN))
        for stage in STAGES:
            reports.append(reported(len(reports) + 1, number, stage))
            journal.append(Received(replace(reports[-1], link=None), Route.BROKER))
    journal += [Sent(Command(one(1), REQUESTS[1], "direct")), Answered(one(1), Answer.DUPLICATE)]
    journal.append(Fetched("samples/0.bin", "fetched-1", sha256(b"sample").hexdigest()))
    poses = [TruePose(START_S + time / 10, time / 10, 0.0, 0.0) for time in range(60)]
    poses += [TruePose(START_S + time / 10, 6.0, 0.0, 0.0) for time in range(60, 200)]
    return Evidence(journal, reports, poses, files)


def without(kind: type[Entry], index: int) -> Spoil:
    def spoil(evidence: Evidence) -> Evidence:
        closed = [entry for entry in evidence.journal if isinstance(entry, kind)][index]
        return replace(evidence, journal=[e for e in evidence.journal if e is not closed])

    return spoil


def aboard(change: Callable[[list[Report]], list[Report]]) -> Spoil:
    return lambda evidence: replace(evidence, reports=change(list(evidence.reports)))


def and_received(*more: Entry) -> Spoil:
    return lambda evidence: replace(evidence, journal=[*evidence.journal, *more])


def writing(path: str, octets: bytes | None) -> Spoil:
    def spoil(evidence: Evidence) -> Evidence:
        index = evidence.files.parent / path
        index.unlink()
        if octets is not None:
            index.write_bytes(octets)
        return evidence

    return spoil


def at_poses(change: Callable[[TruePose], TruePose]) -> Spoil:
    return lambda evidence: replace(evidence, poses=list(map(change, evidence.poses)))


def test_a_whole_story_has_no_fault(story: Evidence) -> None:
    assert list(judge(story)) == []
    assert stops(story) == [(START_S + 6, START_S + 10)]


@pytest.mark.parametrize(
    ("spoil", "found"),
    [
        (without(Received, 2), {Fault.VIEW, Fault.CLIENT_GAP}),
        (without(Received, -1), {Fault.VIEW, Fault.CLIENT_GAP}),
        (
            and_received(Received(reported(17, 4, Stage.FAILED), Route.LEDGER)),
            {Fault.VIEW, Fault.CLIENT_GAP},
        ),
        (
            and_received(
                Received(replace(reported(3, 1, Stage.STARTED), text="other"), Route.LEDGER)
            ),
            {Fault.VIEW, Fault.CLIENT_GAP},
        ),
        (aboard(lambda reports: reports[:-1]), {Fault.VIEW, LifecycleFault.ENDS, Fault.CLIENT_GAP}),
        (
            aboard(lambda reports: [*reports, reported(17, 4, Stage.STARTED)]),
            {Fault.VIEW, LifecycleFault.STAGE_TWICE, Fault.CLIENT_GAP},
        ),
        (
            aboard(lambda reports: [*reports, reported(17, 4, Stage.FAILED)]),
            {Fault.VIEW, LifecycleFault.ENDS, Fault.CLIENT_GAP},
        ),
        (
            aboard(lambda reports: [*reports[:-1], reported(18, 4, Stage.EXECUTED)]),
            {Fault.VIEW, LifecycleFault.GAP, Fault.CLIENT_GAP},
        ),
        (
            and_received(
                Sent(Command(one(5), MoveForward(1.0), "direct")), Answered(one(5), Answer.TAKEN)
            ),
            {Fault.UNKNOWN},
        ),
        (and_received(Answered(one(3), Answer.TAKEN)), {Fault.TAKEN_TWICE}),
        (and_received(Answered(one(3), Answer.DUPLICATE)), {Fault.DUPLICATE}),
        (writing("files/samples/0.bin", b"simple"), {Fault.FILE}),
        (writing("files/pictures/KILLS-4.jpg", b"\xff\xd8pict"), {Fault.PICTURE}),
        (writing("files/pictures/KILLS-4.jpg", None), {Fault.PICTURE}),
        (at_poses(lambda seen: replace(seen, x_m=6.0 + seen.utc_s / 100)), {Fault.MOVED}),
        (at_poses(lambda seen: replace(seen, heading_rad=seen.utc_s)), {Fault.MOVED}),
    ],
)
def test_each_fault_is_noticed(story: Evidence, spoil: Spoil, found: set[Enum]) -> None:
    assert {fault for fault, _ in judge(spoil(story))} == found


def test_each_fault_has_a_story_that_shows_it() -> None:
    marks = test_each_fault_is_noticed.pytestmark  # type: ignore[attr-defined]
    assert set().union(*(found for _, found in marks[0].args[1])) == {*Fault, *LifecycleFault}


def report(sequence: int, stage: Stage | None = None) -> Report:
    if stage is not None:
        return replace(reported(sequence, 1, stage), link=None, reason=Reason.STOPPED)
    return Report(sequence, 1.5, ReportKind.EVENT, Severity.WARNING, "that")


def test_everything_written_is_read_except_a_truncated_line(tmp_path: Path) -> None:
    commands = [random_command(7, number, "direct", 12.25) for number in range(1, 200)]
    assert {command.preemption for command in commands} == set(PreemptionPolicy)
    written: list[Entry] = [
        *map(Sent, commands),
        Answered(one(1), Answer.DUPLICATE),
        Received(report(1), Route.BROKER),
        Received(report(2, Stage.EXECUTED), Route.LEDGER),
        Fetching("samples/0.bin", "fetched-1", 4096),
        Fetched("samples/0.bin", "fetched-1", "00ff"),
    ]
    path = tmp_path / "journal"
    view = View(path)
    for entry in written:
        view.note(entry)
    assert read_entries(path) == written
    path.write_bytes(path.read_bytes()[:-5])
    assert read_entries(path) == written[:-1]
    View(path).note(written[-1])
    assert read_entries(path) == written


def test_a_view_continues_at_its_former_end(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    command = Command(one(1), random_command(1, 1, "direct", 0.0).request, "direct")
    view = View(path)
    assert (view.next_number, view.next_name) == (1, "fetched-1")
    view.note(Sent(command))
    view.receive(report(1, Stage.RECEIVED), Route.BROKER)
    view.receive(report(3, Stage.EXECUTED), Route.BROKER)
    view.receive(report(3, Stage.EXECUTED), Route.LEDGER)
    view.note(Fetching("a", view.next_name, 0))
    view = View(path)
    assert view.unanswered == view.commands == [command]
    assert (view.next_number, view.next_name) == (2, "fetched-2")
    assert (view.complete_to, view.newest) == (1, 3)
    assert view.living == []
    assert view.interrupted == Fetching("a", "fetched-1", 0)
    view.receive(report(2), Route.LEDGER)
    view.note(Answered(one(1), Answer.DUPLICATE))
    view.note(Fetched("a", "fetched-1", "00"))
    assert sum(isinstance(entry, Received) for entry in read_entries(path)) == 3
    view = View(path)
    assert view.complete_to == 3
    assert not view.unanswered
    assert view.interrupted is None
