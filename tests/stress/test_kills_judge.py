"""Each check of the campaign can fail: a whole story holds, and each way to spoil it is noticed."""

from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest

from executive.commands.catalogue import (
    Command,
    MoveForward,
    Request,
    Resume,
    Stop,
    TakePicture,
)
from executive.reports import Identity, Kind, Report, Severity, Stage
from tests.stress.kills_journal import (
    Answer,
    Answered,
    Entry,
    Fetched,
    Heard,
    Sent,
    Way,
)
from tests.stress.kills_judge import (
    Evidence,
    Fault,
    judge,
    stops,
)
from tests.stress.pose_log import TruePose

STAGES = (Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED)
REQUESTS: dict[int, Request] = {1: MoveForward(1.0), 2: Stop(), 3: Resume(), 4: TakePicture()}
START_S = 1000.0
Spoil = Callable[[Evidence], Evidence]


def one(number: int) -> Identity:
    return Identity("KILLS", number)


def told(sequence: int, number: int, stage: Stage) -> Report:
    return Report(
        sequence=sequence,
        utc_s=START_S + sequence,
        kind=Kind.COMMAND,
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
            reports.append(told(len(reports) + 1, number, stage))
            journal.append(Heard(replace(reports[-1], link=None), Way.BROKER))
    journal += [Sent(Command(one(1), REQUESTS[1], "direct")), Answered(one(1), Answer.DUPLICATE)]
    journal.append(Fetched("samples/0.bin", "fetched-1", sha256(b"sample").hexdigest()))
    sightings = [TruePose(START_S + time / 10, time / 10, 0.0, 0.0) for time in range(60)]
    sightings += [TruePose(START_S + time / 10, 6.0, 0.0, 0.0) for time in range(60, 200)]
    return Evidence(journal, reports, sightings, files)


def faults(evidence: Evidence) -> set[Fault]:
    return {fault for fault, _ in judge(evidence)}


def without(kind: type[Entry], place: int) -> Spoil:
    def spoil(evidence: Evidence) -> Evidence:
        gone = [entry for entry in evidence.journal if isinstance(entry, kind)][place]
        return replace(evidence, journal=[e for e in evidence.journal if e is not gone])

    return spoil


def aboard(change: Callable[[list[Report]], list[Report]]) -> Spoil:
    return lambda evidence: replace(evidence, reports=change(list(evidence.reports)))


def and_heard(*more: Entry) -> Spoil:
    return lambda evidence: replace(evidence, journal=[*evidence.journal, *more])


def writing(path: str, octets: bytes | None) -> Spoil:
    def spoil(evidence: Evidence) -> Evidence:
        place = evidence.files.parent / path
        place.unlink()
        if octets is not None:
            place.write_bytes(octets)
        return evidence

    return spoil


def creeping(evidence: Evidence) -> Evidence:
    far = [replace(seen, x_m=6.0 + seen.utc_s / 100) for seen in evidence.sightings]
    return replace(evidence, sightings=far)


def spinning(evidence: Evidence) -> Evidence:
    round_and_round = [replace(seen, heading_rad=seen.utc_s) for seen in evidence.sightings]
    return replace(evidence, sightings=round_and_round)


def test_a_whole_story_has_no_fault(story: Evidence) -> None:
    assert judge(story) == []
    assert stops(story) == [(START_S + 6, START_S + 10)]


@pytest.mark.parametrize(
    ("spoil", "found"),
    [
        (without(Heard, 2), {Fault.VIEW, Fault.CLIENT_GAP}),
        (without(Heard, -1), {Fault.VIEW, Fault.CLIENT_GAP}),
        (and_heard(Heard(told(17, 4, Stage.FAILED), Way.LEDGER)), {Fault.VIEW, Fault.CLIENT_GAP}),
        (
            and_heard(Heard(replace(told(3, 1, Stage.STARTED), text="other"), Way.LEDGER)),
            {Fault.VIEW, Fault.CLIENT_GAP},
        ),
        (aboard(lambda reports: reports[:-1]), {Fault.VIEW, Fault.ENDS, Fault.CLIENT_GAP}),
        (
            aboard(lambda reports: [*reports, told(17, 4, Stage.STARTED)]),
            {Fault.VIEW, Fault.STAGE_TWICE, Fault.CLIENT_GAP},
        ),
        (
            aboard(lambda reports: [*reports, told(17, 4, Stage.FAILED)]),
            {Fault.VIEW, Fault.ENDS, Fault.CLIENT_GAP},
        ),
        (
            aboard(lambda reports: [*reports[:-1], told(18, 4, Stage.EXECUTED)]),
            {Fault.VIEW, Fault.LEDGER_GAP},
        ),
        (
            and_heard(
                Sent(Command(one(5), MoveForward(1.0), "direct")), Answered(one(5), Answer.TAKEN)
            ),
            {Fault.UNKNOWN},
        ),
        (and_heard(Answered(one(3), Answer.TAKEN)), {Fault.TAKEN_TWICE}),
        (and_heard(Answered(one(3), Answer.DUPLICATE)), {Fault.DUPLICATE}),
        (writing("files/samples/0.bin", b"simple"), {Fault.FILE}),
        (writing("files/pictures/KILLS-4.jpg", b"\xff\xd8pict"), {Fault.PICTURE}),
        (writing("files/pictures/KILLS-4.jpg", None), {Fault.PICTURE}),
        (creeping, {Fault.MOVED}),
        (spinning, {Fault.MOVED}),
    ],
)
def test_each_fault_is_noticed(story: Evidence, spoil: Spoil, found: set[Fault]) -> None:
    assert faults(spoil(story)) == found


def test_each_fault_has_a_story_that_shows_it() -> None:
    marks = test_each_fault_is_noticed.pytestmark  # type: ignore[attr-defined]
    shown = set().union(*(found for _, found in marks[0].args[1]))
    assert shown == set(Fault)
