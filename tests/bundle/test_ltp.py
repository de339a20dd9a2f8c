"""The LTP engine by itself: what was recorded, and the habits of other engines."""

import json
import random
from itertools import count
from math import inf
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.bundle.links.ltp_engine import (
    BlockReceived,
    ExportCancelled,
    ExportCompleted,
    LtpSpan,
    Ranges,
)
from adapters.bundle.links.ltp_segment import (
    Cancel,
    CancelAck,
    Checkpoint,
    Data,
    ReceptionClaim,
    ReportAck,
    ReportSegment,
    Segment,
    SessionId,
    decode_segment,
)
from adapters.bundle.node.settings import Address, LtpLink
from tests.bundle.strategies import SEGMENTS
from tests.support.examples import examples

VECTORS = Path(__file__).with_name("vectors.json")
RECORDED = [bytes.fromhex(row["hex"]) for row in json.loads(VECTORS.read_text())["ltp_segments"]]
LINK = LtpLink(Address("nowhere", 0), segment_octets=10, answer_s=1.0)


class Engine:
    """A span with a clock in the hands of the test."""

    def __init__(self, own: int = 5, other: int = 1, first: int = 1) -> None:
        self.now_s = 0.0
        numbers = count(first)
        self.span = LtpSpan(own, other, LINK, lambda: next(numbers), lambda: self.now_s, lambda: 1)

    def output(self) -> list[Segment]:
        message, self.span.segments[:] = list(self.span.segments), []
        return message

    def events(self) -> list[object]:
        events, self.span.events[:] = list(self.span.events), []
        return list(events)

    def wait(self, time_s: float) -> None:
        self.now_s += time_s
        self.span.tick()


def reported(
    checkpoint: Data, *claims: tuple[int, int], serial: int = 1, upper: int = 0
) -> ReportSegment:
    assert checkpoint.checkpoint
    return ReportSegment(
        checkpoint.session,
        serial,
        checkpoint.checkpoint.serial,
        upper or checkpoint.offset + len(checkpoint.octets),
        0,
        tuple(ReceptionClaim(*claim) for claim in claims),
    )


def data_of(segments: list[Segment]) -> list[Data]:
    assert all(isinstance(segment, Data) for segment in segments)
    return [segment for segment in segments if isinstance(segment, Data)]


def test_a_block_that_ion_sent_is_reported_as_it_was_then() -> None:
    engine = Engine()
    engine.span.receive(decode_segment(RECORDED[3]))
    (arrived,) = engine.events()
    assert isinstance(arrived, BlockReceived)
    assert engine.output() == []
    engine.span.mark_stored(arrived.number)
    (report,) = engine.output()
    then = decode_segment(RECORDED[4])
    assert isinstance(report, ReportSegment)
    assert isinstance(then, ReportSegment)
    assert (report.session, report.claims) == (then.session, then.claims)
    assert report.checkpoint_serial == then.checkpoint_serial
    engine.span.receive(ReportAck(report.session, report.serial))
    engine.wait(100.0)
    assert engine.output() == []


def test_a_block_that_ion_took_is_done() -> None:
    first = decode_segment(RECORDED[0])
    assert isinstance(first, Data)
    engine = Engine(first=first.session.number)
    number = engine.span.send(bytes(74))
    checkpoint = data_of(engine.output())[-1]
    recorded = decode_segment(RECORDED[1])
    assert isinstance(recorded, ReportSegment)
    engine.span.receive(reported(checkpoint, (0, 74), serial=recorded.serial))
    assert engine.output() == [decode_segment(RECORDED[2])]
    assert engine.events() == [ExportCompleted(number)]
    assert engine.span.owns(checkpoint.session)
    engine.span.receive(reported(checkpoint, (0, 74), serial=recorded.serial))
    assert engine.output() == [decode_segment(RECORDED[2])]
    assert engine.events() == []


def test_a_missing_segment_is_resent_with_a_checkpoint() -> None:
    engine = Engine()
    engine.span.send(bytes(range(40)))
    sent = data_of(engine.output())
    assert [bool(data.checkpoint) for data in sent] == [False, False, False, True]
    engine.span.receive(reported(sent[-1], (0, 10), (30, 10)))
    ack, *again = engine.output()
    assert isinstance(ack, ReportAck)
    assert [data.offset for data in data_of(again)] == [10, 20]
    last = data_of(again)[-1]
    assert last.checkpoint
    assert sent[-1].checkpoint
    assert last.checkpoint.report_serial == 1
    assert last.checkpoint.serial == sent[-1].checkpoint.serial + 1


