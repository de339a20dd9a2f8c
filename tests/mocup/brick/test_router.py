"""Whose message goes where: what comes, from whom, and what comes again."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mocup.brick.record import BrickLink
from adapters.mops import Message, encode
from adapters.mops.codec import MAX_MESSAGE_OCTETS
from tests.mocup.brick.routing import (
    BOTH,
    SPELLING,
    TELEMETRY,
    Bench,
    Ports,
    executed,
    forward,
    received,
    stop,
)


def test_a_reply_goes_back_by_the_link_of_its_command(bench: Bench) -> None:
    ours, theirs = forward(7), forward(7, "EXEC")
    bench.command(BrickLink.RELAY, ours)
    bench.command(BrickLink.DIRECT, theirs)
    assert bench.ports.brick == [encode(ours), encode(theirs)]
    bench.sends(received(theirs), received(ours), executed(ours))
    assert bench.ports.notified == [
        (BrickLink.DIRECT, received(theirs)),
        (BrickLink.RELAY, received(ours)),
        (BrickLink.RELAY, executed(ours)),
    ]


def test_a_counter_makes_no_other_command_of_it(bench: Bench) -> None:
    first, second = (replace(forward(7), moe_inputs_counter=counter) for counter in (1, 2))
    bench.command(BrickLink.RELAY, first, second)
    bench.sends(executed(first))
    assert bench.ports.brick == [encode(first)]
    assert bench.ports.notified == [(BrickLink.RELAY, executed(first))]


def test_the_same_command_by_both_links_is_sent_once_and_reported_on_both(bench: Bench) -> None:
    command = forward()
    bench.command(BrickLink.DIRECT, command)
    bench.sends(received(command))
    bench.command(BrickLink.RELAY, command)
    bench.sends(executed(command))
    assert bench.ports.brick == [encode(command)]
    assert bench.ports.notified == [
        (BrickLink.DIRECT, received(command)),
        (BrickLink.RELAY, received(command)),
        (BrickLink.DIRECT, executed(command)),
        (BrickLink.RELAY, executed(command)),
    ]


def test_a_stop_is_passed_on_every_time(bench: Bench) -> None:
    bench.command(BrickLink.RELAY, stop(1))
    bench.sends(executed(stop(1)))
    bench.command(BrickLink.RELAY, stop(1), stop(1))
    assert bench.ports.brick == [encode(stop(1))] * 3


def test_another_command_under_a_number_that_is_known_is_refused(bench: Bench) -> None:
    bench.command(BrickLink.DIRECT, forward(7))
    other = forward(7, distance="-20.0")
    bench.command(BrickLink.RELAY, other)
    assert bench.ports.brick == [encode(forward(7))]
    ((link, reply),) = bench.ports.notified
    assert link is BrickLink.RELAY
    assert (reply.source, reply.dest, reply.moe_inputs_id) == ("MOCUP", "MOE", 7)
    assert (reply.received, reply.executed) == (False, False)
    assert reply.outputs[:2] == ("REJECTED", "DUPLICATE")


def test_without_the_brick_a_command_is_refused_and_may_be_repeated(bench: Bench) -> None:
    bench.ports.there = False
    bench.command(BrickLink.DIRECT, forward())
    ((link, reply),) = bench.ports.notified
    assert link is BrickLink.DIRECT
    assert (reply.outputs[0], reply.received, reply.executed) == ("REJECTED", False, False)
    bench.ports.there = True
    bench.command(BrickLink.DIRECT, forward())
    assert bench.ports.brick == [encode(forward())]


def test_when_the_brick_disconnects_every_waiting_link_is_notified_once(bench: Bench) -> None:
    done, begun, unheard = forward(1), forward(2), forward(3)
    bench.command(BrickLink.DIRECT, done, begun, unheard)
    bench.command(BrickLink.RELAY, begun)
    bench.sends(received(begun), executed(done))
    bench.ports.notified.clear()
    bench.router.on_disconnected()
    bench.router.on_disconnected()
    arrived = [
        (link, m.moe_inputs_id, m.received, m.outputs[0]) for link, m in bench.ports.notified
    ]
    assert arrived == [
        (BrickLink.DIRECT, 2, True, "FAILED"),
        (BrickLink.RELAY, 2, True, "FAILED"),
        (BrickLink.DIRECT, 3, False, "FAILED"),
    ]
    assert not any(message.executed for _, message in bench.ports.notified)


def test_half_a_message_of_a_brick_that_went_away_spoils_none_of_the_next(bench: Bench) -> None:
    bench.router.on_octets(encode(executed(forward()))[:20])
    bench.router.on_disconnected()
    bench.sends(executed(forward()))
    assert len(bench.ports.notified) == len(BOTH)
    counts = bench.router.counts
    assert (counts.dropped_octets, counts.dropped_pieces, len(bench.reported)) == (20, 1, 1)


def test_telemetry_goes_to_no_link(bench: Bench) -> None:
    telemetry = Message(
        TELEMETRY.code, "MOCUP", "ALL", TELEMETRY.command, outputs=("",) * len(TELEMETRY.outputs)
    )
    bench.sends(telemetry)
    assert bench.ports.measured == [telemetry]
    assert bench.ports.notified == []


def test_an_unsolicited_reply_is_sent_to_both_links(bench: Bench) -> None:
    event = Message(SPELLING.event.code, "MOCUP", "ALL", SPELLING.event.command, outputs=("ALARM",))
    bench.sends(event)
    assert bench.ports.notified == [(link, event) for link in BOTH]


@pytest.mark.parametrize("dest", ["JACKAL", "MOCUP2", "mocup"])
def test_a_message_for_another_receiver_does_not_reach_the_brick(bench: Bench, dest: str) -> None:
    bench.command(BrickLink.RELAY, replace(forward(), dest=dest))
    assert bench.ports == Ports()
    assert len(bench.reported) == bench.router.counts.refused == 1
    assert dest in bench.reported[0]


def test_a_reply_under_another_name_is_not_passed_on(bench: Bench) -> None:
    bench.command(BrickLink.RELAY, forward())
    bench.sends(replace(executed(forward()), source="JACKAL"))
    assert bench.ports.notified == []
    assert len(bench.reported) == 1


@pytest.mark.parametrize(
    "text", ["STOP", "102|MOE|MOCUP|MOVE|1#", "#", str(forward())[:-1], "\N{SNOWMAN}#", "a#b"]
)
def test_an_invalid_message_is_counted_and_does_not_affect_the_next(
    bench: Bench, text: str
) -> None:
    bench.router.process(BrickLink.DIRECT, text)
    counts = bench.router.counts
    assert counts.refused == counts.dropped_pieces == len(bench.reported) >= 1
    assert counts.dropped_octets == len(text.encode())
    bench.command(BrickLink.DIRECT, forward())
    assert bench.ports.brick == [encode(forward())]


def test_commands_without_a_number_are_all_passed_on(bench: Bench) -> None:
    bench.command(BrickLink.RELAY, forward(None), forward(None))
    bench.command(BrickLink.DIRECT, forward(None))
    assert bench.ports.brick == [encode(forward(None))] * 3
    bench.sends(executed(forward(None)))
    assert bench.ports.notified == [(BrickLink.DIRECT, executed(forward(None)))]


def test_a_reply_that_would_be_too_long_is_not_given(bench: Bench) -> None:
    source = "M" * (MAX_MESSAGE_OCTETS - len(encode(forward(source="M"))) + 1)
    maximum = forward(source=source)
    assert len(encode(maximum)) == MAX_MESSAGE_OCTETS
    bench.command(BrickLink.RELAY, maximum)
    bench.router.on_disconnected()
    assert bench.ports.brick == [encode(maximum)]
    assert bench.ports.notified == []
    assert bench.router.counts.refused >= 1


GARBAGE = st.binary(max_size=30).filter(
    lambda octets: b"#" not in octets and octets.strip(b"\0\r\n")
)
REPLIES = st.builds(
    lambda number, done: executed(forward(number)) if done else received(forward(number)),
    st.integers(0, 5),
    st.booleans(),
)


@given(st.lists(st.tuples(REPLIES, st.none() | GARBAGE, st.integers(0, 70))), st.data())
def test_replies_pass_for_any_fragmentation(
    text: list[tuple[Message, bytes | None, int]], data: st.DataObject
) -> None:
    bench = Bench()
    bench.command(BrickLink.DIRECT, *(forward(number) for number in range(6)))
    octets, ended, passed = b"", set(), []
    for message, garbage, zeros in text:
        if message.moe_inputs_id not in ended:
            passed.append((BrickLink.DIRECT, message))
        if message.executed:
            ended.add(message.moe_inputs_id)
        octets += b"" if garbage is None else garbage + b"#"
        octets += encode(message) + bytes(zeros)
    while octets:
        size = data.draw(st.integers(1, 64))
        bench.router.on_octets(octets[:size])
        octets = octets[size:]
    assert bench.ports.notified == passed
    garbage_count = sum(garbage is not None for _, garbage, _ in text)
    assert len(bench.reported) == garbage_count + len(text) - len(passed)


@given(st.sampled_from(BrickLink), st.text() | st.text(st.characters(categories=["Cs"])))
def test_no_text_from_a_link_breaks_it(link: BrickLink, text: str) -> None:
    bench = Bench()
    bench.router.process(link, text)
    assert bench.ports.brick == []
