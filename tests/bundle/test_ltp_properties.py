"""The LTP engine and its ranges under whatever comes."""

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.bundle.links.ltp_engine import Arrived, Ranges
from adapters.bundle.links.ltp_segment import Segment
from tests.bundle.strategies import SEGMENTS
from tests.bundle.test_ltp import Engine


@settings(max_examples=300)
@given(st.lists(SEGMENTS, max_size=30), st.randoms(use_true_random=False))
def test_whatever_segments_come_nothing_breaks(
    segments: list[Segment], chance: random.Random
) -> None:
    engine = Engine()
    engine.span.send(bytes(100))
    for segment in segments:
        engine.span.receive(segment)
        for event in engine.events():
            if isinstance(event, Arrived):
                if chance.random() < 0.5:
                    engine.span.stored(event.number)
                else:
                    engine.span.refuse(event.number)
        engine.wait(chance.random())
        engine.said()


@given(
    st.lists(st.tuples(st.booleans(), st.integers(0, 50), st.integers(0, 20))),
    st.integers(0, 60),
    st.integers(0, 60),
)
def test_ranges_are_sets(steps: list[tuple[bool, int, int]], begin: int, end: int) -> None:
    ranges, numbers = Ranges(), set[int]()
    for adds, at, length in steps:
        span = set(range(at, at + length))
        if adds:
            ranges.add(at, at + length)
            numbers |= span
        else:
            ranges.remove(at, at + length)
            numbers -= span
    assert {number for left, right in ranges for number in range(left, right)} == numbers
    wanted = set(range(begin, end))
    gaps = {number for left, right in ranges.gaps(begin, end) for number in range(left, right)}
    assert gaps == wanted - numbers
    assert ranges.cover(begin, end) == (wanted <= numbers)
