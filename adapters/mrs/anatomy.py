"""One whole message taken apart octet by octet, for the interface page."""

from collections.abc import Iterator
from typing import Final

from adapters.mal import Codec, Header, Stage, encode_message
from adapters.mrs.examples import COMMAND_HEADER, TIME_NS
from adapters.mrs.specification import mrs_specification

CLIENT: Final = "maltcp://127.0.0.1:50000/MOE"
PROVIDER: Final = "maltcp://127.0.0.1:41000/MRS"

_FIELDS: Final = (
    (4, "length of the message, these four octets included"),
    (1, "version 1 (3 bits), SDU type 1: SUBMIT (5 bits)"),
    (2, "area 3001, MRS"),
    (2, "service 8, MotionControl"),
    (2, "operation 7, stop"),
    (1, "version of the area"),
    (1, "is-error (1 bit), 1 (3 bits), 1 (4 bits); 0x91 in an error"),
    (8, "transaction id: the client's choice, returned in the answer"),
    (1, "fields that follow: 0x80 From, 0x40 To, 0x10 timestamp"),
    (1, "encoding id, always 0"),
    (4, "number of supplements"),
    (4 + len(CLIENT), f"From: length, {CLIENT}"),
    (4 + len(PROVIDER), f"To: length, {PROVIDER}"),
    (6, "timestamp: days since 1958-01-01 (2), milliseconds of the day (4)"),
    (8, "body begins: command.commandId, Long"),
    (7, "source: length, MOE"),
    (1, "counter is NULL"),
    (9, "lifetime is there: 60 s, a double"),
    (7, "creationTime is there: days and milliseconds as above"),
    (1, "reportStarted"),
    (1, "reportProgress"),
)


def message() -> bytes:
    """Return a SUBMIT of MotionControl.stop, in fixed encoding."""
    operation = mrs_specification().operation("MotionControl", "stop")
    header = Header.of(operation, Stage.SUBMIT, 1, CLIENT, PROVIDER, TIME_NS)
    codec = Codec(mrs_specification())
    return encode_message(header, codec.encode(operation.parts[Stage.SUBMIT], (COMMAND_HEADER,)))


def anatomy() -> Iterator[tuple[int, str, str]]:
    """Yield offset, octets and meaning of each field of the message, in order."""
    octets, at = message(), 0
    for length, meaning in _FIELDS:
        yield at, octets[at : at + length].hex(), meaning
        at += length
