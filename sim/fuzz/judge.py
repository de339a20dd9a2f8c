"""What a provider owes for the octets of a connection, and whether it gave it.

The judge cuts the stream by itself, by the eight fields of the header that stand at fixed places;
with the strict decoder it looks only at what was answered as if it were sound.
"""

from collections import Counter
from collections.abc import Callable
from enum import Enum
from typing import Any, Final

from adapters.mal.codec import Codec
from adapters.mal.errors import DecodeError, MalError, StandardError
from adapters.mal.message import SHORTEST, decode_message
from adapters.mal.specification import REPLY, Operation, Specification, Stage
from adapters.mrs.offer import MESSAGE_CAP

_FIRST_REPLY: Final = {stage.value: reply.value for stage, reply in REPLY.items()}
_LAST_REPLY: Final = {
    Stage.INVOKE_ACK.value: Stage.INVOKE_RESPONSE.value,
    Stage.PROGRESS_ACK.value: Stage.PROGRESS_RESPONSE.value,
}
_SEND, _PUBLISH, _NOTIFY = Stage.SEND.value, Stage.PUBLISH.value, Stage.NOTIFY.value
_UPDATE: Final = Stage.PROGRESS_UPDATE.value


class Outcome(Enum):
    """What became of a message; the second group must not be."""

    ERROR = "answered by an error"
    TAKEN = "sound all the same, and answered"
    CLOSED = "ended its connection"
    NOT_OWED = "no answer is owed: SEND, PUBLISH, or cut short"

    LOST = "no answer, and the connection is open"
    UNFOUNDED = "connection ended without a reason"
    UNEARNED = "taken, though it is not what the specification says"
    INTERNAL = "answered by INTERNAL"
    STRAY = "an answer to nothing, or none of its kind"


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
        """Begin with nothing sent."""
        self._specification = specification
        self._codec = codec
        self._taken = taken
        self._octets = bytearray()
        self._owed: dict[tuple[int, int], list[bytes]] = {}
        self._published: Counter[int] = Counter()
        self.outcomes = outcomes
        self.ended = False
        self.partial = False

    @property
    def waits(self) -> bool:
        """Whether the provider owes something: an answer, or to hang up."""
        return self.ended or bool(self._owed)

    def sent(self, octets: bytes) -> None:
        """Note what was sent; nothing counts after what must end the connection."""
        waiting, at = self._octets, 0
        waiting += octets
        while not self.ended and len(waiting) - at >= 4:
            length = int.from_bytes(waiting[at : at + 4], "big")
            if not SHORTEST <= length <= MESSAGE_CAP:
                self.ended = True
            elif len(waiting) - at < length:
                break
            else:
                self._one(bytes(waiting[at : at + length]))
                at += length
        del waiting[:at]
        self.partial = bool(waiting)

    def came(self, message: bytes) -> None:
        """Take a message of the provider."""
        stage, number = message[4] & 0x1F, int.from_bytes(message[13:21], "big", signed=True)
        if stage in (_NOTIFY, _UPDATE):
            return
        is_error = message[12] & 0x80
        asked = self._owed.get((stage, number))
        if asked is None:
            if stage == _PUBLISH and is_error and self._published[number]:
                self._published[number] -= 1
            else:
                self.outcomes[Outcome.STRAY] += 1
            return
        request = self._answered(asked, bool(is_error))
        if not asked:
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

    def _answered(self, asked: list[bytes], is_error: bool) -> bytes:
        """Take out the message that was answered; of several with one number, the likeliest."""
        likely = asked[0]
        if len(asked) > 1:
            sound = [message for message in asked if self._is_sound(message)]
            likely = sound[0] if sound and not is_error else likely
        asked.remove(likely)
        return likely

    def hung_up(self) -> None:
        """Take note that the provider closed the connection."""
        left = [message for messages in self._owed.values() for message in messages]
        founded = self.ended or not all(_has_header(message) for message in left)
        outcome = Outcome.CLOSED if founded else Outcome.UNFOUNDED
        self.outcomes[outcome] += len(left) + self.ended
        self._forget(left)

    def gave_up(self) -> None:
        """Take note that what is owed did not come in a long time."""
        left = [message for messages in self._owed.values() for message in messages]
        self.outcomes[Outcome.LOST] += len(left) + self.ended
        self._forget(left)

    def over(self) -> None:
        """Take note that we hang up; a message that was cut short is owed nothing."""
        self.outcomes[Outcome.NOT_OWED] += self.partial

    def _forget(self, left: list[bytes]) -> None:
        """Owe nothing any more; what is sound may have been carried out all the same."""
        for message in left:
            self._is_sound(message)
        self._owed.clear()
        self.ended = self.partial = False

    def _one(self, message: bytes) -> None:
        kind, bits, flags, encoding = message[4], message[12], message[21], message[22]
        stage, number = kind & 0x1F, int.from_bytes(message[13:21], "big", signed=True)
        asks = stage in _FIRST_REPLY or stage == _SEND
        is_request = kind >> 5 == 1 and asks and not (flags & 0x2E or encoding or bits & 0x80)
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
        if len(self._codec.encode(fields, values)) != len(body):
            return False
        self._taken(operation, values)
        return True


def _has_header(message: bytes) -> bool:
    try:
        decode_message(message)
    except DecodeError:
        return False
    return True
