"""Wrong bundles, LTP segments and TCPCL streams against one node: each is refused, no more.

Half of them are octets that were turned, cut or mixed; half are bundles whose check sums are right
and whose fields are not.
"""

import logging
import resource
import tempfile
import time
from contextlib import suppress
from itertools import count
from pathlib import Path
from random import Random
from typing import Final

from adapters.bundle import Address, Eid, LtpLink, Neighbour, NodeSettings, StoreFull
from adapters.bundle.codec.bundle import (
    Block,
    Bundle,
    Crc,
    Creation,
    Part,
    Primary,
    decode_bundle,
    encode_bundle,
)
from adapters.bundle.codec.eid import Dtn, Ipn
from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.links.ltp_engine import Arrived, LtpSpan
from adapters.bundle.links.ltp_segment import (
    Checkpoint,
    Claim,
    Data,
    Report,
    SessionId,
    decode_segment,
    encode_segment,
)
from adapters.bundle.links.tcpcl_session import (
    AckSegment,
    ContactHeader,
    DataSegment,
    TcpclSession,
    encode_message,
)
from adapters.bundle.node.database import Database, Limits, Synchronous
from adapters.bundle.node.node import Node
from adapters.bundle.node.settings import TcpclLink
from tests.stress.mutation import mutate
from tests.support.figures import Figure, Goal

EDGES: Final = (0, 1, 2, 23, 24, 255, 256, 2**32, 2**63 - 1, 2**63, 2**64 - 1)
MB: Final = 1e6
_GROUP: Final = 100
_LINK: Final = LtpLink(Address("127.0.0.1", 9))


class Wrong:
    """Makes what is wrong, by a seed."""

    def __init__(self, random: Random) -> None:
        """Make from this source of chance."""
        self._random = random
        self._sound = [encode_bundle(self.bundle()) for _ in range(50)]
        session = SessionId(1, 5)
        self._segments = [
            encode_segment(segment)
            for segment in (
                Data(session, 1, 0, self._sound[0], True, Checkpoint(3), True, True),
                Data(session, 1, 9, b"middle"),
                Report(SessionId(2, 1), 4, 5, 100, 0, (Claim(0, 50), Claim(60, 40))),
            )
        ]
        self._stream = b"".join(
            encode_message(message)
            for message in (
                ContactHeader(1, 15, "ipn:1.0"),
                DataSegment(self._sound[1], start=True, end=True),
                AckSegment(100),
            )
        )

    def bundle(self) -> Bundle:
        """Return a bundle whose fields are at the edges of what they hold."""
        random, number = self._random, self._number
        part = Part(number(), number()) if random.random() < 0.3 else None
        flags = number() & ~1 | (1 if part else 0)
        kinds = [
            random.choice((6, 7, 8, 10, 11, 193, number())) for _ in range(random.randrange(4))
        ]
        datas = [random.choice((b"\x00", b"\x82\x18\x1e\x00", random.randbytes(5))) for _ in kinds]
        blocks = [
            Block(kind, place, data, number() & 0x17)
            for place, (kind, data) in enumerate(zip(kinds, datas, strict=True), 2)
        ]
        payload = Block(1, 1, random.randbytes(random.randrange(60)), crc=random.choice(list(Crc)))
        primary = Primary(
            self._eid(), self._eid(), self._eid(), Creation(number(), number()), number(),
            flags, random.choice((Crc.CRC16, Crc.CRC32C)), part,
        )  # fmt: skip
        return Bundle(primary, (*blocks, payload))

    def octets(self) -> bytes:
        """Return what is to be taken for bundles."""
        if self._random.random() < 0.5:
            return encode_bundle(self.bundle())
        return self._spoilt(self._random.choice(self._sound))

    def segment(self) -> bytes:
        """Return what is to be taken for an LTP segment."""
        return self._spoilt(self._random.choice(self._segments))

    def stream(self) -> bytes:
        """Return what is to be taken for a TCPCL stream."""
        return self._spoilt(self._stream)

    def _spoilt(self, octets: bytes) -> bytes:
        return mutate(octets, self._random, self._splice)

    def _splice(self, octets: bytearray, at: int) -> None:
        octets[at:] = self._random.choice(self._sound)[: self._random.randrange(40)]

    def _number(self) -> int:
        if self._random.random() < 0.4:
            return self._random.choice(EDGES)
        return self._random.getrandbits(self._random.randrange(1, 64))

    def _eid(self) -> Eid:
        return self._random.choice(
            (
                Ipn(2, 1),
                Ipn(1, 0),
                Ipn(3, 1),
                Ipn(self._number(), self._number()),
                Dtn(),
                Dtn("//x/"),
            )
        )


