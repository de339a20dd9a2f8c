"""Sends messages over connections that overlap, and judges what comes back.

The judge knows what a provider owes for the octets of a connection. It cuts the stream by itself,
by the eight fields of the header that stand at fixed places; with the strict decoder it looks only
at what was answered as if it were sound.
"""

import socket
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from enum import Enum
from random import Random
from typing import Any, Final

from adapters.mal import (
    Codec,
    DecodeError,
    InteractionStage,
    MalError,
    Operation,
    Specification,
    StandardError,
)
from adapters.mal.codec import MIN_MESSAGE_OCTETS, decode_message
from adapters.mal.connection import MESSAGE_CAP as SKIPPED_CAP
from adapters.mal.specification import REPLY
from adapters.mrs.aboard.served_operations import MESSAGE_CAP
from tests.stress.fuzzing import fragments
from tests.stress.mal_messages import Messages

_FIRST_REPLY: Final = {stage.value: reply.value for stage, reply in REPLY.items()}
_LAST_REPLY: Final = {
    InteractionStage.INVOKE_ACK.value: InteractionStage.INVOKE_RESPONSE.value,
    InteractionStage.PROGRESS_ACK.value: InteractionStage.PROGRESS_RESPONSE.value,
}
_SEND, _PUBLISH, _NOTIFY = (
    InteractionStage.SEND.value,
    InteractionStage.PUBLISH.value,
    InteractionStage.NOTIFY.value,
)
_UPDATE: Final = InteractionStage.PROGRESS_UPDATE.value


class Outcome(Enum):
    """What became of a message; the second group must not be."""

    ERROR = "answered by an error"
    TAKEN = "sound all the same, and answered"
    CLOSED = "ended its connection"
    NOT_OWED = "no answer is owed: SEND, PUBLISH, or cut short"

    LOST = "left without an answer"
    UNFOUNDED = "hung up on without a reason"
    UNEARNED = "taken though not sound"
    INTERNAL = "answered by INTERNAL"
    STRAY = "answers to nothing"


class Judge:
    """Judges one connection.

    Args:
        codec: of the encoding agreed on.
        taken: called with the operation and the parts of each message that was, or may have been,
            carried out.
        outcomes: where it counts what became of each message.
    """

    def __init__(
        self,
        specification: Specification,
        codec: Codec,
        taken: Callable[[Operation, tuple[Any, ...]], None],
        outcomes: Counter[Outcome],
    ) -> None:
        self._specification = specification
        self._codec = codec
        self._taken = taken
        self._octets = bytearray()
        self._owed: dict[tuple[int, int], list[bytes]] = {}
        self._published: Counter[int] = Counter()
        self.outcomes = outcomes
        self.ended = False
        self.skips = False
        self.partial = False

    @property
    def waits(self) -> bool:
        """Whether the provider owes something: an answer, or to hang up."""
        return self.ended or bool(self._owed)

    def sent(self, octets: bytes) -> None:
        """Note what was sent; nothing counts after what must end the connection."""
        waiting, at = self._octets, 0
        waiting += octets
        while not (self.ended or self.skips) and len(waiting) - at >= 4:
            length = int.from_bytes(waiting[at : at + 4], "big")
            if MESSAGE_CAP < length <= SKIPPED_CAP:
                self.skips = True  # all that follows belongs to it
                break
            if not MIN_MESSAGE_OCTETS <= length <= MESSAGE_CAP:
                self.ended = True
            elif len(waiting) - at < length:
                break
            else:
                self._one(bytes(waiting[at : at + length]))
                at += length
        del waiting[:at]
        self.partial = bool(waiting) or self.skips

    def arrived(self, message: bytes) -> None:
        """Take a message of the provider."""
        stage, number = message[4] & 0x1F, int.from_bytes(message[13:21], "big", signed=True)
        if stage in (_NOTIFY, _UPDATE):
            return
        is_error = message[12] & 0x80
        requested = self._owed.get((stage, number))
        if requested is None:
            if is_error and self.skips:
                return
            if stage == _PUBLISH and is_error and self._published[number]:
                self._published[number] -= 1
            else:
                self.outcomes[Outcome.STRAY] += 1
            return
        request = self._answered(requested, bool(is_error))
        if not requested:
            del self._owed[stage, number]
        if is_error:
            self._error(message)
        elif stage in _LAST_REPLY.values():
            pass
        elif not self._is_sound(request):
            self.outcomes[Outcome.UNEARNED] += 1
        else:
            self.outcomes[Outcome.TAKEN] += 1
            if stage in _LAST_REPLY:
                self._owed.setdefault((_LAST_REPLY[stage], number), []).append(request)

    def _answered(self, requested: list[bytes], is_error: bool) -> bytes:
        """Take out the message that was answered; of several with one number, the likeliest."""
        likely = requested[0]
        if len(requested) > 1:
            fitting = [each for each in requested if self._is_sound(each) is not is_error]
            likely = fitting[0] if fitting else likely
        requested.remove(likely)
        return likely

    def hung_up(self) -> None:
        founded = self.ended or self.skips or not all(map(_has_header, self._unanswered))
        self._forget(Outcome.CLOSED if founded else Outcome.UNFOUNDED)

    def on_aborted(self) -> None:
        self._forget(Outcome.LOST)

    def over(self) -> None:
        """Take note that we hang up; a message that was cut short is owed nothing."""
        self.outcomes[Outcome.NOT_OWED] += self.partial

    @property
    def _unanswered(self) -> list[bytes]:
        return [message for messages in self._owed.values() for message in messages]

    def _forget(self, outcome: Outcome) -> None:
        """Owe nothing any more; what is sound may have been carried out all the same."""
        left = self._unanswered
        self.outcomes[outcome] += len(left) + self.ended
        for message in left:
            self._is_sound(message)
        self._owed.clear()
        self.ended = self.partial = False

    def _one(self, message: bytes) -> None:
        kind, bits, flags, encoding = message[4], message[12], message[21], message[22]
        stage, number = kind & 0x1F, int.from_bytes(message[13:21], "big", signed=True)
        requests = stage in _FIRST_REPLY or stage == _SEND
        is_request = kind >> 5 == 1 and requests and not (flags & 0x2E or encoding or bits & 0x80)
        answered_anyway = stage not in (_SEND, _PUBLISH)
        if not is_request or not (answered_anyway or _has_header(message)):
            self.ended = True
        elif stage == _SEND:
            self.outcomes[Outcome.NOT_OWED] += 1
        elif stage == _PUBLISH:
            self._published[number] += 1
            self.outcomes[Outcome.NOT_OWED] += 1
        else:
            self._owed.setdefault((_FIRST_REPLY[stage], number), []).append(message)

    def _error(self, message: bytes) -> None:
        try:
            _, body = decode_message(message)
            error = self._codec.decode_error(body)
        except DecodeError:
            self.outcomes[Outcome.STRAY] += 1
            return
        internal = error.number == StandardError.INTERNAL.value
        self.outcomes[Outcome.INTERNAL if internal else Outcome.ERROR] += 1

    def _is_sound(self, message: bytes) -> bool:
        """Whether a message says one thing, and says it in the one way there is."""
        try:
            header, body = decode_message(message)
            operation = self._specification.resolve(
                header.area, header.area_version, header.service, header.operation
            )
            fields = operation.parts[header.stage]
            values = self._codec.decode(fields, body)
        except (DecodeError, MalError, KeyError):
            return False
        spare = len(body) - len(self._codec.encode(fields, values))
        if spare and not _has_zero_bits(body, spare):
            return False
        self._taken(operation, values)
        return True


