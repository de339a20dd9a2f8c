"""What waits for a subscriber that is too slow: in order, bounded, dropped only if it may be."""

from adapters.mal import outbox
from adapters.mal.outbox import Outbox


def test_the_outbox_keeps_order_and_drops_only_the_oldest_that_it_may() -> None:
    written: list[bytes] = []
    given_up: list[str] = []
    box = Outbox(written.append, given_up.append)
    box.put(b"first", droppable=False)
    box.pause()
    for number in range(outbox.DROPPABLE_CAP + 10):
        box.put(b"t%d" % number, droppable=True)
        if number % 100 == 0:
            box.put(b"r%d" % number, droppable=False)
    assert written == [b"first"]
    box.resume()
    dropped = {b"t%d" % number for number in range(10)}
    everything = [
        name % number
        for number in range(outbox.DROPPABLE_CAP + 10)
        for name in (b"t%d", b"r%d")
        if name == b"t%d" or number % 100 == 0
    ]
    assert written[1:] == [message for message in everything if message not in dropped]
    assert not given_up
    box.pause()
    for _ in range(outbox.BACKLOG_CAP + 1):
        box.put(b"r", droppable=False)
    assert len(given_up) == 1


def test_the_outbox_stops_when_it_is_paused_while_it_empties() -> None:
    written: list[bytes] = []

    def write(message: bytes) -> None:
        written.append(message)
        box.pause()

    box = Outbox(write, lambda _: None)
    box.pause()
    for message in (b"a", b"b", b"c"):
        box.put(message, droppable=True)
    for count in (1, 2, 3):
        box.resume()
        assert len(written) == count
    assert written == [b"a", b"b", b"c"]