def test_a_checkpoint_is_repeated_for_as_long_as_it_takes_but_not_without_contact() -> None:
    engine = Engine()
    engine.span.send(bytes(5))
    (checkpoint,) = engine.output()
    for _ in range(100):
        engine.wait(1.0)
        assert engine.output() == [checkpoint]
    assert engine.span.resent == 100
    engine.span.suspend()
    assert engine.span.next_s == inf
    engine.wait(1000.0)
    assert engine.output() == []
    engine.span.resume()
    engine.wait(0.0)
    assert engine.output() == [checkpoint]


def test_a_round_trip_is_that_of_a_checkpoint_that_was_sent_once() -> None:
    engine = Engine()
    engine.span.send(bytes(40))
    first = data_of(engine.output())[-1]
    engine.now_s += 0.25
    engine.span.receive(reported(first, (0, 10)))
    assert engine.span.round_trip_s == 0.25
    assert engine.span.resent == 3
    last = data_of(engine.output()[1:])[-1]
    engine.wait(1.0)  # repeated: nobody knows which of the two is answered
    engine.span.receive(reported(last, (0, 40), serial=2))
    assert isinstance(engine.events()[-1], ExportCompleted)
    assert engine.span.round_trip_s == 0.25
    assert engine.span.resent == 4


def test_the_light_time_makes_it_wait() -> None:
    engine = Engine()
    engine.span.light_time_s = 10.0
    engine.span.send(bytes(5))
    engine.output()
    engine.wait(20.9)
    assert engine.output() == []
    engine.wait(0.2)
    assert len(engine.output()) == 1


def test_a_report_of_less_than_all_is_followed_by_the_rest() -> None:
    engine = Engine()
    engine.span.send(bytes(40))
    sent = data_of(engine.output())
    engine.span.receive(reported(sent[-1], (0, 10), upper=10))
    again = data_of(engine.output()[1:])
    assert [data.offset for data in again] == [10, 20, 30]


def test_a_receiver_that_lost_its_memory_gets_everything_again() -> None:
    engine = Engine()
    number = engine.span.send(bytes(40))
    first = data_of(engine.output())[-1]
    engine.span.receive(reported(first, (0, 10), (30, 10)))
    second = data_of(engine.output()[1:])[-1]
    engine.span.receive(reported(second, (10, 20), serial=7))
    again = data_of(engine.output()[1:])
    assert [data.offset for data in again] == [0]
    assert engine.events() == []
    third = again[-1]
    engine.span.receive(
        ReportSegment(third.session, 8, third.checkpoint.serial, 40, 0, (ReceptionClaim(0, 40),))
        if third.checkpoint
        else pytest.fail("no checkpoint")
    )
    assert engine.events() == [ExportCompleted(number)]


def test_a_peer_that_lost_its_memory_reports_it() -> None:
    engine = Engine()
    session = SessionId(1, 9)
    engine.span.receive(Data(session, 1, 0, b"x", True, Checkpoint(2, 77), True, True))
    assert engine.output() == [Cancel(session, by_sender=False, reason=4)]
    assert engine.events() == []


def test_a_peer_that_lost_its_memory_in_mid_block_reports_it_despite_later_segments() -> None:
    sender, receiver = Engine(1, 5), Engine(5, 1)
    number = sender.span.send(bytes(40))
    sent = data_of(sender.output())
    sender.span.receive(reported(sent[-1], (0, 10), (30, 10), serial=77))
    for data in data_of(sender.output()[1:]):
        receiver.span.receive(data)
    (cancel,) = receiver.output()
    sender.span.receive(cancel)
    assert sender.events() == [ExportCancelled(number)]


def test_a_cancelled_block_is_returned_and_acknowledged() -> None:
    engine = Engine()
    number = engine.span.send(b"x")
    engine.output()
    session = SessionId(5, number)
    for _ in range(2):
        engine.span.receive(Cancel(session, by_sender=False, reason=4))
        assert engine.output() == [CancelAck(session, of_sender=False)]
    assert engine.events() == [ExportCancelled(number)]
    assert engine.span.next_s == inf


def test_a_sender_that_cancels_is_forgotten() -> None:
    engine = Engine()
    session = SessionId(1, 9)
    engine.span.receive(Data(session, 1, 0, b"x"))
    engine.span.receive(Cancel(session, by_sender=True, reason=0))
    assert engine.output() == [CancelAck(session, of_sender=True)]
    engine.span.receive(Data(session, 1, 1, b"y", True, Checkpoint(2), True, True))
    assert engine.events() == []


