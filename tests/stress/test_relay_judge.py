"""Each check of the storm can fail: a whole story holds, and each way to spoil it is noticed."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from adapters.mops import load_dictionary
from executive.reports import Kind, Report, Severity, Stage
from tests.stress.relay_judge import Evidence, Fault, judge
from tests.stress.relay_traffic import command_of, string_of

DICTIONARY = load_dictionary()
NUMBERS = range(1, 11)
Spoil = Callable[[Evidence], Evidence]


def report(number: int) -> Report:
    return Report(
        number,
        1.0,
        Kind.COMMAND,
        Severity.INFORMATIONAL,
        "",
        command_of(number).identity,
        Stage.EXECUTED,
        "relay",
    )


def string(number: int) -> str:
    return string_of(number, DICTIONARY)


STORY = Evidence(
    acknowledged=NUMBERS[1:],
    topic=[string(number) for number in NUMBERS],
    reports=[report(number) for number in NUMBERS],
    known=[report(number) for number in NUMBERS],
    told=[(0, number) for number in NUMBERS],
    given=[(0, f"ipn:2.1 {number}") for number in NUMBERS],
)


def test_a_whole_story_holds_and_what_is_allowed_is_counted() -> None:
    verdict = judge(
        replace(
            STORY,
            topic=[*STORY.topic, string(5)],
            told=STORY.told[1:],
            given=[*STORY.given, (1, "ipn:2.1 10"), (1, "ipn:2.1 11")],
        )
    )
    assert verdict.faults == ()
    assert (verdict.commands, verdict.unacknowledged) == (10, 1)
    assert (verdict.published_again, verdict.given_again) == (1, 1)
    assert (verdict.told_again, verdict.untold) == (1, 1)


def executed_twice(evidence: Evidence) -> Evidence:
    again = replace(report(11), identity=report(10).identity)
    return replace(
        evidence,
        reports=[*evidence.reports, again],
        known=[*evidence.known, again],
        told=[*evidence.told, (0, 11)],
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
        (Fault.TOLD_TWICE, lambda e: replace(e, told=[*e.told, (1, 4)])),
        (Fault.GIVEN_TWICE, lambda e: replace(e, given=[*e.given, e.given[0]])),
    ],
)
def test_each_fault_is_found(fault: Fault, spoil: Spoil) -> None:
    assert {found for found, _ in judge(spoil(STORY)).faults} == {fault}


def spoilt(number: int) -> str:
    return string(number).replace("|0.", "|1.")


def other(number: int) -> Report:
    return replace(report(number), stage=Stage.FAILED)