def _has_zero_bits(body: bytes, octets: int) -> bool:
    """Whether so many octets at the end of a bit field, in front, hold false bits alone.

    Writers of split encoding drop them; readers take them, for the bits are there.
    """
    end = 1 + body[0]
    return 0 < octets < end <= len(body) and not any(body[end - octets : end])


def _has_header(message: bytes) -> bool:
    try:
        decode_message(message)
    except DecodeError:
        return False
    return True


PATIENCE_S: Final = 15.0
"""How long an answer may take: the provider itself waits 5 s for its core."""
MAX_BATCH: Final = 120
MAX_CONNECTION_MESSAGES: Final = 600
"""Messages over one connection, about, before we hang up."""
GOOD_EVERY: Final = 40
"""Batches from one good client to the next."""
STORM, VALID, FRAGMENTED = 0.04, 0.02, 0.1
"""How many batches are storms of registrations, are sound, and arrive in odd pieces."""
SIZES: Final = (1, 2, 7, 100, 3000)

Taken = Callable[[Operation, tuple[Any, ...]], None]


def cut(octets: bytearray) -> Iterator[bytes]:
    """Take the whole messages from the front of what has come, and give them."""
    while len(octets) >= 4 and len(octets) >= (length := int.from_bytes(octets[:4], "big")):
        yield bytes(octets[:length])
        del octets[:length]


class Wire:
    """One connection, with its judge."""

    def __init__(self, port: int, judge: Judge) -> None:
        self.judge = judge
        self.sent = 0
        self._octets = bytearray()
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.is_open = True

    def send(self, pieces: list[bytes]) -> None:
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
                self.judge.on_aborted()
                self.close()
            except ConnectionError:
                self._lost()
            else:
                self._octets += octets
                for message in cut(self._octets):
                    self.judge.arrived(message)
                if not octets:
                    self._lost()

    def close(self) -> None:
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
        for _ in range(random.randrange(1, MAX_BATCH)):
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
        broken_up = random.random() < FRAGMENTED
        wire.send(fragments(octets, random, SIZES) if broken_up else [octets])

    def _kind(self) -> Callable[[], bytes]:
        chance = self._random.random()
        if chance < STORM:
            return self._messages.storming
        return self._messages.valid if chance < STORM + VALID else self._messages.mutated

    def _finish(self, wire: Wire) -> None:
        wire.collect()
        if wire.judge.partial or wire.sent > MAX_CONNECTION_MESSAGES:
            wire.close()
        if not wire.is_open:
            self._wires.remove(wire)

    def _is_served(self) -> bool:
        """Whether a client that does everything right gets its answer."""
        octets = self._messages.status_request()
        operation = self._specification.operation("Status", "getStatus")
        with (
            suppress(OSError, DecodeError),
            socket.create_connection(("127.0.0.1", self._port), timeout=PATIENCE_S) as connection,
        ):
            connection.sendall(octets)
            arrived = bytearray()
            while piece := connection.recv(1 << 16):
                arrived += piece
                for message in cut(arrived):
                    header, body = decode_message(message)
                    self._codec.decode(operation.parts[InteractionStage.REQUEST_RESPONSE], body)
                    return not header.is_error
        return False
