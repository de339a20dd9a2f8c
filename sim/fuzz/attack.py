"""Sends messages over connections that overlap, and has a judge look at what comes back."""

import socket
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from random import Random
from typing import Any, Final

from adapters.mal.codec import Codec
from adapters.mal.errors import DecodeError
from adapters.mal.message import decode_message
from adapters.mal.specification import Operation, Specification, Stage
from sim.fuzz.judge import Judge, Outcome
from sim.fuzz.messages import Messages

PATIENCE_S: Final = 15.0
"""How long an answer may take: the provider itself waits 5 s for its core."""
LONGEST_BATCH: Final = 120
LONGEST_LIFE: Final = 600
"""Messages over one connection, about, before we hang up."""
GOOD_EVERY: Final = 40
"""Batches from one good client to the next."""
STORM, CALM, CRUMBS = 0.04, 0.02, 0.1
"""How many batches are storms of registrations, are sound, and arrive in odd pieces."""

Taken = Callable[[Operation, tuple[Any, ...]], None]


def cut(octets: bytearray) -> Iterator[bytes]:
    """Take the whole messages from the front of what has come, and give them."""
    while len(octets) >= 4 and len(octets) >= (length := int.from_bytes(octets[:4], "big")):
        yield bytes(octets[:length])
        del octets[:length]


class Wire:
    """One connection, with its judge."""

    def __init__(self, port: int, judge: Judge) -> None:
        """Connect."""
        self.judge = judge
        self.sent = 0
        self._octets = bytearray()
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.is_open = True

    def send(self, pieces: list[bytes]) -> None:
        """Send octets, piece by piece."""
        try:
            for piece in pieces:
                self._socket.sendall(piece)
        except ConnectionError:
            self._lost()

    def collect(self) -> None:
        """Read until everything that is owed has come, or nothing comes any more."""
        while self.is_open and self.judge.waits:
            try:
                octets = self._socket.recv(1 << 18)
            except TimeoutError:
                self.judge.gave_up()
                self.close()
            except ConnectionError:
                self._lost()
            else:
                self._octets += octets
                for message in cut(self._octets):
                    self.judge.came(message)
                if not octets:
                    self._lost()

    def close(self) -> None:
        """Hang up."""
        if self.is_open:
            self.judge.over()
            self._socket.close()
            self.is_open = False

    def _lost(self) -> None:
        self.judge.hung_up()
        self._socket.close()
        self.is_open = False


class Attack:
    """Attacks one provider.

    Args:
        taken: called with the operation and the parts of what was, or may have been, carried out.

    Attributes:
        outcomes: what became of the messages so far, the sound ones among them.
        mutated: how many had something done to them.
        unserved: good clients that were not answered.
    """

    def __init__(
        self,
        specification: Specification,
        codec: Codec,
        messages: Messages,
        random: Random,
        port: int,
        taken: Taken,
    ) -> None:
        """Prepare; nothing is sent yet."""
        self._specification, self._codec = specification, codec
        self._messages = messages
        self._random = random
        self._port = port
        self._taken = taken
        self._wires: list[Wire] = []
        self._batches = 0
        self.outcomes: Counter[Outcome] = Counter()
        self.mutated = 0
        self.unserved = 0

    def send(self, count: int) -> None:
        """Send this many mutated messages more, and sound ones in between.

        Raises:
            ConnectionError: nobody listens.
        """
        wanted = self.mutated + count
        try:
            while self.mutated < wanted:
                self._next()
            for wire in self._wires[:]:
                self._finish(wire)
        finally:
            for wire in self._wires:
                wire.close()
            self._wires.clear()
        self.unserved += not self._is_served()

    def _next(self) -> None:
        """Send a batch over one connection, and take what the batch before it got on the other."""
        if len(self._wires) < 2:
            self._wires.append(self._wire())
        fresh, waiting = self._wires[-1], self._wires[0]
        self._batch(fresh)
        if waiting is not fresh:
            self._finish(waiting)
            self._wires.reverse()
        if self._batches % GOOD_EVERY == 0:
            self.unserved += not self._is_served()

    def _wire(self) -> Wire:
        return Wire(self._port, Judge(self._specification, self._codec, self._taken, self.outcomes))

    def _batch(self, wire: Wire) -> None:
        random, judge = self._random, wire.judge
        make = self._kind()
        batch = []
        for _ in range(random.randrange(1, LONGEST_BATCH)):
            message = make()
            was_partial = judge.partial
            judge.sent(message)
            batch.append(message)
            if (
                judge.ended
                or (judge.partial and was_partial)
                or random.random() < 0.5 * judge.partial
            ):
                break
        self._batches += 1
        self.mutated += len(batch) if make == self._messages.mutated else 0
        wire.sent += len(batch)
        octets = b"".join(batch)
        if random.random() < CRUMBS:
            wire.send(self._crumbs(octets))
        else:
            wire.send([octets])

    def _kind(self) -> Callable[[], bytes]:
        chance = self._random.random()
        if chance < STORM:
            return self._messages.storming
        return self._messages.calm if chance < STORM + CALM else self._messages.mutated

    def _crumbs(self, octets: bytes) -> list[bytes]:
        pieces, at = [], 0
        while at < len(octets):
            size = self._random.choice((1, 2, 7, 100, 3000))
            pieces.append(octets[at : at + size])
            at += size
        return pieces

    def _finish(self, wire: Wire) -> None:
        wire.collect()
        if wire.judge.partial or wire.sent > LONGEST_LIFE:
            wire.close()
        if not wire.is_open:
            self._wires.remove(wire)

    def _is_served(self) -> bool:
        """Whether a client that does everything right gets its answer."""
        octets = self._messages.sound("Status", "getStatus", Stage.REQUEST)
        operation = self._specification.operation("Status", "getStatus")
        with (
            suppress(OSError, DecodeError),
            socket.create_connection(("127.0.0.1", self._port), timeout=PATIENCE_S) as connection,
        ):
            connection.sendall(octets)
            came = bytearray()
            while piece := connection.recv(1 << 16):
                came += piece
                for message in cut(came):
                    header, body = decode_message(message)
                    self._codec.decode(operation.parts[Stage.REQUEST_RESPONSE], body)
                    return not header.is_error
        return False
