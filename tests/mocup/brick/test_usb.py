"""One claimed brick, through pyusb, on a bus in the test."""

import errno
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from threading import Event

import pytest

from adapters.mocup.brick.usb import (
    INCOMING,
    MAX_TIMEOUTS,
    OUTGOING,
    Brick,
    BrickConnected,
    BrickDisconnected,
    BrickError,
    BrickSession,
    OctetsReceived,
    SessionEvent,
    UsbAddress,
)
from tests.mocup.brick.bus import ADDRESS, TIMEOUT, Bus


@pytest.fixture
def bus() -> Bus:
    return Bus()


@pytest.mark.parametrize(
    "address", [replace(ADDRESS, vendor_id=0x0693), replace(ADDRESS, product_id=0x0005)]
)
def test_only_the_requested_brick_is_found(bus: Bus, address: UsbAddress) -> None:
    with pytest.raises(BrickError, match=f"no brick {address} is plugged in"):
        Brick(address, bus)


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (errno.EBUSY, "another program has claimed it"),
        (errno.EACCES, "no permission"),
        (errno.EIO, "Input/output error"),
    ],
)
def test_a_refused_claim_gives_the_reason_and_closes(bus: Bus, number: int, text: str) -> None:
    bus.refuses = number
    with pytest.raises(BrickError, match=f"brick 0694:0002: .*{text}"):
        Brick(ADDRESS, bus)
    assert bus.closed == 1


@pytest.mark.parametrize("wrong", [{"endpoint_in": 0x81}, {"endpoint_out": 0x02}])
def test_a_missing_endpoint_is_reported_at_once(bus: Bus, wrong: dict[str, int]) -> None:
    with pytest.raises(BrickError, match="no endpoint 0x"):
        Brick(replace(ADDRESS, **wrong), bus)
    assert (bus.released, bus.closed) == (1, 1)


LIMIT_S = 60.0


class Bench:
    """A session on a bus, and what it told."""

    def __init__(self) -> None:
        self.bus = Bus()
        self.happened: list[SessionEvent] = []
        self._woken = Event()
        self.session = BrickSession(lambda: Brick(ADDRESS, self.bus), self._woken.set)

    def until(self, done: Callable[[], bool], what: str, taking: bool = True) -> None:
        """Wait until something holds; take what happens meanwhile, or leave it where it is."""
        deadline_s = time.monotonic() + LIMIT_S
        while not done():
            assert time.monotonic() < deadline_s, f"waited in vain: {what}; {self.happened}"
            self._woken.wait(0.01)
            self._woken.clear()
            if taking:
                self.happened += self.session.events()

    def found(self, times: int = 1) -> None:
        def there() -> bool:
            visits = [
                event.connection_number
                for event in self.happened
                if isinstance(event, BrickConnected)
            ]
            return visits == list(range(1, times + 1)) and self.session.connected

        self.until(there, "the brick")

    def lost(self) -> None:
        self.until(
            lambda: any(isinstance(event, BrickDisconnected) for event in self.happened), "its end"
        )

    @property
    def octets(self) -> bytes:
        return b"".join(
            event.octets for event in self.happened if isinstance(event, OctetsReceived)
        )


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.session.close()
    assert not bench.session.connected
    assert bench.bus.closed == bench.bus.opened


def warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.message for record in caplog.records if record.levelno == logging.WARNING]


def test_it_sends_and_receives(bench: Bench) -> None:
    bench.session.start()
    bench.found()
    bench.bus.sends(b"one, ", b"two".ljust(64, b"\0"))
    assert bench.session.send(b"x" * 150, 1)
    bench.until(lambda: bench.octets == b"one, two", "what the brick says")
    bench.until(lambda: b"".join(bench.bus.written) == b"x" * 150, "what is for the brick")
    assert [len(packet) for packet in bench.bus.written] == [64, 64, 22]
    bench.session.close()
    assert (bench.bus.released, bench.bus.closed) == (1, 1)


