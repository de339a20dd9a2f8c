"""The order of notifications across a loss of the link, moment by moment."""

import asyncio
from typing import Any

from adapters.mal import OnUpdate, Subscription, UpdateHeader
from adapters.mrs.ground.notification_stream import NotificationStream
from adapters.mrs.spec.types import Notification, NotificationKind, Severity


def fact(sequence: int, text: str = "") -> Notification:
    return Notification(
        kind=NotificationKind.EVENT,
        severity=Severity.WARNING,
        timestamp=0,
        sequence=sequence,
        text=text,
    )


class Connection:
    """What a feed needs of a consumer.

    Args:
        ledger: what the rover has written down.
        meanwhile: what it sends while it is asked for that.
    """

    def __init__(self, *ledger: Notification, meanwhile: tuple[Notification, ...] = ()) -> None:
        self.ledger = ledger
        self.meanwhile = list(meanwhile)

    async def subscribe(self, _: str, __: str, ___: Subscription, on_update: OnUpdate) -> None:
        self._on_update = on_update

    async def request(self, _: str, __: str, since: int, *___: Any) -> tuple[Any, ...]:
        while self.meanwhile:
            self.send(self.meanwhile.pop(0))
        return (tuple(n for n in self.ledger if n.sequence >= since)[:2],)

    def send(self, notification: Notification) -> None:
        self._on_update(UpdateHeader(), notification)


class Listener:
    def __init__(self) -> None:
        self.heard: list[int] = []
        self.strangers = 0
        self.feed = NotificationStream(lambda n: self.heard.append(n.sequence), self._strange)

    def on(self, connection: Connection) -> Connection:
        asyncio.run(self.feed.restore(connection))  # type: ignore[arg-type]
        return connection

    def _strange(self) -> None:
        self.strangers += 1


def test_the_first_connection_asks_for_nothing_of_the_past() -> None:
    listener = Listener()
    listener.on(Connection(fact(1), fact(2))).send(fact(3))
    assert listener.heard == [3]


def test_what_was_missed_comes_before_what_comes() -> None:
    listener = Listener()
    listener.on(Connection()).send(fact(1))
    again = Connection(*map(fact, range(1, 7)), meanwhile=(fact(6), fact(7)))
    listener.on(again).send(fact(8))
    assert listener.heard == [1, 2, 3, 4, 5, 6, 7, 8]
    assert listener.strangers == 0


def test_what_is_sent_again_is_heard_again_and_is_not_the_last() -> None:
    listener = Listener()
    first = listener.on(Connection())
    for sequence in (4, 5, 4):
        first.send(fact(sequence))
    listener.on(Connection(*map(fact, range(1, 7))))
    assert listener.heard == [4, 5, 4, 6]


def test_another_ledger_is_told_from_the_one_known() -> None:
    for ledger in ((), (fact(1),), (fact(5, "other"), fact(6))):
        listener = Listener()
        listener.on(Connection()).send(fact(5))
        listener.on(Connection(*ledger)).send(fact(2))
        assert listener.heard == [5, 2]
        assert listener.strangers == 1


def test_what_a_relay_says_of_itself_has_no_place_among_the_numbers() -> None:
    listener = Listener()
    first = listener.on(Connection())
    first.send(fact(0, "contact"))
    first.send(fact(1))
    first.send(fact(0, "no contact"))
    listener.on(Connection(fact(1), fact(2), meanwhile=(fact(0, "contact"),)))
    assert listener.heard == [0, 1, 0, 2, 0]
    assert listener.strangers == 0