def test_a_block_that_is_not_stored_is_not_reported_whole_for_any_number_of_checkpoints() -> None:
    engine = Engine()
    data = Data(SessionId(1, 9), 1, 0, b"x", True, Checkpoint(2), True, True)
    for _ in range(5):
        engine.span.receive(data)
    assert engine.output() == []
    assert len(engine.events()) == 1
    engine.span.mark_stored(9)
    (report,) = engine.output()
    assert isinstance(report, ReportSegment)
    engine.span.receive(data)
    (again,) = engine.output()
    assert isinstance(again, ReportSegment)
    assert again.claims == report.claims
    assert engine.events() == []


def test_an_unacknowledged_report_is_repeated_a_few_times() -> None:
    engine = Engine()
    engine.span.receive(Data(SessionId(1, 9), 1, 0, b"x", True, Checkpoint(2), True, True))
    engine.span.mark_stored(9)
    message = len(engine.output())
    for _ in range(100):
        engine.wait(1.0)
        message += len(engine.output())
    assert message == 6


def test_segments_in_any_order_become_the_block() -> None:
    chance = random.Random(1)
    sender, receiver = Engine(1, 5), Engine(5, 1)
    block = chance.randbytes(95)
    sender.span.send(block)
    segments = sender.output() * 2
    chance.shuffle(segments)
    for segment in segments:
        receiver.span.receive(segment)
    assert receiver.events() == [BlockReceived(1, block)]


def arrive(receiver: Engine, sender: Engine, block: bytes) -> list[object]:
    """Send a block until it is stored, whatever is asked for again; return what has arrived."""
    sender.span.send(block)
    arrived: list[object] = []
    for _ in range(5):
        for segment in sender.output():
            receiver.span.receive(segment)
        for event in receiver.events():
            assert isinstance(event, BlockReceived)
            receiver.span.mark_stored(event.number)
            arrived.append(event)
        for segment in receiver.output():
            sender.span.receive(segment)
    return arrived


@pytest.mark.parametrize("octets", [5, 10, 95])
def test_an_engine_with_restarted_numbers_loses_nothing(octets: int) -> None:
    """ION 4.1 begins with session 1 again; 15 of 15 blocks were acknowledged and thrown away."""
    receiver = Engine(5, 1)
    for run in range(3):
        sender = Engine(1, 5)
        for number in range(15):
            block = bytes((run, number)) * octets
            assert arrive(receiver, sender, block) == [BlockReceived(number + 1, block)]


def test_half_a_block_of_an_earlier_process_is_not_mixed_with_the_next() -> None:
    receiver, before, after = Engine(5, 1), Engine(1, 5), Engine(1, 5)
    before.span.send(b"old" * 30)
    for segment in before.output()[1:-1]:
        receiver.span.receive(segment)
    assert arrive(receiver, after, b"new" * 30) == [BlockReceived(1, b"new" * 30)]


def test_a_stored_block_is_forgotten_after_some_round_trips_without_repeats() -> None:
    receiver, sender = Engine(5, 1), Engine(1, 5)
    sender.span.send(b"block")
    (checkpoint,) = sender.output()
    receiver.span.receive(checkpoint)
    assert receiver.events() == [BlockReceived(1, b"block")]
    receiver.span.mark_stored(1)
    for _ in range(5):
        receiver.now_s += 9.0
        receiver.span.receive(checkpoint)
        assert receiver.events() == []
    receiver.now_s += 11.0
    receiver.span.receive(checkpoint)
    assert receiver.events() == [BlockReceived(1, b"block")]


def test_blocks_that_never_end_do_not_pile_up() -> None:
    engine = Engine()
    for number in range(2000):
        engine.span.receive(Data(SessionId(1, number), 1, 0, bytes(100)))
    refused = [segment for segment in engine.output() if isinstance(segment, Cancel)]
    assert len(refused) == 2000 - 256


@settings(max_examples=examples(300))
@given(st.lists(SEGMENTS, max_size=30), st.randoms(use_true_random=False))
def test_no_segment_breaks_the_engine(segments: list[Segment], chance: random.Random) -> None:
    engine = Engine()
    engine.span.send(bytes(100))
    for segment in segments:
        engine.span.receive(segment)
        for event in engine.events():
            if isinstance(event, BlockReceived):
                if chance.random() < 0.5:
                    engine.span.mark_stored(event.number)
                else:
                    engine.span.refuse(event.number)
        engine.wait(chance.random())
        engine.output()


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