def test_without_a_brick_nothing_is_accepted_and_one_line_printed(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    bench.bus.plugged = False
    bench.session.start()
    bench.until(lambda: bool(warnings(caplog)), "a line")
    assert not bench.session.send(b"x", 1)
    bench.bus.plug(True)
    bench.found()
    assert warnings(caplog) == ["no brick 0694:0002 is plugged in; searching for it again"]
    assert bench.bus.written == []


def test_a_brick_that_another_program_has_is_waited_for_with_one_line(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    bench.bus.refuses = errno.EBUSY
    bench.session.start()
    bench.until(lambda: bench.bus.closed >= 3, "three tries")
    bench.bus.refuses = 0
    bench.found()
    (line,) = warnings(caplog)
    assert line == "brick 0694:0002: another program has claimed it; searching for it again"


def test_unplugged_and_plugged_in_again_it_continues(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    bench.session.start()
    bench.found()
    bench.bus.plug(False)
    bench.lost()
    assert not bench.session.connected
    assert not bench.session.send(b"late", 1)
    bench.bus.plug(True)
    bench.found(2)
    assert bench.session.send(b"hello", 2)
    bench.until(lambda: bench.bus.written == [b"hello"], "a word")
    message = [record.message for record in caplog.records]
    assert message[0] == message[-1] == "brick connected"
    assert message[1] == "brick disconnected: USB: No such device; searching for it again"
    assert len(message) <= 4  # and perhaps that none is plugged in


@pytest.mark.parametrize("number", [errno.EPIPE, errno.EIO, errno.EOVERFLOW])
def test_a_fault_of_either_endpoint_is_healed_by_claiming_again(bench: Bench, number: int) -> None:
    bench.session.start()
    bench.found()
    bench.bus.sends(b"before", number)
    bench.found(2)
    bench.bus.faults.append(number)
    assert bench.session.send(b"x", 2)
    bench.found(3)
    bench.bus.sends(b" and after")
    bench.until(lambda: bench.octets == b"before and after", "it goes on")
    assert len(bench.bus.cleared) == (2 if number == errno.EPIPE else 0)


def test_a_slow_brick_gets_everything_and_delays_no_other_link(bench: Bench) -> None:
    bench.bus.max_accepted = 1
    bench.bus.faults += [TIMEOUT, 0] * (MAX_TIMEOUTS + 1)
    bench.session.start()
    bench.found()
    assert bench.session.send(b"slowly but surely", 1)
    bench.bus.sends(b"meanwhile")
    bench.until(lambda: bench.octets == b"meanwhile", "it is heard")
    bench.until(lambda: b"".join(bench.bus.written) == b"slowly but surely", "all of it")


def test_a_brick_that_accepts_nothing_is_disconnected_with_its_queue(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = Event()
    take = bench.bus.bulk_write

    def hold(*arguments: object) -> int:
        held.wait(LIMIT_S)
        return take(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(bench.bus, "bulk_write", hold)
    bench.bus.faults += [0, *[TIMEOUT] * MAX_TIMEOUTS]
    bench.session.start()
    bench.found()
    assert bench.session.send(b"y" * 65, 1)
    sent = 1
    while bench.session.send(b"z", 1):
        sent += 1
    assert OUTGOING <= sent <= OUTGOING + 1
    held.set()
    bench.lost()
    assert BrickDisconnected("it accepts no data") in bench.happened
    bench.found(2)
    assert bench.session.send(b"new", 2)
    bench.until(lambda: bench.bus.written[-1] == b"#new", "a word")
    # Cut in the middle, the old command is ended; what waited is not obeyed late.
    assert bench.bus.written == [b"y" * 64, b"#new"]


def test_a_message_for_a_disconnected_brick_is_not_for_the_next(bench: Bench) -> None:
    bench.session.start()
    bench.found()
    assert bench.session.send(b"first", 1)
    bench.until(lambda: bench.bus.written == [b"first"], "a word")
    bench.bus.plug(False)
    bench.lost()
    bench.bus.plug(True)
    bench.found(2)
    assert not bench.session.send(b"late", 1)
    assert bench.session.stop(b"stop")
    bench.until(lambda: bench.bus.written == [b"first", b"stop"], "a word for any")


def test_a_message_waits_for_its_commit_and_a_stop_does_not(bench: Bench) -> None:
    bench.session.start()
    bench.found()
    assert bench.session.send(b"dropped", 1, 1)
    assert bench.session.stop(b"stop")
    bench.until(lambda: bench.bus.written == [b"stop"], "the stop")
    bench.session.release(1)
    assert bench.session.stop(b"stop")
    bench.until(lambda: bench.bus.written == 2 * [b"stop"], "another stop")
    assert bench.session.send(b"third", 1, 4)
    assert bench.session.send(b"fourth", 1, 5)
    bench.session.release(4)
    bench.until(lambda: bench.bus.written[2:] == [b"third"], "a released one")
    bench.session.release(5)
    bench.until(lambda: bench.bus.written[3:] == [b"fourth"], "the other one")


def test_without_a_reader_the_brick_is_not_read(bench: Bench) -> None:
    text = [f"{number:03}".encode() for number in range(3 * INCOMING)]
    bench.bus.sends(*text)
    bench.session.start()
    bench.until(lambda: len(bench.bus.packets) <= 2 * INCOMING, "it fills", taking=False)
    assert len(bench.bus.packets) >= 2 * INCOMING
    bench.until(lambda: len(bench.octets) == 3 * len(text), "all of it")
    assert bench.octets == b"".join(text)


def test_an_exception_on_its_threads_is_logged_and_it_continues(
    bench: Bench, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raise_once(_: Brick) -> bytes:
        monkeypatch.undo()
        raise ZeroDivisionError

    monkeypatch.setattr(Brick, "read", raise_once)
    bench.session.start()
    bench.found(2)
    assert any(record.levelno == logging.ERROR for record in caplog.records)
    assert BrickDisconnected("ZeroDivisionError()") in bench.happened
