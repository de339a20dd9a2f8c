"""Two nodes over LTP in simulated time, what can happen between them, and their applications."""

import heapq
import random
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from adapters.bundle.codec.bundle import BundleId
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.errors import DecodeError, StoreError
from adapters.bundle.links.contact import ContactGate, ContactPlan
from adapters.bundle.links.link import LinkContext
from adapters.bundle.links.ltp import LtpNeighbour
from adapters.bundle.links.ltp_segment import Segment, decode_segment, encode_segment
from adapters.bundle.node.database import BundleDatabase, StoreLimits
from adapters.bundle.node.node import BundleNode
from adapters.bundle.node.reporting import DeliveryNotice
from adapters.bundle.node.settings import Address, LtpLink, Neighbour, NodeSettings
from tests.support.unsynced import UNSYNCED

START_UTC_S = 1_800_000_000.0
TICK_S = 1.0


@dataclass(frozen=True, slots=True)
class Weather:
    """What the link does to datagrams.

    Attributes:
        dark: times in which nothing gets through, as begin and end.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    corrupt: float = 0.0
    least_delay_s: float = 0.01
    max_delay_s: float = 0.01
    dark: tuple[tuple[float, float], ...] = ()

    def is_dark(self, now_s: float) -> bool:
        return any(begin <= now_s < end for begin, end in self.dark)


@dataclass
class Application:
    """Keeps for ever what it was given, as a ledger would.

    Attributes:
        again: how often it was given what it had.
    """

    had: dict[BundleId, bytes] = field(default_factory=dict)
    again: int = 0

    def give(self, identity: BundleId, payload: bytes) -> None:
        self.again += identity in self.had
        self.had[identity] = payload


class Side:
    """One node, which may die at any time; its file and its application stay."""

    def __init__(
        self,
        world: "World",
        number: int,
        other: int,
        folder: Path,
        link: LtpLink,
        limits: StoreLimits | None = None,
        plan: ContactPlan | None = None,
    ) -> None:
        self.world, self.number, self.other = world, number, other
        self.settings = NodeSettings(
            Ipn(number, 1), (Ipn(number, 1),), (Neighbour(Ipn(other, 0), link),)
        )
        self.path = folder / f"{number}.db"
        self.limits = limits
        self.application = Application()
        self.notices: list[DeliveryNotice] = []
        self.clock_error_s = 0.0
        self.reads = True
        self.put_count = 0
        self.plan = plan
        self.deaths = 0
        self.dies_after_commit = False
        self.transmits = True
        self.start()

    @property
    def destination(self) -> Ipn:
        return Ipn(self.other, 1)

    def utc_s(self) -> float:
        return START_UTC_S + self.world.now_s + self.clock_error_s

    def start(self) -> None:
        self.database = BundleDatabase(self.path, self.limits, UNSYNCED)
        self.node = BundleNode(
            self.settings, self.database, lambda: int(1000 * self.utc_s()), self.notices.append
        )
        first = self.database.reserve("session", 1 << 20)
        numbers = count(first)
        (neighbour,) = self.settings.neighbours
        assert isinstance(neighbour.link, LtpLink)
        context = LinkContext(self.node, lambda: self.world.now_s, lambda: None)
        self.link = LtpNeighbour(
            context, neighbour, neighbour.link, lambda: next(numbers), self._transmit
        )
        self.gate = ContactGate(self.settings.node, neighbour.node, self.plan, self.utc_s)
        self.transmits = True

    def die(self) -> None:
        """End as by kill -9 and start again."""
        self.deaths += 1
        self.database.close()
        self.start()
        self.settle()

    def kill(self) -> None:
        """Die now, or just after the next commit, before anybody hears of it."""
        if self.world.chance.random() < 0.5:
            self.dies_after_commit = True
        else:
            self.die()

    def step_clock(self, by_s: float) -> None:
        """Set the wall clock to another time."""
        self.clock_error_s += by_s

    def put(self, payload: bytes) -> BundleId:
        self.put_count += 1
        return self.node.put(self.destination, payload)

    def receive(self, datagram: bytes) -> None:
        try:
            segment = decode_segment(datagram)
        except DecodeError:
            return
        self.link.receive(segment)

    def settle(self) -> None:
        """Commit, let the application have what is there, and send; or die in between."""
        self._read()
        while self.node.transaction.pending:
            if self.dies_after_commit:
                self.dies_after_commit, self.transmits = False, False
                self.node.transaction.commit()
                self.die()
                return
            self.node.transaction.commit()
            self._read()
        self.link.on_contact(self.gate.state())
        self.link.send_waiting()

    def _read(self) -> None:
        while self.reads and (fetched := self.node.fetch()):
            self.application.give(fetched.identity, fetched.payload)
            self.node.mark_delivered(fetched)

    def _transmit(self, segments: list[Segment]) -> None:
        if self.transmits:
            self.world.carry(self, [encode_segment(segment) for segment in segments])


class World:
    """Time and the link between two sides."""

    def __init__(
        self,
        folder: Path,
        seed: int,
        weather: Weather,
        link: LtpLink | None = None,
        limits: StoreLimits | None = None,
        plan: ContactPlan | None = None,
    ) -> None:
        self.now_s = 0.0
        self.chance = random.Random(seed)
        self.weather = weather
        self.datagrams = 0
        self._events: list[tuple[float, int, Callable[[], object]]] = []
        self._order = count()
        link = link or LtpLink(Address("nowhere", 0))
        self.one = Side(self, 1, 2, folder, link, plan=plan)
        self.two = Side(self, 2, 1, folder, link, limits, plan)
        for side in (self.one, self.two):
            self.at(TICK_S, lambda side=side: self._tick(side))  # type: ignore[misc]

    def other(self, side: Side) -> Side:
        return self.two if side is self.one else self.one

    def at(self, time_s: float, do: Callable[[], object]) -> None:
        heapq.heappush(self._events, (time_s, next(self._order), do))

    def carry(self, sender: Side, datagrams: list[bytes]) -> None:
        weather, chance = self.weather, self.chance
        for datagram in datagrams:
            self.datagrams += 1
            for _ in range(2 if chance.random() < weather.duplicate else 1):
                if chance.random() < weather.loss or weather.is_dark(self.now_s):
                    continue
                carried = self._changed(datagram)
                delay_s = chance.uniform(weather.least_delay_s, weather.max_delay_s)
                self.at(
                    self.now_s + delay_s,
                    lambda carried=carried: self._arrive(sender, carried),  # type: ignore[misc]
                )

    def run(self, until_s: float, done: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass; return whether it was done before the time was over."""
        while self._events:
            due_s, _, _ = self._events[0]
            next_s = max(min(due_s, self.one.link.next_s, self.two.link.next_s), self.now_s)
            if next_s > until_s:
                break
            self.now_s = next_s
            while self._events and self._events[0][0] <= self.now_s:
                heapq.heappop(self._events)[2]()
            for side in (self.one, self.two):
                if side.link.next_s <= self.now_s:
                    side.link.tick()
                side.settle()
            if done():
                return True
        self.now_s = max(self.now_s, until_s)
        return False

    def _changed(self, datagram: bytes) -> bytes:
        if self.chance.random() >= self.weather.corrupt:
            return datagram
        return datagram[: self.chance.randrange(len(datagram))]

    def _arrive(self, sender: Side, datagram: bytes) -> None:
        self.other(sender).receive(datagram)

    def _tick(self, side: Side) -> None:
        with suppress(StoreError):
            side.node.tick()
        self.at(self.now_s + TICK_S, lambda: self._tick(side))


def dark_times(
    chance: random.Random, until_s: float, lit_s: float
) -> Iterator[tuple[float, float]]:
    """Return black-outs of 1 to 60 s with some light between them."""
    at_s = 0.0
    while at_s < until_s:
        at_s += chance.uniform(0.2 * lit_s, 1.8 * lit_s)
        end_s = at_s + chance.uniform(1.0, 60.0)
        yield at_s, end_s
        at_s = end_s


class Mortal:
    """Puts numbered messages in at random times.

    Attributes:
        put: those that the node said it has.
    """

    def __init__(self, world: World, side: Side, count: int, until_s: float) -> None:
        self.side = side
        self.put: list[bytes] = []
        self._number = 0
        for _ in range(count):
            world.at(world.chance.uniform(0.0, until_s), self._put)

    def _put(self) -> None:
        payload = b"%d-%06d" % (self.side.number, self._number)
        self._number += 1
        self.side.put(payload)
        self.side.node.transaction.on_commit(lambda failure: self._count(payload, failure))

    def _count(self, payload: bytes, failure: object) -> None:
        if failure is None:
            self.put.append(payload)