class Victim:
    """A node with an LTP span and TCPCL sessions, which takes what comes.

    Attributes:
        refused: how many were no bundles, segments or messages.
        taken: how many bundles were sound.
        crooked: how many were taken and encode to other octets.
    """

    def __init__(self, folder: Path) -> None:
        """Begin with an empty store."""
        self.refused = self.taken = self.crooked = 0
        self._sessions_link = TcpclLink(None)
        settings = NodeSettings(Ipn(2, 1), (Ipn(2, 1),), (Neighbour(Ipn(1, 0), _LINK),))
        limits = Limits(most_octets=4 << 20)
        self.database = Database(folder / "fuzz.db", limits, Synchronous.OFF)
        self.node = Node(settings, self.database, lambda: int(1000 * time.time()), lambda _: None)
        numbers = count(1)
        self._span = LtpSpan(2, 1, _LINK, lambda: next(numbers), time.monotonic)

    def take_bundle(self, octets: bytes) -> None:
        """Take what may be a bundle, alone and as a node."""
        try:
            self.crooked += encode_bundle(decode_bundle(octets)) != octets
            self.taken += 1
        except DecodeError as error:
            self.refused += len(str(error).splitlines()) == 1
        with suppress(StoreFull):
            self.node.receiving.arrived("ipn:1.0", octets)

    def take_segment(self, octets: bytes) -> None:
        """Take what may be a segment."""
        try:
            segment = decode_segment(octets)
        except DecodeError as error:
            self.refused += len(str(error).splitlines()) == 1
            return
        self._span.receive(segment)
        for event in self._span.events:
            if isinstance(event, Arrived):
                with suppress(StoreFull):
                    self.node.receiving.arrived("ipn:1.0", event.block)
                self._span.stored(event.number)
        self._span.events.clear()
        self._span.segments.clear()

    def take_stream(self, octets: bytes) -> None:
        """Take what may be a stream."""
        session = TcpclSession(
            self.node, lambda node: self._sessions_link if node == Ipn(1, 0) else None,
            time.monotonic, lambda _: None,
        )  # fmt: skip
        session.receive(octets)
        self.refused += session.peer is None

    def settle(self) -> None:
        """Commit, and give the application and the network what there is."""
        self._span.tick()
        self.node.transaction.commit()
        while fetched := self.node.fetch():
            self.node.delivered(fetched)
        while sent := self.node.sending.outgoing("ipn:1.0", 100_000, 1 << 20):
            self.node.sending.handed_on(sent)
        self.node.tick()
        self.node.transaction.commit()


def measure(messages: int, seed: int) -> list[Figure]:
    """Return what so many wrong bundles, segments and streams, a third each, have done."""
    logging.getLogger("adapters.bundle").setLevel(logging.CRITICAL)
    random = Random(seed)
    wrong = Wrong(random)
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        victim = Victim(Path(folder))
        kinds = (
            (victim.take_bundle, wrong.octets),
            (victim.take_segment, wrong.segment),
            (victim.take_stream, wrong.stream),
        )
        warm_mb = _resident_mb()
        for place in range(messages):
            take, make = kinds[place % len(kinds)]
            octets = make()
            try:
                take(octets)
            except Exception as error:
                # Whatever it is, it is what this looks for.
                faults += 1
                logging.getLogger(__name__).error("%s raised %r", octets.hex(), error)
            if place % _GROUP == _GROUP - 1:
                victim.settle()
            if place == messages // 10:
                warm_mb = _resident_mb()
        grown_mb = _resident_mb() - warm_mb
        store_mb = victim.database.octets / MB
        victim.database.close()
    beside = f"{messages} wrong bundles, segments and streams, seed {seed}"
    return [
        Figure("fuzz: other errors than of decoding", faults, "messages", beside, Goal(0)),
        Figure("fuzz: taken, but encodes otherwise", victim.crooked, "bundles", beside, Goal(0)),
        Figure("fuzz: refused", victim.refused, "messages", beside),
        Figure("fuzz: sound all the same", victim.taken, "bundles", beside),
        Figure("fuzz: memory grown since a tenth", grown_mb, "MB", beside, Goal(5.0)),
        Figure("fuzz: content of the store", store_mb, "MB", beside, Goal(4.5)),
    ]


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / MB
