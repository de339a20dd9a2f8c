from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from adapters.mops.codec import Message
from adapters.mops.dictionary import load_dictionary
from adapters.mops.reports import event_of, refusal_of, reply_of
from adapters.mops.telemetry import LinkHealth, health_message, telemetry_of
from adapters.relay.rover import bridge
from adapters.relay.rover.bridge import SendQueue
from executive.commands.catalogue import Stop
from executive.reports import Identity, Kind, Report, Severity, Stage
from executive.state.telemetry import Parameter

DICTIONARY = load_dictionary()
SPELLING = DICTIONARY.spelling
QUEUE = 3


def event(number: int) -> Message:
    report = Report(number, 1.0, Kind.EVENT, Severity.WARNING, "near")
    return event_of(report, SPELLING.event, "JACKAL")


def telemetry(x_m: float) -> Message:
    return telemetry_of({Parameter.POS_X: x_m}, SPELLING.telemetry, "JACKAL", "ALL")


def new() -> SendQueue:
    return SendQueue(DICTIONARY, QUEUE)


@given(st.lists(st.integers(1, 50)), st.integers(0, 100), st.integers(1, 10))
def test_reports_come_all_in_order_and_once_each(
    numbers: list[int], queued: int, most: int
) -> None:
    whole = new()
    for number in numbers:
        assert whole.put(event(number))
    taken: list[Message] = []
    while some := whole.take(queued, most):
        assert len(some) <= most
        taken += some
    assert taken == [event(number) for number in dict.fromkeys(numbers)]


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.integers(0, 10))
def test_of_telemetry_the_newest_comes_once_little_waits(values: list[float], queued: int) -> None:
    some = new()
    for value in values:
        some.put(telemetry(value))
    assert list(some.take(QUEUE + 1, 10)) == []
    expected = [telemetry(values[-1])] if queued <= QUEUE else []
    assert list(some.take(queued, 10)) == expected
    assert list(some.take(0, 10)) == ([] if expected else [telemetry(values[-1])])


def test_reports_go_before_telemetry_and_health_is_telemetry() -> None:
    some = new()
    health = health_message(LinkHealth(1.0, 0, 0.0, None, None, 0, 0), SPELLING.link, "JACKAL")
    for message in (telemetry(1.0), health, event(1)):
        some.put(message)
    assert list(some.take(0, 10)) == [event(1), telemetry(1.0), health]


def test_more_reports_than_there_is_room_for_are_refused() -> None:
    some = new()
    assert all(some.put(event(number)) for number in range(1, bridge.MOST_QUEUED + 1))
    assert not some.put(event(bridge.MOST_QUEUED + 1))
    assert some.put(telemetry(1.0))


def test_what_has_a_number_can_be_taken_over() -> None:
    command = DICTIONARY.command(Stop(), Identity("MOE", 7), "JACKAL")
    report = Report(
        12,
        1.0,
        Kind.COMMAND,
        Severity.INFORMATIONAL,
        "Stop",
        identity=Identity("MOE", 7),
        stage=Stage.STARTED,
    )
    some = new()
    assert some.number_of(event(5)) == 5
    assert some.number_of(reply_of(report, SPELLING.commands["stop"], "JACKAL")) == 12
    assert some.number_of(refusal_of(command, "JACKAL", "no")) is None
    assert some.number_of(replace(event(5), code=0xFFF)) is None
    assert some.number_of(telemetry(1.0)) is None
