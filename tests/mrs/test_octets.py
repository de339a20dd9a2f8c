"""Octets that no sound client sends: one clear error, and the rover does not move."""

import socket
import struct
from contextlib import suppress
from dataclasses import replace

import pytest

from adapters.mal import Codec, Header, InteractionStage, encode_message
from adapters.mal.codec import decode_message
from adapters.mrs.aboard import served_operations
from adapters.mrs.spec import mrs_specification
from tests.mrs.aboard import ANSWER_S, HEADER, Aboard

DRIVE = mrs_specification().operation("MotionControl", "drive")
BODY = Codec(mrs_specification()).encode(
    DRIVE.parts[InteractionStage.SUBMIT], (HEADER, 0.5, 0.0, 5.0)
)
BAD_ENCODING = 65549


def address(aboard: Aboard) -> tuple[str, int]:
    host, port = aboard.uri.removeprefix("maltcp://").removesuffix("/MRS").split(":")
    return host, int(port)


def message(aboard: Aboard, body: bytes) -> bytes:
    header = Header.of(
        DRIVE, InteractionStage.SUBMIT, 7, from_uri="maltcp://127.0.0.1:1/test", to_uri=aboard.uri
    )
    return encode_message(header, body)


def received(connection: socket.socket) -> bytes:
    """Return one whole message, or nothing if the other end hung up."""
    octets = b""
    while len(octets) < 4 or len(octets) < struct.unpack(">I", octets[:4])[0]:
        more = connection.recv(65536)
        if not more:
            return b""
        octets += more
    return octets


def answer(aboard: Aboard, octets: bytes) -> tuple[bool, int]:
    """Send a message and return whether the answer is an error, and its number."""
    with socket.create_connection(address(aboard), timeout=ANSWER_S) as connection:
        connection.sendall(octets)
        header, body = decode_message(received(connection))
    return header.is_error, struct.unpack(">I", body[:4])[0] if body else 0


def moved(aboard: Aboard) -> bool:
    aboard.run(3.0)
    return aboard.do(lambda bench: bench.rover.pose.x_m != 0.0 or bench.stages(1) != [])


def test_a_whole_drive_moves_the_rover(aboard: Aboard) -> None:
    assert answer(aboard, message(aboard, BODY)) == (False, 0)
    assert moved(aboard)


@pytest.mark.parametrize("missing", [1, 8, 16, 24, len(BODY) - 1, len(BODY)])
def test_a_drive_cut_short_does_not(aboard: Aboard, missing: int) -> None:
    body = BODY[: len(BODY) - missing]
    assert answer(aboard, message(aboard, body)) == (True, BAD_ENCODING)
    assert not moved(aboard)


@pytest.mark.parametrize("more", [b"\x00", b"\xff" * 8, BODY])
def test_a_drive_with_octets_left_over_does_not(aboard: Aboard, more: bytes) -> None:
    assert answer(aboard, message(aboard, BODY + more)) == (True, BAD_ENCODING)
    assert not moved(aboard)


def test_a_flag_that_is_neither_0_nor_1_is_bad_encoding(aboard: Aboard) -> None:
    end_of_booleans = len(BODY) - 24
    body = bytearray(BODY)
    body[end_of_booleans - 1] = 7
    assert answer(aboard, message(aboard, bytes(body))) == (True, BAD_ENCODING)
    assert not moved(aboard)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a rover not wait for the rest of a message for as long as the product does."""
    limits = replace(served_operations.LIMITS, stall_s=0.2)
    monkeypatch.setattr(served_operations, "LIMITS", limits)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    "octets",
    [
        b"\x7f\xff\xff\xff" + b"\x00" * 60,
        b"\x00\x20\x00\x00" + b"\x00" * 60,
        b"\x21\x0b\xb9\x00" + b"\x00" * 60,
        b"GET / HTTP/1.1\r\nHost: rover\r\n\r\n",
    ],
)
def test_an_invalid_message_ends_the_connection_and_nothing_else(
    aboard: Aboard, octets: bytes
) -> None:
    with socket.create_connection(address(aboard), timeout=ANSWER_S) as connection:
        connection.sendall(octets)
        with suppress(ConnectionResetError):
            assert received(connection) == b""
    assert answer(aboard, message(aboard, BODY)) == (False, 0)


def test_a_message_in_crumbs_is_a_message(aboard: Aboard) -> None:
    with socket.create_connection(address(aboard), timeout=ANSWER_S) as connection:
        for octet in message(aboard, BODY):
            connection.sendall(bytes([octet]))
        header, _ = decode_message(received(connection))
    assert (header.stage, header.is_error) == (InteractionStage.SUBMIT_ACK, False)
    assert moved(aboard)


def test_a_client_that_vanishes_leaves_its_command_at_work(aboard: Aboard) -> None:
    with socket.create_connection(address(aboard), timeout=ANSWER_S) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.sendall(message(aboard, BODY))
        received(connection)
    assert moved(aboard)
    assert answer(aboard, message(aboard, BODY)) == (True, 3)
