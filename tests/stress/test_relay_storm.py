"""Each check of the storm over the relay can fail; and what makes the storm works."""

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from adapters.mops import load_dictionary
from executive.values.reports import Report, ReportKind, Severity, Stage
from tests.stress.fake_clock import set_clock
from tests.stress.lossy_link import LossyLink
from tests.stress.relay_judge import Evidence, Fault, judge
from tests.stress.relay_traffic import command_of, string_of
from tests.stress.small_disk import DISK_OCTETS, NoDiskError, small_disk

DICTIONARY = load_dictionary()
NUMBERS = range(1, 11)
Spoil = Callable[[Evidence], Evidence]


def report(number: int) -> Report:
    identity = command_of(number).identity
    how = ReportKind.COMMAND, Severity.INFORMATIONAL
    return Report(number, 1.0, *how, "", identity, Stage.EXECUTED, "relay")


def string(number: int) -> str:
    return string_of(number, DICTIONARY)


STORY = Evidence(
    acknowledged=NUMBERS[1:],
    topic=[string(number) for number in NUMBERS],
    reports=[report(number) for number in NUMBERS],
    known=[report(number) for number in NUMBERS],
    reported=[(0, number) for number in NUMBERS],
    given=[(0, f"ipn:2.1 {number}") for number in NUMBERS],
)


def test_a_whole_run_holds_and_permitted_losses_are_counted() -> None:
    verdict = judge(
        replace(
            STORY,
            topic=[*STORY.topic, string(5)],
            reported=STORY.reported[1:],
            given=[*STORY.given, (1, "ipn:2.1 10"), (1, "ipn:2.1 11")],
        )
    )
    assert verdict.faults == ()
    assert verdict.commands == 10
    assert set(verdict.allowed.values()) == {1}


def executed_twice(evidence: Evidence) -> Evidence:
    again = replace(report(11), identity=report(10).identity)
    return replace(
        evidence,
        reports=[*evidence.reports, again],
        known=[*evidence.known, again],
        reported=[*evidence.reported, (0, 11)],
        given=[*evidence.given, (0, "ipn:2.1 11")],
    )


@pytest.mark.parametrize(
    ("fault", "spoil"),
    [
        (Fault.LOST_UP, lambda e: replace(e, topic=e.topic[:-1])),
        (Fault.EXECUTED_TWICE, executed_twice),
        (Fault.CHANGED_UP, lambda e: replace(e, topic=[*e.topic, spoilt(3)])),
        (Fault.LOST_DOWN, lambda e: replace(e, known=e.known[:-1])),
        (Fault.CHANGED_DOWN, lambda e: replace(e, known=[*e.known[:-1], other(10)])),
        (Fault.CHANGED_DOWN, lambda e: replace(e, known=[*e.known, report(99)])),
        (Fault.REPORTED_TWICE, lambda e: replace(e, reported=[*e.reported, (1, 4)])),
        (Fault.GIVEN_TWICE, lambda e: replace(e, given=[*e.given, e.given[0]])),
    ],
)
def test_each_fault_is_found(fault: Fault, spoil: Spoil) -> None:
    assert {found for found, _ in judge(spoil(STORY)).faults} == {fault}


def spoilt(number: int) -> str:
    return string(number).replace("|0.", "|1.")


def other(number: int) -> Report:
    return replace(report(number), stage=Stage.FAILED)


OUTPUT = """\
import sys, time
for _ in sys.stdin:
    print(time.time(), flush=True)
"""


def test_the_link_acts_as_requested() -> None:
    link = LossyLink(Random(1), loss=0.3, scale=20.0)
    delays_s = [link.delays_s(number / 100) for number in range(60_000)]
    done = link.done
    lit = len(delays_s) - done["dark"]
    assert 0.27 < done["lost"] / (lit + done["doubled"]) < 0.33
    assert 0.02 < done["doubled"] / lit < 0.04
    assert 0.2 < done["dark"] / len(delays_s) < 0.5
    assert 80 < done["nights"] < 200
    assert 0.0 < max(each for delays in delays_s for each in delays) < 1 / 20
    assert delays_s == [
        again.delays_s(number / 100)
        for again in (LossyLink(Random(1), loss=0.3, scale=20.0),)
        for number in range(60_000)
    ]


def test_a_clock_is_set_while_its_process_runs(tmp_path: Path) -> None:
    (tmp_path / "tells.py").write_text(OUTPUT)
    clock = tmp_path / "clock"
    set_clock(clock, 0.0)
    command = [sys.executable, "-m", "tests.stress.fake_clock", str(clock), "tells"]
    checkout = str(Path(__file__).parents[2])
    reported_s = []
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={"PYTHONPATH": f"{checkout}:{tmp_path}"},
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for wrong_by_s in (0.0, -3600.0):
            set_clock(clock, wrong_by_s)
            process.stdin.write("\n")
            process.stdin.flush()
            reported_s.append(float(process.stdout.readline()))
        process.stdin.close()
    assert -3601.0 < reported_s[1] - reported_s[0] < -3500.0


def test_a_disk_is_full_at_once_and_has_space_again(tmp_path: Path) -> None:
    try:
        with small_disk(tmp_path / "disk") as disk:
            path = disk.folder / "file"
            path.write_bytes(bytes(1 << 20))
            disk.fill()
            with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
                path.write_bytes(bytes(2 << 20))
            disk.empty()
            path.write_bytes(bytes(DISK_OCTETS // 2))
    except NoDiskError as why:
        pytest.skip(f"no disk can be mounted here: {why}")
