"""Wrong bundles, LTP segments and TCPCL streams against one node: each is refused, no more.

Half of the bundles are octets that were changed, cut or mixed; half are bundles whose check sums
are right and whose fields are at the edges of what they hold, and in no relation to each other.
"""

import logging
import tempfile
import time
from contextlib import suppress
from dataclasses import replace
from enum import Enum, unique
from itertools import count
from pathlib import Path
from random import Random
from typing import Final

from hypothesis import strategies as st

from adapters.bundle import (
    DTN_EPOCH_UTC_MS,
    Address,
    Eid,
    Ipn,
    LtpLink,
    Neighbour,
    NodeSettings,
    StoreFull,
)
from adapters.bundle.codec.bundle import Block, Bundle, decode_bundle, encode_bundle
from adapters.bundle.codec.eid import Dtn
from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.codec.integrity import Key, sign, verify
from adapters.bundle.links.link import LinkContext
from adapters.bundle.links.ltp_engine import BlockReceived, LtpSpan
from adapters.bundle.links.ltp_segment import decode_segment, encode_segment
from adapters.bundle.links.tcpcl import TcpclNeighbour, TcpclSession
from adapters.bundle.links.tcpcl_messages import encode_message
from adapters.bundle.node.database import BundleDatabase, StoreLimits
from adapters.bundle.node.node import BundleNode
from adapters.bundle.node.settings import TcpclLink
from tests.bundle.strategies import CONTACT_HEADERS, MESSAGES, NUMBERS, SEGMENTS, bundles
from tests.stress.findings import MB, Findings, Log
from tests.stress.fuzzing import attack, examples, mutate
from tests.support.figures import Figure, Goal
from tests.support.unsynced import UNSYNCED

POOL: Final = 120
"""Sound ones of each kind, of which the wrong ones are made."""
MAX_GROWTH_MB: Final = 5.0
_KEY: Final = Key(bytes(32))
_LIFETIME_MS: Final = 3_600_000
_IN_TIME: Final = 0.8
"""How many of those that are no octets at random are neither late nor early."""
_LINK: Final = LtpLink(Address("127.0.0.1", 9))
_NEAR: Final[st.SearchStrategy[Eid]] = st.sampled_from(
    [Ipn(2, 1), Ipn(1, 0), Ipn(3, 1), Dtn(), Dtn("//x/")]
)
_EDGES: Final = NUMBERS | st.sampled_from([0, 1, 2, 23, 24, 255, 256, 2**32, 2**63 - 1, 2**63])
_KINDS: Final = st.sampled_from([6, 7, 8, 10, 11, 193]) | _EDGES
_DATA: Final = st.sampled_from([b"\x00", b"\x82\x18\x1e\x00"]) | st.binary(max_size=5)


@st.composite
def odd_bundles(draw: st.DrawFn) -> Bundle:
    """Bundles for, from and near the node, with fields that may make no sense."""
    bundle = draw(bundles())
    flags = draw(_EDGES) & ~1 | (bundle.primary.part is not None)
    primary = replace(
        bundle.primary, destination=draw(_NEAR), source=draw(_NEAR), flags=flags,
    )  # fmt: skip
    kinds = draw(st.lists(st.tuples(_KINDS, _DATA, _EDGES), max_size=3))
    blocks = [
        Block(kind, number, data, flags & 0x17)
        for number, (kind, data, flags) in enumerate(kinds, 2)
    ]
    odd = Bundle(primary, (*blocks, bundle.blocks[-1]))
    return sign(odd, _KEY, Ipn(1, 0), (0, 1)) if draw(st.booleans()) else odd


@unique
class Fault(Enum):
    """What must not become of anything."""

    RAISED = "other errors than of decoding"
    CHANGED = "taken, but encodes otherwise"


class Wrong:
    """Makes what is wrong, by a seed."""

    def __init__(self, seed: int) -> None:
        self._random = random = Random(seed)
        self._odd, self._number = examples(odd_bundles(), POOL, seed), 0
        self._bundles = list(map(encode_bundle, self._odd))
        self._segments = [encode_segment(each) for each in examples(SEGMENTS, POOL, seed)]
        header, *messages = (
            encode_message(each)
            for each in (*examples(CONTACT_HEADERS, 1, seed), *examples(MESSAGES, POOL, seed))
        )
        self._streams = [header + b"".join(random.choices(messages, k=3)) for _ in range(POOL)]

    def bundle(self) -> bytes:
        if self._random.random() < 0.5:
            return self._mutated(self._random.choice(self._bundles))
        # Another one each time, for a node takes none twice.
        bundle, self._number = self._random.choice(self._odd), self._number + 1
        primary = bundle.primary
        creation, lifetime_ms = replace(primary.creation, sequence=self._number), _LIFETIME_MS
        if self._random.random() < _IN_TIME:
            now_ms = int(1000 * time.time()) - DTN_EPOCH_UTC_MS
            creation = replace(creation, time_ms=now_ms)
        else:
            lifetime_ms = primary.lifetime_ms
        primary = replace(primary, creation=creation, lifetime_ms=lifetime_ms)
        return encode_bundle(replace(bundle, primary=primary))

    def segment(self) -> bytes:
        return self._mutated(self._random.choice(self._segments))

    def stream(self) -> bytes:
        return self._mutated(self._random.choice(self._streams))

    def _mutated(self, octets: bytes) -> bytes:
        return mutate(octets, self._random, self._bundles)


