"""Cutting a stream into messages: in a buffer that follows what comes, up and down."""

import random

import pytest

from adapters.mal.errors import DecodeError
from adapters.mal.framing import MESSAGE_CAP, Framer
from adapters.mal.header import SHORTEST
from tests.mal.wiretest import cut

SIZES = (SHORTEST, 100, 5_000, 16 << 10, 66_000, 256 << 10, 700_000, 3 << 20, SHORTEST)


def message(size: int, fill: int) -> bytes:
    return size.to_bytes(4, "big") + bytes([fill]) * (size - 4)


@pytest.mark.parametrize("seed", range(5))
def test_messages_of_all_sizes_come_out_as_they_went_in(seed: int) -> None:
    chance = random.Random(seed)
    sent = [message(chance.choice(SIZES), number % 256) for number in range(40)]
    stream, framer = memoryview(b"".join(sent)), Framer()
    got: list[bytes] = []
    while stream:
        count = chance.choice((1, 3, 1000, 70_000, 300_000, 1 << 20))
        got += cut(framer, bytes(stream[:count]))
        stream = stream[count:]
    assert got == sent


def test_what_is_announced_takes_no_room_before_it_comes() -> None:
    framer = Framer()
    assert list(cut(framer, message(MESSAGE_CAP, 0)[:1000])) == []
    assert len(framer._buffer) <= 16 << 10
    assert list(cut(framer, bytes(1_000_000))) == []
    assert len(framer._buffer) <= 2 << 20


def test_a_long_message_leaves_no_long_buffer_behind() -> None:
    framer = Framer()
    (got,) = cut(framer, message(8 << 20, 7))
    assert len(got) == 8 << 20
    assert len(framer._buffer) <= 256 << 10


def test_many_messages_at_once_are_taken_in_large_pieces() -> None:
    framer = Framer()
    assert len(list(cut(framer, 20_000 * message(50, 1)))) == 20_000
    assert len(framer.room()) >= 128 << 10


def test_nothing_is_given_behind_what_cannot_be_a_message() -> None:
    got = cut(Framer(), message(50, 1) + (3).to_bytes(4, "big") + message(50, 2))
    assert next(got) == message(50, 1)
    with pytest.raises(DecodeError, match="message length 3"):
        next(got)
