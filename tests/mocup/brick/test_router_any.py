"""The router with anything, from anyone, in any order, cut anywhere."""

from hypothesis import given
from hypothesis import strategies as st

from adapters.mocup.brick.record import Link
from adapters.mops import Message, encode
from tests.mocup.brick.routing import (
    BOTH,
    Bench,
    Exits,
    executed,
    forward,
    received,
)

GARBAGE = st.binary(max_size=30).filter(
    lambda octets: b"#" not in octets and octets.strip(b"\0\r\n")
)
REPLIES = st.builds(
    lambda number, done: executed(forward(number)) if done else received(forward(number)),
    st.integers(0, 5),
    st.booleans(),
)


@given(st.lists(st.tuples(REPLIES, st.none() | GARBAGE, st.integers(0, 70))), st.data())
def test_replies_come_through_however_they_are_cut(
    said: list[tuple[Message, bytes | None, int]], data: st.DataObject
) -> None:
    bench = Bench()
    bench.command(Link.DIRECT, *(forward(number) for number in range(6)))
    octets, ended, passed = b"", set(), []
    for message, garbage, zeros in said:
        if message.moe_inputs_id not in ended:
            passed.append((Link.DIRECT, message))
        if message.executed:
            ended.add(message.moe_inputs_id)
        octets += b"" if garbage is None else garbage + b"#"
        octets += encode(message) + bytes(zeros)
    while octets:
        size = data.draw(st.integers(1, 64))
        bench.router.heard(octets[:size])
        octets = octets[size:]
    assert bench.exits.notified == passed
    garbage_count = sum(garbage is not None for _, garbage, _ in said)
    assert len(bench.told) == garbage_count + len(said) - len(passed)


STEPS = st.lists(
    st.tuples(st.just("command"), st.sampled_from(Link), st.integers(0, 3), st.booleans())
    | st.tuples(st.just("reply"), st.sampled_from(Link), st.integers(0, 3), st.booleans()),
    max_size=40,
)


@given(STEPS)
def test_links_hear_of_their_commands_and_the_brick_of_each_once(
    steps: list[tuple[str, Link, int, bool]],
) -> None:
    bench = Bench()
    asked: dict[int, list[Link]] = {}
    sent: list[int] = []
    waiting: list[int] = []
    ended: set[int] = set()
    for what, link, number, done in steps:
        bench.exits.notified.clear()
        if what == "command":
            if number not in asked:
                waits = link is Link.RELAY and (waiting or set(sent) - ended)
                (waiting if waits else sent).append(number)
            bench.command(link, forward(number))
            links = asked.setdefault(number, [])
            links += [] if link in links else [link]
            assert {to for to, _ in bench.exits.notified} <= {link}
        else:
            bench.says(executed(forward(number)) if done else received(forward(number)))
            unheard = number in ended or number in waiting
            assert [to for to, _ in bench.exits.notified] == (
                [] if unheard else asked.get(number, BOTH)
            )
            ended |= {number} & set(sent) if done else set()
            if done and waiting and not set(sent) - ended:
                sent.append(waiting.pop(0))
        assert bench.exits.brick == [encode(forward(number)) for number in sent]


@given(st.sampled_from(Link), st.text() | st.text(st.characters(categories=["Cs"])))
def test_no_text_from_a_link_breaks_it(link: Link, text: str) -> None:
    bench = Bench()
    bench.router.command(link, text)
    assert bench.exits.brick == []


@given(st.lists(st.binary(max_size=200)))
def test_no_octets_from_the_brick_break_it(chunks: list[bytes]) -> None:
    bench = Bench()
    for chunk in chunks:
        bench.router.heard(chunk)
    assert bench.exits == Exits()