class Target:
    """A node with an LTP span and TCPCL sessions, which takes what comes.

    Attributes:
        refused: how many were no bundles, segments or messages.
        taken: how many bundles were sound.
    """

    def __init__(self, folder: Path, findings: Findings) -> None:
        self.refused = self.taken = 0
        self._findings = findings
        settings = NodeSettings(Ipn(2, 1), (Ipn(2, 1),), (Neighbour(Ipn(1, 0), _LINK),))
        limits = StoreLimits(max_octets=4 << 20)
        self.database = BundleDatabase(folder / "fuzz.db", limits, UNSYNCED)
        self.node = BundleNode(
            settings, self.database, lambda: int(1000 * time.time()), lambda _: None
        )
        numbers = count(1)
        self._span = LtpSpan(2, 1, _LINK, lambda: next(numbers), time.monotonic, lambda: 1)

    def take_bundle(self, octets: bytes) -> None:
        """Take what may be a bundle, alone and as a node."""
        try:
            bundle = decode_bundle(octets)
            if encode_bundle(bundle) != octets:
                self._findings.add(Fault.CHANGED, octets)
            self.taken += 1
            verify(octets, bundle, _KEY, lenient=True)
        except DecodeError as error:
            self.refused += len(str(error).splitlines()) == 1
        with suppress(StoreFull):
            self.node.receiving.receive("ipn:1.0", octets)

    def take_segment(self, octets: bytes) -> None:
        try:
            segment = decode_segment(octets)
        except DecodeError as error:
            self.refused += len(str(error).splitlines()) == 1
            return
        self._span.receive(segment)
        for event in self._span.events:
            if isinstance(event, BlockReceived):
                with suppress(StoreFull):
                    self.node.receiving.receive("ipn:1.0", event.block)
                self._span.mark_stored(event.number)
        self._span.events.clear()
        self._span.segments.clear()

    def take_stream(self, octets: bytes) -> None:
        context = LinkContext(self.node, time.monotonic, lambda: None)
        link = TcpclNeighbour(context, Neighbour(Ipn(1, 0), TcpclLink(None)), {})
        session = TcpclSession(context, {Ipn(1, 0): link})
        session.data_received(octets)
        self.refused += not session.established

    def settle(self) -> None:
        """Commit, and give the application and the network what there is."""
        self._span.tick()
        self.node.transaction.commit()
        while fetched := self.node.fetch():
            self.node.mark_delivered(fetched)
        for expedited in (True, False):
            while sent := self.node.sending.outgoing(
                "ipn:1.0", 100_000, 1 << 20, expedited=expedited
            ):
                self.node.sending.mark_forwarded(sent)
        self.node.tick()
        self.node.transaction.commit()


def measure(messages: int, seed: int, log: Log) -> list[Figure]:
    logging.getLogger("adapters.bundle").setLevel(logging.CRITICAL)
    wrong, findings = Wrong(seed), Findings(log)
    with tempfile.TemporaryDirectory() as folder:
        target = Target(Path(folder), findings)
        takers = (
            (wrong.bundle, target.take_bundle),
            (wrong.segment, target.take_segment),
            (wrong.stream, target.take_stream),
        )
        _, grown_mb = attack(takers, messages, findings, Fault.RAISED, target.settle)
        store_mb = target.database.octets / MB
        target.database.close()
    beside = f"{messages} wrong bundles, segments and streams, seed {seed}"
    return [
        *findings.figures("bundles", Fault, beside),
        Figure("bundles: refused", target.refused, "messages", beside),
        Figure("bundles: sound all the same", target.taken, "bundles", beside),
        Figure("bundles: memory gained", grown_mb, "MB", "since 30% of it", Goal(MAX_GROWTH_MB)),
        Figure("bundles: content of the store", store_mb, "MB", beside, Goal(4.5)),
    ]
