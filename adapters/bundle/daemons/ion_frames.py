"""Frames between the agent and its bridge to ION: CBOR items, each preceded by its length."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any, Final, get_args

from adapters.bundle.codec import cbor

_LENGTH_OCTETS: Final = 4


@dataclass(frozen=True, slots=True)
class SendRequest:
    """To the bridge: give this to ION; answered by `Sent` or `SendRejected` with its number."""

    number: int
    destination: str
    lifetime_s: int
    payload: bytes
    expedited: bool = False


@dataclass(frozen=True, slots=True)
class ReceivedAck:
    """To the bridge: the `Received` unit is on the disk, or must be offered again later."""

    stored: bool


@dataclass(frozen=True, slots=True)
class Ping:
    """To the bridge: requests a `Pong`."""


@dataclass(frozen=True, slots=True)
class Ready:
    """From the bridge: the endpoint is open."""


@dataclass(frozen=True, slots=True)
class Sent:
    """From the bridge: ION has accepted the payload."""

    number: int


@dataclass(frozen=True, slots=True)
class SendRejected:
    """From the bridge: ION has rejected the payload."""

    number: int
    reason: str


@dataclass(frozen=True, slots=True)
class Received:
    """From the bridge: application data; the next follows after a `ReceivedAck`."""

    source: str
    time_ms: int
    sequence: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Pong:
    """From the bridge: it is alive; `ion_answers` is the state of ION."""

    ion_answers: bool


@dataclass(frozen=True, slots=True)
class Failed:
    """From the bridge: it ends, with the reason.

    Attributes:
        lasting: whether a restart of the bridge would fail for the same reason.
    """

    why: str
    lasting: bool


Frame = SendRequest | ReceivedAck | Ping | Ready | Sent | SendRejected | Received | Pong | Failed
_KINDS: Final[tuple[type[Frame], ...]] = get_args(Frame)
_READ: Final[dict[object, Callable[[cbor.Reader], Any]]] = {
    bool: cbor.Reader.boolean,
    int: cbor.Reader.unsigned,
    str: cbor.Reader.text,
    bytes: cbor.Reader.octet_string,
}


def encode_frame(frame: Frame) -> bytes:
    """Return a frame in the form sent over the socket."""
    kind = type(frame)
    values = [getattr(frame, field.name) for field in fields(kind)]
    body = cbor.unsigned(_KINDS.index(kind)) + b"".join(map(_encode, values))
    return len(body).to_bytes(_LENGTH_OCTETS, "big") + body


def decode_frame(body: bytes) -> Frame:
    """Decode the frame that follows a length.

    Raises:
        DecodeError: the octets are not a frame.
    """
    reader = cbor.Reader(body)
    number = reader.unsigned()
    if number >= len(_KINDS):
        raise reader.fail(f"unknown frame kind {number}")
    kind = _KINDS[number]
    frame: Frame = kind(*[_READ[field.type](reader) for field in fields(kind)])
    reader.finish()
    return frame


class FrameReader:
    """Splits a stream into frames."""

    def __init__(self) -> None:
        self._octets = b""

    def feed(self, octets: bytes) -> Iterator[Frame]:
        """Yield the frames that are complete with these octets.

        Raises:
            DecodeError: the octets are not frames.
        """
        self._octets += octets
        while len(self._octets) >= _LENGTH_OCTETS:
            end = _LENGTH_OCTETS + int.from_bytes(self._octets[:_LENGTH_OCTETS], "big")
            if len(self._octets) < end:
                return
            body, self._octets = self._octets[_LENGTH_OCTETS:end], self._octets[end:]
            yield decode_frame(body)


def _encode(value: bool | int | str | bytes) -> bytes:
    match value:
        case bool():
            return cbor.TRUE if value else cbor.FALSE
        case int():
            return cbor.unsigned(value)
        case str():
            return cbor.text(value)
        case bytes():
            return cbor.octet_string(value)
