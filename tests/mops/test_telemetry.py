import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mops import Message, MopsError, facts_of, load_dictionary
from executive.geometry import Pose, Velocity
from executive.state import Battery, CameraAngles, Odometry

SPELLING = load_dictionary().spelling.telemetry
VALUES = ("1.0", "2.0", "0.5", "-1.5", "0.2", "1.0", "0.1", "-0.2", "8.1", "0.3", "-0.4", "1.0")


def telemetry(*values: str) -> Message:
    return Message(SPELLING.code, "MOCUP", "MOE", SPELLING.command, (), values, True)


def test_telemetry_becomes_facts() -> None:
    assert list(facts_of(telemetry(*VALUES), SPELLING, 7.0)) == [
        Odometry(7.0, Pose(1.0, 2.0, 0.5, -1.5), Velocity(0.1, -0.2)),
        Battery(8.1),
        CameraAngles(0.3, -0.4),
    ]


def test_what_is_not_known_is_no_fact() -> None:
    assert list(facts_of(telemetry(*[""] * len(VALUES)), SPELLING, 7.0)) == []
    no_heading = (*VALUES[:3], "", *VALUES[4:])
    assert Odometry not in map(type, facts_of(telemetry(*no_heading), SPELLING, 7.0))


@pytest.mark.parametrize("value", ["nan", "inf", "one", "1.0.0"])
def test_what_is_no_number_is_refused(value: str) -> None:
    with pytest.raises(MopsError, match="POS_X"):
        list(facts_of(telemetry(value, *VALUES[1:]), SPELLING, 7.0))


def test_what_is_no_telemetry_is_refused() -> None:
    for message in (telemetry(*VALUES[1:]), Message(0x301, "a", "b", "EVENT", (), VALUES)):
        with pytest.raises(MopsError):
            list(facts_of(message, SPELLING, 7.0))


@given(st.lists(st.text(max_size=5), min_size=len(VALUES), max_size=len(VALUES)))
def test_no_telemetry_upsets_it(values: list[str]) -> None:
    try:
        list(facts_of(telemetry(*values), SPELLING, 7.0))
    except MopsError:
        return
