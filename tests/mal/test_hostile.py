"""Wrong messages: what each is answered by. Many more are sent by tests/stress/mal_fuzz.py."""

import asyncio
import dataclasses
import logging
import random
from collections import Counter
from typing import Any

import pytest

from adapters.mal import (
    AttributeType,
    Consumer,
    DecodeError,
    EncodeError,
    Header,
    InteractionStage,
    MalError,
    MalUri,
    NamedValue,
    Provider,
    StandardError,
    TypedAttribute,
    encode_message,
)
from adapters.mal.codec import MIN_MESSAGE_OCTETS, decode_message
from adapters.mal.connection import MESSAGE_CAP, Framer
from tests.mal.wiretest import FILE, SERVICE, SPECIFICATION, cut, provided
from tests.stress.fuzzing import mutate

MESSAGES, REPLIES = (
    [
        bytes.fromhex(vector["message"])
        for vector in FILE["vectors"]
        if vector["encoding"] == "fixed" and vector["sender"] == sender
    ]
    for sender in ("consumer", "provider")
)


async def exchange(provider: Provider, message: bytes) -> list[tuple[Header, bytes]]:
    """Send octets on a new connection, hang up, and return every message that came back."""
    reader, writer = await asyncio.open_connection(provider.uri.host, provider.uri.port)
    replies = []
    try:
        writer.write(message)
        writer.write_eof()
        replies = [decode_message(reply) for reply in cut(Framer(), await reader.read(-1))]
    except ConnectionError:
        pass
    writer.close()
    return replies


async def test_a_consumer_outlives_wrong_replies_and_notifications(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A provider that answers with anything: a value, an error, or a lost link; nothing else."""
    caplog.set_level(logging.CRITICAL, "adapters.mal")
    chance = random.Random(17)
    outcomes: Counter[int | None] = Counter()

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        length = int.from_bytes(await reader.readexactly(4), "big")
        request = await reader.readexactly(length - 4)
        reply = mutate(chance.choice(REPLIES), chance)
        writer.write(reply[:13] + request[9:17] + reply[21:])
        writer.close()

    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    for _ in range(1000):
        consumer = await Consumer.connect(SPECIFICATION, MalUri("127.0.0.1", port, SERVICE))
        try:
            await consumer.request(SERVICE, "doRequest", 1.0)
            outcomes[None] += 1
        except MalError as error:
            outcomes[error.number] += 1
        await consumer.close()
    server.close()
    assert outcomes.total() == 1000
    assert outcomes[StandardError.DESTINATION_LOST.value] > 100
    assert outcomes[StandardError.BAD_ENCODING.value] > 10


async def test_the_older_header_is_named_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    async with provided() as provider:
        assert await exchange(provider, bytes.fromhex("2300b100030003010000")) == []
    (record,) = [record for record in caplog.records if record.name.startswith("adapters.mal")]
    assert record.levelno == logging.WARNING
    assert "521.0-B-2" in record.getMessage()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"is_error": True}, "error REQUEST is no message of a consumer"),
        ({"stage": InteractionStage.NOTIFY}, "NOTIFY is no message of a consumer"),
        ({"stage": InteractionStage.REQUEST_RESPONSE}, "no message of a consumer"),
    ],
)
async def test_what_no_consumer_sends_ends_the_connection(
    change: dict[str, Any], why: str, caplog: pytest.LogCaptureFixture
) -> None:
    async with provided() as provider:
        operation = SPECIFICATION.operation(SERVICE, "doRequest")
        header = Header.of(operation, InteractionStage.REQUEST, 1, to_uri=str(provider.uri))
        message = encode_message(dataclasses.replace(header, **change), bytes(8))
        assert await exchange(provider, message) == []
    assert why in caplog.text


@pytest.mark.parametrize(
    ("octets", "why"),
    [
        ((MESSAGE_CAP + 1).to_bytes(4, "big"), "message length 67108865"),
        ((MIN_MESSAGE_OCTETS - 1).to_bytes(4, "big"), "message length 26"),
        (b"\xff\xff\xff\xff", "message length 4294967295"),
        (b"\x23\0\0\0", "header of 521.0-B-2"),
    ],
)
def test_lengths_beyond_belief_are_refused_at_once(octets: bytes, why: str) -> None:
    with pytest.raises(DecodeError, match=why):
        list(cut(Framer(), octets))


def test_messages_are_separated_for_any_fragmentation_of_the_stream() -> None:
    stream = b"".join(MESSAGES[:20])
    for step in (1, 3, 7, 100, len(stream)):
        framer = Framer()
        chunks = [stream[at : at + step] for at in range(0, len(stream), step)]
        assert [m for chunk in chunks for m in cut(framer, chunk)] == MESSAGES[:20]


@pytest.mark.parametrize(
    ("at", "octet", "why"),
    [
        (4, 0x03, "header version 0"),
        (4, 0x36, "unknown SDU type 22"),
        (21, 0xF0, "fields that 521.0-B-3 does not have"),
        (21, 0xD8, "fields that 521.0-B-3 does not have"),
        (21, 0xD4, "fields that 521.0-B-3 does not have"),
        (21, 0xD2, "fields that 521.0-B-3 does not have"),
        (22, 1, "encoding id 1"),
        (23, 0x7F, "list elements"),
        (26, 1, "octets expected"),
        (27, 0x7F, "octets expected"),
        (31, 0xFF, "not UTF-8"),
        (21, 0xD1, "octets expected"),
        (3, 0, "length 0 in a message"),
    ],
)
def test_the_header_is_read_strictly(at: int, octet: int, why: str) -> None:
    message = MESSAGES[1]
    assert decode_message(message)
    with pytest.raises(DecodeError, match=why):
        decode_message(message[:at] + bytes([octet]) + message[at + 1 :])


def test_every_field_of_a_header_survives() -> None:
    nil, text = (
        NamedValue(name="nil"),
        NamedValue(name="text", value=TypedAttribute(AttributeType.STRING, "é")),
    )
    header = Header(
        InteractionStage.PROGRESS_UPDATE,
        1,
        2,
        3,
        4,
        -5,
        True,
        "maltcp://a:1/b",
        None,
        10**18,
        (nil, text),
        b"k",
    )
    for case in (header, dataclasses.replace(header, timestamp_ns=None, authentication_id=None)):
        assert decode_message(encode_message(case, b"body")) == (case, b"body")
    for wrong in ({"area": 1 << 16}, {"transaction_id": 1 << 63}, {"from_uri": 5}, {"qos": 99}):
        with pytest.raises(EncodeError):
            encode_message(dataclasses.replace(header, **wrong), b"")  # type: ignore[arg-type]
