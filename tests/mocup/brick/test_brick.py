"""One claimed brick, through pyusb, on a bus in the test."""

import errno
from collections.abc import Callable
from dataclasses import replace

import pytest

from adapters.mocup.brick.usb import Brick, BrickError, UsbAddress
from tests.mocup.brick.bus import ADDRESS, TIMEOUT, Bus


@pytest.fixture
def bus() -> Bus:
    return Bus()


def test_it_is_claimed_and_released(bus: Bus) -> None:
    with Brick(ADDRESS, bus):
        assert (bus.claims, bus.released) == (1, 0)
    assert (bus.claims, bus.released, bus.closed) == (1, 1, 1)


def test_it_is_released_when_its_user_raises(bus: Bus) -> None:
    with pytest.raises(ZeroDivisionError), Brick(ADDRESS, bus):
        raise ZeroDivisionError
    assert (bus.released, bus.closed) == (1, 1)


@pytest.mark.parametrize(
    "address", [replace(ADDRESS, vendor_id=0x0693), replace(ADDRESS, product_id=0x0005)]
)
def test_only_the_brick_that_was_asked_for_is_found(bus: Bus, address: UsbAddress) -> None:
    with pytest.raises(BrickError, match=f"no brick {address} is plugged in"):
        Brick(address, bus)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EBUSY, "another program has claimed it"),
        (errno.EACCES, "no permission"),
        (errno.EIO, "Input/output error"),
    ],
)
def test_a_claim_that_is_refused_says_why_and_closes(bus: Bus, number: int, words: str) -> None:
    bus.refuses = number
    with pytest.raises(BrickError, match=f"brick 0694:0002: .*{words}"):
        Brick(ADDRESS, bus)
    assert bus.closed == 1


@pytest.mark.parametrize("wrong", [{"endpoint_in": 0x81}, {"endpoint_out": 0x02}])
def test_an_endpoint_that_is_not_there_is_said_at_once(bus: Bus, wrong: dict[str, int]) -> None:
    with pytest.raises(BrickError, match="no endpoint 0x"):
        Brick(replace(ADDRESS, **wrong), bus)
    assert (bus.released, bus.closed) == (1, 1)


def test_reads_give_packets_without_their_padding(bus: Bus) -> None:
    bus.says(b"a" * 64, b"b\0\0", bytes(64), b"c".ljust(64, b"\0"))
    with Brick(ADDRESS, bus) as brick:
        assert [brick.read() for _ in range(4)] == [b"a" * 64, b"b", b"", b"c"]


def test_a_read_that_finds_nothing_returns_nothing(bus: Bus) -> None:
    with Brick(ADDRESS, bus) as brick:
        assert brick.read() == b""


def test_writes_go_out_packet_by_packet_as_far_as_they_are_taken(bus: Bus) -> None:
    with Brick(ADDRESS, bus) as brick:
        assert brick.write(b"x" * 100) == 64
        bus.most_taken = 10
        assert brick.write(b"y" * 36) == 10
        bus.faults.append(TIMEOUT)
        assert brick.write(b"z") == 0
    assert bus.written == [b"x" * 64, b"y" * 10]


@pytest.mark.parametrize("work", [Brick.read, lambda brick: brick.write(b"x")])
@pytest.mark.parametrize("number", [errno.ENODEV, errno.EIO, errno.EPIPE, errno.EOVERFLOW])
def test_any_other_fault_is_the_end_of_it(
    bus: Bus, work: Callable[[Brick], object], number: int
) -> None:
    bus.says(number)
    bus.faults.append(number)
    with Brick(ADDRESS, bus) as brick, pytest.raises(BrickError, match="USB: "):
        work(brick)
    assert len(bus.cleared) == (number == errno.EPIPE)


def test_one_that_is_gone_can_be_released(bus: Bus) -> None:
    with Brick(ADDRESS, bus):
        bus.plug(False)
    assert bus.closed == 1
